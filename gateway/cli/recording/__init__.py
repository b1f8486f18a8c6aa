"""`ta2 record`, `ta2 episode` and `ta2 bag`: bags recorded, their episodes named, bags looked at, judged, cut and exported.

In: what robot and gateway say (`gateway.recording`), the cameras' pictures; finished bags.
Out: a bag's folder; words or JSON about it, other bags, tables.
Read first: `record.py`; what is done with a bag is `bag.py`.
"""
