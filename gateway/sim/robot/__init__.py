"""The simulated robot's rules, written from the manual: arms, grippers, chassis, lift, FSM, telemetry, faults. Pure.

In: messages and the time.
Out: messages, and what the robot saw of its users.
Read first: `model.py`.
"""
