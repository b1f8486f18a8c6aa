"""The robot's cameras: lenses, stereo pairs, the six views of the video (manual §5.2).

In: points of a frame [m], pixels.
Out: pixels, directions, tables for undistortion.
Read first: `lens.py`.
"""
