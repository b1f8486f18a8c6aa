"""How every command talks to a person: connecting, asking, progress, figures, colours, and how it ends.

In: a client, a snapshot, or an error.
Out: lines on a terminal and an exit status.
Read first: `ending.py`.
"""
