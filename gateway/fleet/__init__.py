"""A robot in its fleet: a process beside the gateway that is its client, and the robot on the fleet's zenoh router.

In: the settings' `[fleet]`, the gateway's socket; what the fleet's clients ask.
Out: their requests to the gateway, its answers and snapshots to them. Stops go to its pipes, and to its guard.
Read first: `member.py`; `router.py` says what who may on the router.
"""
