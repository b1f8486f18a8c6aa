"""The robot in three dimensions, over time: live, as a file, or from a recording. Drawn by Rerun, in a process of its own.

In: snapshots and notices of the gateway, the messages of a bag, pictures of the cameras.
Out: a window, or an .rrd file.
Read first: `view.py`.
"""

from gateway.recording.bag_writer import needed

__all__ = ()

needed("rerun", "view")  # before any of these modules is loaded: whoever lacks it is told what to install
