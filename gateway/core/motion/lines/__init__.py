"""Straight ways of the end effector of an arm in joint mode: worked out and judged whole before anything moves.

In: a pose, the body model, joint limits. Out: the joints as a function of time, or the first place that cannot be.
Read first: `line_plan.py`.
"""
