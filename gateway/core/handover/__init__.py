"""Going on in another process's place: when a daemon counts as frozen, and how what it held is taken over.

In: what the other process showed (`messages/held.py`). Out: a hold that begins without a step.
Read first: `takeover.py`.
"""
