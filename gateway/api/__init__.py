"""The local plane: what clients on this side say to the daemon, and how it answers.

In: queries, puts and tokens of zenoh on a unix socket or a port; lines in two pipes, which are stops; the engine's replies,
notices and snapshots.
Out: requests and targets in an inbox, stops past it; bytes for clients. Nothing that comes in is believed before it is decoded.
Read first: `protocol.py`, the contract; then `service.py`, which has the threads.
"""
