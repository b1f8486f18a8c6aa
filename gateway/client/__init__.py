"""The client library: all that a user's program needs. Imports zenoh, msgspec and numpy; nothing of the daemon.

In: what a user asks, in numbers and arrays; what the daemon says. Out: requests, targets; views of the state, handles.
`connect()` is where to begin; `gateway.client.aio` has the same for asyncio. Errors are in `gateway.errors`.
Read first: `client.py`, then `control.py`; how a request comes about is `asking/procedures.py`.
"""

from __future__ import annotations

from gateway.client.asking.chunks import FollowCheck
from gateway.client.asking.poses import PoseTarget
from gateway.client.asking.results import MotionResult, Payload, StopResult
from gateway.client.client import EventStream, Robot, connect
from gateway.client.connection.over_zenoh import Credentials
from gateway.client.control import ArmControl, Control
from gateway.client.handles import JointStream, MotionHandle, PoseStream
from gateway.client.parts import ChassisControl, ChassisStream, GripperControl, LiftControl, LiftStream
from gateway.client.state.contact import Contact, contact
from gateway.client.state.health import Health
from gateway.client.state.reading import ArmState, MotorState, Pose, RobotState
from gateway.client.state.reasons import Finding, Why
from gateway.client.stop_endpoint import StopEndpoint

__all__ = [
    "ArmControl",
    "ArmState",
    "ChassisControl",
    "ChassisStream",
    "Contact",
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
    "Payload",
    "Pose",
    "PoseStream",
    "PoseTarget",
    "Robot",
    "RobotState",
    "StopEndpoint",
    "StopResult",
    "Why",
    "connect",
    "contact",
]
