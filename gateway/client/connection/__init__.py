"""A client's connection: transport, identity, and the session that keeps what was heard.

In: an address and credentials; payloads of the daemon.
Out: the newest snapshot, notices, the lease; payloads to the daemon.
Read first: `session.py`.
"""
