"""The brain: pure and sequential. No zenoh, no thread, no clock, no log, no CDR.

In: events and `now_ns`. Who has an engine calls it from one thread: `process/loop.py`, and the guard.
Out: frames that the gate has cleared, replies, notices, snapshots.
Read first: `engine.py`, one screen that explains all; each room beside it says what is in it.
"""
