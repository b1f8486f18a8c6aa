"""The client library: all that a user's program needs. Imports zenoh, msgspec and numpy; nothing of the daemon.

`connect()` is the door; `gateway.client.aio` has the same for asyncio. Errors are in `gateway.errors`.
"""

from __future__ import annotations

from gateway.client.chunks import FollowCheck
from gateway.client.client import EventStream, Robot, connect
from gateway.client.control import ArmControl, Control
from gateway.client.handles import JointStream, MotionHandle, PoseStream
from gateway.client.health import Health
from gateway.client.over_zenoh import Credentials
from gateway.client.parts import ChassisControl, ChassisStream, GripperControl, LiftControl, LiftStream
from gateway.client.poses import PoseTarget
from gateway.client.procedures import MotionResult, StopResult
from gateway.client.reading import ArmState, MotorState, Pose, RobotState
from gateway.client.reasons import Finding, Why
from gateway.client.stop_endpoint import StopEndpoint

__all__ = [
    "ArmControl",
    "ArmState",
    "ChassisControl",
    "ChassisStream",
    "Control",
    "Credentials",
    "EventStream",
    "Finding",
    "FollowCheck",
    "GripperControl",
    "Health",
    "JointStream",
    "LiftControl",
    "LiftStream",
    "MotionHandle",
    "MotionResult",
    "MotorState",
    "Pose",
    "PoseStream",
    "PoseTarget",
    "Robot",
    "RobotState",
    "StopEndpoint",
    "StopResult",
    "Why",
    "connect",
]
