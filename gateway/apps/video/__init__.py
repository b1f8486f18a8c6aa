"""The robot's video stream: received, decoded, cut into its six views, recorded (§3.1.2, 5.1-5.3).

Knows nothing of the daemon: the robot sends its pictures straight to this host, as RTP/H.265 on udp/8890.
"""
