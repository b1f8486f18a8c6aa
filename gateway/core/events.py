"""What the engine takes and gives: frozen values, no behaviour. The inbox log of these replays any incident.

Going in: samples and link events from the robot plane, requests and keepalives from the local plane, and the daemon's own.
Coming out: frames for the robot, replies, notices, a snapshot, and what must be remembered across a restart.
Time is integer monotonic nanoseconds of this host. Topics are ROS names of `robot.TOPICS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Union

from gateway.errors import Code, Refusal
from gateway.values import ArmState, CurrentMode, EePose, MotorState, Side, Vector

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

StateValue = Union[ArmState, MotorState, EePose, CurrentMode, int]
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


class OnLoss(str, Enum):
    """What happens when the owner vanishes: keep holding, or pause the robot at once."""

    HOLD = "hold"
    PAUSE = "pause"


class OnLimit(str, Enum):
    """What happens to a target outside the limits: refused, or clipped and reported."""

    REJECT = "reject"
    CLIP = "clip"


@dataclass(frozen=True, slots=True, kw_only=True)
class Acquire:
    """Ask for the lease when it is free. `pid` and `name` are shown to others."""

    name: str
    pid: int
    on_loss: OnLoss = OnLoss.HOLD


@dataclass(frozen=True, slots=True, kw_only=True)
class Take:
    """Take the lease from its owner, for people; brakes first."""

    name: str
    pid: int
    reason: str
    on_loss: OnLoss = OnLoss.HOLD


@dataclass(frozen=True, slots=True, kw_only=True)
class Release:
    """Give the lease back: brake, rest, heartbeat 0.0."""

    epoch: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Abandon:
    """Leave as if the client had vanished: brake and hold, the clocks run."""

    epoch: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Enable:
    """Bring the FSM to READY; the outcome is seen in the snapshot."""

    epoch: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Disable:
    """Brake to rest, then heartbeat 0.0; the lease stays."""

    epoch: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """Point to point, all joints of all named arms ending together.

    Attributes:
        epoch: Lease epoch.
        targets_rad: Per side seven joints [rad]; offsets from the reference when `relative`.
        relative: Whether the targets are offsets.
        speed: Factor on velocity, 0 < speed <= 1.
        tolerance_rad: Settling tolerance [rad]; None for the configured one.
        on_limit: Reject or clip.
    """

    epoch: int
    targets_rad: Mapping[Side, Vector]
    relative: bool = False
    speed: float = 1.0
    tolerance_rad: float | None = None
    on_limit: OnLimit = OnLimit.REJECT


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenStream:
    """Open a stream of joint targets for one arm; it starts at the present reference."""

    epoch: int
    side: Side
    speed: float = 1.0
    on_limit: OnLimit = OnLimit.REJECT
    expiry_ns: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CloseStream:
    """End a stream: brake to rest and hold."""

    epoch: int
    stream_id: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold:
    """Brake the named arms and hold; ends their motions as cancelled."""

    epoch: int
    sides: tuple[Side, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cancel:
    """Brake and end one motion."""

    epoch: int
    motion_id: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Stop:
    """Stop everything. Anybody may; latches unless the owner asks."""

    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estop:
    """Stop everything and pause the FSM. Anybody may; always latches; the grip is lost."""

    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recover:
    """Clear all latches, or none when a cause persists. Never moves, never enables."""


Request = Union[
    Acquire, Take, Release, Abandon, Enable, Disable, Move, OpenStream, CloseStream, Hold, Cancel, Stop, Estop, Recover
]


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


Event = Union[
    SampleArrived,
    SampleRefused,
    LinkUp,
    LinkDown,
    RouteObserved,
    CommandRequested,
    TargetArrived,
    ClientSeen,
    ClientGone,
    Suspended,
    ExitRequested,
]


# ---------------------------------------------------------------------------------------------- coming out


class FrameKind(str, Enum):
    """Why a frame is sent; the gate decides by it.

    MOTION may change a target of the owner's; ECHO repeats the latched start while enabling; BRAKE ends a motion; HOLD
    repeats the last reference; WALK leads a held reference back to the measured arm; BEAT is heartbeat 1.0; STOP is a
    stop frame (chassis zeros, lift, 0.0).
    """

    MOTION = "motion"
    ECHO = "echo"
    BRAKE = "brake"
    HOLD = "hold"
    WALK = "walk"
    BEAT = "beat"
    STOP = "stop"


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """One message for the robot.

    Attributes:
        topic: ROS name of a command topic.
        values: Joint positions [rad], pose (p, xyzw), or the floats of the array.
        kind: Why it is sent.
        epoch: Lease epoch under which it was made; 0 when none.
        due_ns: The instant of its grid for which it was made [ns].
    """

    topic: str
    values: Vector
    kind: FrameKind
    epoch: int
    due_ns: int


class Level(str, Enum):
    """How loud a notice is."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice:
    """Something a person or a log should see.

    Attributes:
        code: Stable code.
        level: How loud.
        message: One sentence.
        at_ns: When [ns].
        facts: Further facts as text.
    """

    code: Code
    level: Level
    message: str
    at_ns: int
    facts: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply:
    """The one answer to a request.

    Attributes:
        client_id: Who asked.
        request_id: Which request.
        refusal: Why not, or None when it was accepted.
        facts: What the caller needs to go on: `epoch`, `motion_id`, `stream_id`, `q_rad`, `clipped`, ...
    """

    client_id: str
    request_id: int
    refusal: Refusal | None = None
    facts: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Remembered:
    """What survives a restart of the daemon.

    Attributes:
        epoch: No epoch up to this one is ever given again.
        latches: Causes with their messages.
    """

    epoch: int = 0
    latches: Mapping[Code, str] = field(default_factory=dict)
