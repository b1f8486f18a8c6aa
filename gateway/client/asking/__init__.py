"""What a client asks and waits for, without waiting: procedures that the blocking and the asyncio client run.

In: what a user wants, in arrays and numbers.
Out: requests of the protocol, and what to wait for.
Read first: `procedures.py`.
"""
