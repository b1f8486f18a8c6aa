"""Recordings: made without re-encoding, indexed, measured, split into the six views.

In: coded pictures, or a recording's files.
Out: files, and what they hold.
Read first: `recorder.py`.
"""
