"""Which state the gateway is in, who owns the robot, and what each event does. The table is `supervisor.py`.

In: events, the robot's condition, clocks of owner and stop endpoints. Out: state, latches, cuts, brakes, 0.0.
Read first: `supervisor.py`, then `coordinator.py`, which carries the table out. Where a lease ends: `lease.py`.
"""
