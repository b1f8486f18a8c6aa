"""The client library: all that a user's program needs. Imports zenoh, msgspec and numpy; nothing of the daemon.

`connect()` is the door; `gateway.client.aio` has the same for asyncio. Errors are in `gateway.errors`.
"""

from __future__ import annotations

from gateway.client.client import Robot, connect
from gateway.client.control import ArmControl, Control, JointStream, MotionHandle
from gateway.client.over_zenoh import Credentials
from gateway.client.procedures import MotionResult, StopResult
from gateway.client.reading import ArmState, Health, MotorState, Pose, RobotState

__all__ = [
    "ArmControl",
    "ArmState",
    "Control",
    "Credentials",
    "Health",
    "JointStream",
    "MotionHandle",
    "MotionResult",
    "MotorState",
    "Pose",
    "Robot",
    "RobotState",
    "StopResult",
    "connect",
]
