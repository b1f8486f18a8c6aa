"""The black box: what an engine heard and gave in the last minute, on disk, kept when it matters, and run again.

In: an engine, its events and outputs, by reference (the loop); a folder of an incident.
Out: a ring of pieces, incidents, a file of events; a replay that must give the same frames bit by bit.
Read first: `recorder.py`, then `records.py`; what is made of an incident is `replay.py`.
"""
