"""How arms move: generators of setpoints, period by period. Pure arithmetic; knows no requests and no robot state.

In: limits, where an arm is, where it shall be. Out: the next setpoint of one arm, or a refusal of a whole trajectory.
One core moves in either space (`space.py`): `joints/` has what is particular to seven joints, `poses/` to an end effector,
`lines/` straight ways in joint space. Read first: `motion.py`, one arm's reference.
"""
