"""The robot's command side as one thing: all streams, and the motions and targets that drive them.

In: accepted motions, targets, drives. Out: setpoints for the streams; how motions end.
Read first: `body.py`.
"""
