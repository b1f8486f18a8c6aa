"""What the robot's bridge says about its topics: tokens, routes that are dead or lost, robots that are announced.

In: liveliness tokens, admin space, arrivals.
Out: observations for the engine and for `ta2 link`.
Read first: `discovery.py`.
"""
