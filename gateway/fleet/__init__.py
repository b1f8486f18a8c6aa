"""A robot in its fleet: a process beside the gateway that is its client, and the robot on the fleet's zenoh router.

In: the fleet's router (`TA2_FLEET`), a name in it, the gateway's socket; what the fleet's clients ask.
Out: their requests to the gateway, its answers and snapshots to them. Stops go to its pipes, and to its guard.
Read first: `member.py`. What the router lets whom do is its own configuration: `docs/how-to/fleets.md`.
"""
