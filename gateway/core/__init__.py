"""The brain: pure and sequential. It takes events and `now_ns` and gives frames, replies, notices and snapshots.

No zenoh, no thread, no clock, no log, no CDR. Access must be serialised by the caller: `loop.py` is the only one.
"""
