"""Who may ask for what over the network, and who did.

In: a file of users and roles, the key on which a request came; requests and what was answered.
Out: zenoh's rules and each request's role; one line of JSON a request, by a thread that may wait for the disk.
Read first: `roles.py`; the log is `audit.py`.
"""
