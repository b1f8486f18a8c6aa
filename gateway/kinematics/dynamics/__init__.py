"""Dynamics: what torques an arm's motors need, and from what they give, what else pulls at the arm.

`observer.py` and `wrench.py` are plain arithmetic and may be imported by anybody; pinocchio (extra `body`) is imported by
`arm_dynamics.py` alone, and that by `loading.py` when somebody asked for it.
"""
