"""Commands of `ta2` that only look: state, live view, topics, wire, events, reasons.

In: snapshots, notices and facts of the client.
Out: pages for people, JSON for scripts.
Read first: `status.py`.
"""
