"""What the engine gives besides snapshots: frames for the robot, replies, notices, and what must be remembered."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from msgspec import Struct, field

from gateway.errors import Code, Refusal
from gateway.values import Vector

__all__ = ["Frame", "FrameKind", "Level", "Notice", "Remembered", "Reply", "found_at", "router_name"]


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


class Notice(Struct, frozen=True, kw_only=True):
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


class Reply(Struct, frozen=True, kw_only=True):
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


ROUTERS_KEPT = 8


def router_name(zid: str, namespace: str) -> str:
    """Return how a robot is known behind a router, see `Remembered.routers`."""
    return f"{zid}/{namespace.strip('/')}"


def found_at(routers: tuple[str, ...], zid: str, namespace: str) -> tuple[str, ...]:
    """Return the routers at which a robot was found, with the one at which it is now as the latest."""
    name = router_name(zid, namespace)
    return (*(router for router in routers if router != name), name)[-ROUTERS_KEPT:]


class Remembered(Struct, frozen=True, kw_only=True):
    """What survives a restart of the daemon.

    Attributes:
        epoch: No epoch up to this one is ever given again.
        latches: Causes with their messages.
        zids: Zenoh ids of sessions of ours on the robot plane, the latest last: their tokens and late data are not foreign.
        routers: At which this robot was found, `ZID/NAMESPACE`, the latest last.
    """

    epoch: int = 0
    latches: Mapping[Code, str] = field(default_factory=dict)
    zids: tuple[str, ...] = ()
    routers: tuple[str, ...] = ()
