"""The robot plane: one zenoh session to the robot's router, CDR in both directions, and what discovery says.

`RobotLink` is all that the rest of the gateway needs; `codec` translates between domain values and messages.
"""

from __future__ import annotations

from gateway.link.robot_link import RobotLink

__all__ = ["RobotLink"]
