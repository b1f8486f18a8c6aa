"""Forward and inverse kinematics of one arm: closed form, search, reach and dexterity. `../arm.py` puts them together.

In: joints [rad], poses [m, xyzw].
Out: poses, joints, Jacobians, or why there are none.
Read first: `chain.py`.
"""
