"""The robot plane: one zenoh session to the robot's router, CDR in both directions, and what discovery says.

In: bytes and tokens of the robot's router; frames that the gate has cleared. Out: events for the engine; bytes on the wire.
`RobotLink` is all that the rest of the gateway needs; `codec.py` translates between domain values and messages.
Read first: `robot_link.py`.
"""

from __future__ import annotations

from gateway.link.robot_link import RobotLink

__all__ = ["RobotLink"]
