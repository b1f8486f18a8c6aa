"""Where a limit is checked: whether a request may pass. Pure functions; every refusal has code, value, bound, unit, remedy.

In: a request. Out: what is asked for within the limits, or a refusal.
Read first: `validation.py`.
"""
