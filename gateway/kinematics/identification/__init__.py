"""What measurements tell of one robot's arm: pairs of joints and poses, parameters, a robust fit, live agreement.

In: joints [rad] and poses [m, xyzw] with their stamps.
Out: parameters with their spread, or what cannot be known.
Read first: `agreement.py`.
"""
