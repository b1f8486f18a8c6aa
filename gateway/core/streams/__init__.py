"""Streams to the robot, one class per actuator, each on its own absolute time grid; and the gate, which clears their frames.

In: setpoints of `motion/`, velocities and grips of the owner, stops.
Out: the frame that is due, `Cleared` or refused: nothing else reaches the wire.
Read first: `stream.py`, then `gate.py`.
"""
