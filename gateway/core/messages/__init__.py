"""What goes in and what comes out, as frozen values without behaviour.

In: `events.py` and `requests.py`. Out: `outputs.py` (frames, replies, notices) and `snapshot.py`; `held.py` is what a daemon
shows to its guard.
Read first: `events.py`.
"""
