"""From datagrams to coded pictures of one sender, with an account of everything that was lost.

In: datagrams of one port.
Out: coded pictures, counters, health, and why there is no picture.
Read first: `receiver.py`.
"""
