"""What only the engine takes and gives, as frozen values without behaviour; what users say and see is `gateway.messages`.

In: `events.py`, with what is seen of others (`sightings.py`). Out: `outputs.py` (frames, replies, notices); `held.py` is what
a daemon shows to its guard.
Read first: `events.py`.
"""
