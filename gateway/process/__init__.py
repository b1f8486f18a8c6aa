"""What every process of the gateway needs: the loop, real-time measures, the log, what survives a restart.

In: an engine and its ports. Out: ticks on an absolute grid; state on disk.
Read first: `loop.py`.
"""
