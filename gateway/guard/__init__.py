"""The guard: the process that brakes, holds and stops when the daemon cannot; and the daemon's side of it.

In: what the daemon shows in shared memory, its life pipe, stops at a socket. Out: hold frames, or the end.
Read first: `guard.py`; the daemon's side is `launcher.py` and `successor.py`.
"""
