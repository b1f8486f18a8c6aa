"""`ta2 teleop`: a person's keys or gamepad move the robot, as an ordinary client with a deadman.

In: keys of a terminal, buttons and sticks of a gamepad.
Out: streams of small targets, velocities, gripper commands, episodes begun and judged; a line for what is refused.
Read first: `run.py`, then `session.py`, the loop; `jogging.py` is the arithmetic.
"""
