"""Motion of an end effector: position and orientation on one clock, quaternions xyzw.

In: poses in the arm's own frame [m], their limits. Out: poses on a clock of 1/70 s.
Read first: `pose_state.py`.
"""
