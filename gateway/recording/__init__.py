"""Recording: what a robot and its users say, as it came, into bags that ROS tools and Foxglove open; and bags read.

In: CDR payloads from the robot's router (`tap`), what the gateway tells (`gateway_tap`). Out: a folder with an MCAP file and
`metadata.yaml`. A recorder is a process of its own that can publish nothing: it may hang or die, and nobody notices.
Read first: `recorder`.
"""
