"""Commands of `ta2` about the robot's body: its frames, its numbers, and what this robot's differ in.

In: calibration files, pairs of joints and poses.
Out: tables, pictures, calibration files.
Read first: `identify.py`.
"""
