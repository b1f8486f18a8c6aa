"""Bring-up: what the manual asks of a robot before it is used (`ta2 check`), and what we ask of this computer (`ta2 doctor`).

Read `rows.py` first: what is asked, and all bounds. `looked.py` is what can be seen, `moved.py` what has to be moved.
"""
