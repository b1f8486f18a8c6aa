"""Who else is there: writers of our command keys, other gateways, other robots, guards.

In: sightings on the robot's plane. Out: who they are, and our own claim. What follows from it is `supervision/rivalry.py`.
Read first: `others.py`.
"""
