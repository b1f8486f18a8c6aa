"""Commands of `ta2 video`: watch the six views, record them, split and judge recordings.

In: the pictures of `gateway.video`, or a recording's files.
Out: windows, files, pages for people, JSON for scripts.
Read first: `commands.py`.
"""
