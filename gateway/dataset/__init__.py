"""Datasets: bags turned into LeRobot v2.1 and v3.0 for training, without ROS, torch or LeRobot; datasets judged and edited.

In: bags (`gateway.recording`), a layout that says which topic fills which dimension, and how it is resampled (`layout`).
Out: a folder that LeRobot and openpi load: Parquet, MP4, statistics; what was covered, and what was left out, is told.
Libraries: pyarrow for Parquet. Nothing here knows a robot, a gateway or a network. Read first: `building`.
"""
