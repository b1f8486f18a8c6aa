"""What a user reads: the robot's state, its health, and why it does not do what it is told.

In: snapshots of the session.
Out: frozen views with numpy vectors.
Read first: `reading.py`.
"""
