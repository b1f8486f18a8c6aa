"""`ta2 policy run`: a policy drives the arms, is judged without moving them, or is compared with who drives.

In: a map in TOML, a policy's server or a function, the robot's state.
Out: chunks through the client (`gateway.policy`), figures, a plot.
Read first: `run.py`.
"""
