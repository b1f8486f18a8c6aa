"""Motion in joint space: planning, following, passing along trajectories, braking. All of it on ruckig.

In: joint limits, states and goals [rad]. Out: states on a clock of 10 ms.
Read first: `path.py`.
"""
