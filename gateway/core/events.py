"""What the engine takes and gives: frozen values, no behaviour. The inbox log of these replays any incident.

Going in: samples and link events from the robot plane, requests and keepalives from the local plane, and the daemon's own.
The requests themselves (`requests.py`) and what comes out (`outputs.py`) are given on from here.
Time is integer monotonic nanoseconds of this host. Topics are ROS names of `robot.TOPICS`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from gateway.core.outputs import Frame, FrameKind, Level, Notice, Remembered, Reply
from gateway.core.requests import (
    Abandon,
    Acquire,
    Cancel,
    CloseStream,
    Disable,
    Enable,
    Estop,
    Hold,
    Move,
    OnLimit,
    OnLoss,
    OpenStream,
    Recover,
    Release,
    Request,
    Stop,
    Take,
)
from gateway.errors import Code
from gateway.values import ArmState, CurrentMode, EePose, MotorState, Vector

__all__ = [
    "Abandon",
    "Acquire",
    "Cancel",
    "ClientGone",
    "ClientSeen",
    "CloseStream",
    "CommandRequested",
    "Disable",
    "Enable",
    "Estop",
    "Event",
    "ExitRequested",
    "Frame",
    "FrameKind",
    "Hold",
    "Level",
    "LinkDown",
    "LinkUp",
    "Move",
    "Notice",
    "OnLimit",
    "OnLoss",
    "OpenStream",
    "Recover",
    "Release",
    "Remembered",
    "Reply",
    "Request",
    "RouteObserved",
    "SampleArrived",
    "SampleRefused",
    "StateValue",
    "Stop",
    "Suspended",
    "Take",
    "TargetArrived",
]

StateValue: TypeAlias = ArmState | MotorState | EePose | CurrentMode | int
"""Decoded state: arm, gripper or chassis motors, pose, mode, or the raw integer of `/fsm_state`."""


# ---------------------------------------------------------------------------------------------- from the robot


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleArrived:
    """The newest sample of a topic since the last tick.

    Attributes:
        topic: ROS name.
        value: Decoded value.
        received_ns: Local monotonic arrival [ns].
        stamp_ns: Publish time on the robot's clock [ns]; None where the type has none.
        count: Samples that arrived on this topic since the last such event, this one included, duplicates excluded.
        duplicates: Duplicates skipped since the last such event.
        worst_gap_ns: Longest interval between two arrivals since the last such event [ns]; 0 when unknown.
    """

    topic: str
    value: StateValue
    received_ns: int
    stamp_ns: int | None = None
    count: int = 1
    duplicates: int = 0
    worst_gap_ns: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleRefused:
    """A sample that could not be believed: bad CDR, NaN, wrong length, other joint names.

    Attributes:
        topic: ROS name.
        code: SAMPLE_REFUSED, or JOINT_ORDER when the names contradict manual §4.0.3.
        message: What was wrong, with value and bound.
        received_ns: Local monotonic arrival [ns].
        count: How many since the last such event.
    """

    topic: str
    code: Code
    message: str
    received_ns: int
    count: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkUp:
    """A transport to the robot's router is open.

    Attributes:
        router_zid: zenoh id of the router: another one than before means that the robot restarted.
        at_ns: When [ns].
    """

    router_zid: str
    at_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkDown:
    """No transport to the robot's router any more."""

    at_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class RouteObserved:
    """What discovery says about a topic's route: ROUTE_DEAD or ROUTE_LOST with a text, or None when it is alive."""

    topic: str
    code: Code | None
    message: str
    at_ns: int


# ---------------------------------------------------------------------------------------------- from clients


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandRequested:
    """A request that wants exactly one reply.

    Attributes:
        client_id: Who asks: unique per client process and connection.
        request_id: Echoed in the reply; a repeated (client_id, request_id) gets the first reply again.
        request: What is asked.
        received_ns: Local monotonic arrival [ns].
    """

    client_id: str
    request_id: int
    request: Request
    received_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetArrived:
    """The newest streamed target of a stream (latest value slot).

    Attributes:
        client_id: Who sent it.
        stream_id: Of the reply to OpenStream.
        epoch: Lease epoch.
        seq: Strictly rising per stream; an older one is refused.
        q_rad: Seven joints [rad]; not yet checked.
        received_ns: Local monotonic arrival [ns].
    """

    client_id: str
    stream_id: int
    epoch: int
    seq: int
    q_rad: Vector
    received_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ClientSeen:
    """A keepalive of a client library."""

    client_id: str
    at_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ClientGone:
    """A client's liveliness token is gone."""

    client_id: str
    at_ns: int


# ---------------------------------------------------------------------------------------------- from the daemon


@dataclass(frozen=True, slots=True, kw_only=True)
class Suspended:
    """This host slept, or this process stood still: CLOCK_BOOTTIME ran away from CLOCK_MONOTONIC by `slept_ns`."""

    slept_ns: int
    at_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ExitRequested:
    """SIGTERM or Ctrl-C: end cleanly within 5 s."""

    at_ns: int


Event: TypeAlias = (
    SampleArrived
    | SampleRefused
    | LinkUp
    | LinkDown
    | RouteObserved
    | CommandRequested
    | TargetArrived
    | ClientSeen
    | ClientGone
    | Suspended
    | ExitRequested
)
