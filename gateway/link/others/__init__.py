"""Who else commands the robot: other writers and gateways, and our own token that says that we do.

In: samples, tokens and the router's list of sessions.
Out: sightings for the engine.
Read first: `foreign_watch.py`.
"""
