"""What a tick gives: frames that the gate has cleared, the snapshot, and why the robot does not do what it is told.

In: everything as it stands at the end of a tick. Out: frames, snapshot.
Read first: `frame_collector.py`.
"""
