"""The sections of a calibration file, and the conventions that it names.

In: TOML of one robot.
Out: joint zeros, frames and cameras in this package's own conventions.
Read first: `conventions.py`.
"""
