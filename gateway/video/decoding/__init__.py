"""From coded pictures to frames: decoders in software and on NVIDIA's hardware, RGB, the six views.

In: coded pictures.
Out: immutable frames, the newest for any number of readers.
Read first: `decoding.py`.
"""
