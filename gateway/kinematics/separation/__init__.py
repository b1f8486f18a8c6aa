"""How quickly parts of the body may come together, so that they always stop with a gap.

In: the next step of both arms' joints [rad].
Out: whether it may be taken, and the gap [m].
Read first: `approach.py`.
"""
