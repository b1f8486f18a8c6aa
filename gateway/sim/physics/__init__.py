"""The simulated robot's body with forces, by MuJoCo (extra `sim`): nothing else of the simulation needs it.

In: what the robot's rules ask of their motors; the body's published numbers, of which the scene is made.
Out: positions, speeds and torques, as measured; pictures, a film, a window.
Read first: `world.py`; `bodies.py` joins it to the rules of `sim/robot`.
"""
