"""Answers requests: who may ask, what it sets in motion, the one reply.

In: requests that arrived. Out: one reply each; motions, targets and drives in `body/`, triggers in `supervision/`.
Read first: `handler.py`.
"""
