"""Bring-up: what the manual asks of robot and host before anything is done with them (`ta2 check`, `ta2 doctor`).

In: what a look at the wire and a tap of the robot's topics saw, what the host says of itself. Out: rows with a verdict,
a figure, its bound and what to do. Read `rows.py` first, then `looked.py` (what can be seen) and `moved.py` (what has to be moved).
"""
