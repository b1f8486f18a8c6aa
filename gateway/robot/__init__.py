"""The robot's facts, each in one place: what it says and is told, and how far it may go.

In come the manual's tables (sections in brackets); out go constants, read by everything else. Nothing here computes more
than a gripper's torque, and nothing knows zenoh, clocks or settings. What users see beside it, values (`gateway/values.py`)
and errors with their codes, lies one floor up, where it can be imported in one word.
Read `topics.py` first, then `limits.py`.
"""
