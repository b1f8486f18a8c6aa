"""Commands of `ta2` that move the robot, hold it or stop it.

In: values of the command line.
Out: requests through the client, asked for on a terminal first.
Read first: `job.py`.
"""
