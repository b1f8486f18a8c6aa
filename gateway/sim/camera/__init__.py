"""The simulated robot's camera, a program of its own: pictures, H.265, RTP on an absolute grid.

In: settings, or the scene of the physics.
Out: packets to one address.
Read first: `__main__.py`.
"""
