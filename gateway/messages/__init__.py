"""What is said between user code, wire and engine: each request, reply, notice and view is defined here, once.

In: requests (`requests.py`) in their envelopes (`envelopes.py`). Out: replies and notices (`envelopes.py`), the snapshot
(`snapshot.py`), what a daemon says of itself and of its wire when asked (`facts.py`, `wire.py`).
All are frozen msgspec structs that know nobody: the engine takes and makes them, the client wraps them for people.
Read first: `requests.py`.
"""
