"""Dynamics: what torques an arm's motors need, and from what they give, what else pulls at the arm.

In: joints, speeds and efforts. Out: torques, the force at the hand and how sure it is, masses and friction as identified.
`observer.py` and `wrench.py` are plain arithmetic and may be imported by anybody; pinocchio (extra `body`) is imported by
`arm_dynamics.py` alone, and that by `loading.py` when somebody asked for it.
Read first: `observer.py`.
"""
