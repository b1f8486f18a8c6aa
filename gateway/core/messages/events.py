"""What the engine takes and gives: frozen values, no behaviour. The inbox log of these replays any incident.

Going in: samples and link events from the robot plane, requests and keepalives from the local plane, and the daemon's own.
The requests themselves (`requests.py`), what is seen of others (`sightings.py`) and what comes out (`outputs.py`) are
given on from here.
Time is integer monotonic nanoseconds of this host. Topics are ROS names of `topics.TOPICS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

from msgspec import Struct

from gateway.core.messages.held import Held
from gateway.core.messages.sightings import (
    Sighting,
)
from gateway.core.motion.chunk import Chunk
from gateway.errors import Code
from gateway.messages.requests import (
    Request,
)
from gateway.values import ArmState, CurrentMode, EePose, MotorState, Role, Vector

__all__ = [
    "ClientGone",
    "ClientSeen",
    "CommandRequested",
    "EndpointHeard",
    "Event",
    "ExitRequested",
    "GuardSeen",
    "HeldElsewhere",
    "LinkDown",
    "LinkUp",
    "PartEnded",
    "RobotsAnnounced",
    "RouteObserved",
    "SampleArrived",
    "SampleRefused",
    "SettingsRead",
    "StateValue",
    "Suspended",
    "TakenOver",
    "TargetArrived",
]

StateValue: TypeAlias = ArmState | MotorState | EePose | CurrentMode | int
"""Decoded state: arm, gripper or chassis motors, pose, mode, or the raw integer of `/fsm_state`."""


# ---------------------------------------------------------------------------------------------- from the robot


class SampleArrived(Struct, frozen=True, kw_only=True):
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


class SampleRefused(Struct, frozen=True, kw_only=True):
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


class LinkUp(Struct, frozen=True, kw_only=True):
    """A transport to the robot's router is open.

    Attributes:
        router_zid: zenoh id of the router: another one than before means that the robot restarted.
        at_ns: When [ns].
        own_zid: zenoh id of our own session.
    """

    router_zid: str
    at_ns: int
    own_zid: str = ""


class LinkDown(Struct, frozen=True, kw_only=True):
    """No transport to the robot's router any more."""

    at_ns: int


class RouteObserved(Struct, frozen=True, kw_only=True):
    """What discovery says about a topic's route: ROUTE_DEAD or ROUTE_LOST with a text, or None when it is alive."""

    topic: str
    code: Code | None
    message: str
    at_ns: int


class RobotsAnnounced(Struct, frozen=True, kw_only=True):
    """What the tokens say about robots, as far as it is not one robot where we listen; all empty: that is over.

    Attributes:
        elsewhere: Namespaces of robots, while nothing is heard under ours.
        twins: Zenoh ids of bridges, while more than one announces a robot under our namespace.
        at_ns: When [ns].
    """

    elsewhere: tuple[str, ...]
    at_ns: int
    twins: tuple[str, ...] = ()


# ---------------------------------------------------------------------------------------------- from clients


class CommandRequested(Struct, frozen=True, kw_only=True):
    """A request that wants exactly one reply.

    Attributes:
        client_id: Who asks: unique per client process and connection. By this alone is judged who may.
        name: What people call him, where it came along; empty else.
        request_id: Echoed in the reply; a repeated (client_id, request_id) gets the first reply again.
        request: What is asked.
        received_ns: Local monotonic arrival [ns].
        content: Tells requests under one number apart: the same for the same bytes, for as long as this process lives.
        chunk: The motion through the points of a `Follow` or `CheckFollow`, where somebody has worked it out already: it takes
            milliseconds.
        role: Of whoever asks; where nobody has one, everybody is an admin.
    """

    client_id: str
    name: str = ""
    request_id: int
    request: Request
    received_ns: int
    content: int = 0
    chunk: Chunk | None = None
    role: Role = Role.ADMIN


class TargetArrived(Struct, frozen=True, kw_only=True):
    """The newest streamed target of a stream (latest value slot).

    Attributes:
        client_id: Who sent it.
        stream_id: Of the reply to OpenStream.
        epoch: Lease epoch.
        seq: Strictly rising per stream; an older one is refused.
        values: The target in the space of the stream: seven joints [rad], or x, y, z [m], qx, qy, qz, qw; not yet checked.
        received_ns: Local monotonic arrival [ns].
    """

    client_id: str
    stream_id: int
    epoch: int
    seq: int
    values: Vector
    received_ns: int


class ClientSeen(Struct, frozen=True, kw_only=True):
    """A keepalive of a client library."""

    client_id: str
    at_ns: int


class EndpointHeard(Struct, frozen=True, kw_only=True):
    """A check-in of a stop endpoint."""

    client_id: str
    at_ns: int


class ClientGone(Struct, frozen=True, kw_only=True):
    """A client's liveliness token is gone."""

    client_id: str
    at_ns: int


# ---------------------------------------------------------------------------------------------- from the daemon


class Suspended(Struct, frozen=True, kw_only=True):
    """This host slept, or this process stood still: CLOCK_BOOTTIME ran away from CLOCK_MONOTONIC by `slept_ns`."""

    slept_ns: int
    at_ns: int


class TakenOver(Struct, frozen=True, kw_only=True):
    """Another process that commanded the robot has ended, or has handed over: go on with what it had on the wire."""

    held: Held
    at_ns: int


class HeldElsewhere(Struct, frozen=True, kw_only=True):
    """The guard of an earlier daemon holds the robot, or (with `is_held` false) does so no more."""

    is_held: bool
    at_ns: int


class GuardSeen(Struct, frozen=True, kw_only=True):
    """How this daemon's guard is.

    Attributes:
        pid: Its process id; 0 while none runs.
        zid: Its zenoh id on the robot plane; empty before it has one.
        is_linked: Whether it is connected to the robot's router.
        lost: Why the guard before this one ended; empty when it did not.
        at_ns: When [ns].
    """

    pid: int
    zid: str
    is_linked: bool
    at_ns: int
    lost: str = ""


class PartEnded(Struct, frozen=True, kw_only=True):
    """A part of the daemon does its work no more: one of its threads ended unasked, or its API does not answer.

    Attributes:
        message: Which, and why, in one sentence.
        trace: Of what ended it; empty where there is none.
        at_ns: When [ns].
    """

    message: str
    at_ns: int
    trace: str = ""


class SettingsRead(Struct, frozen=True, kw_only=True):
    """The settings file was read anew, and judged (`settings/reloading.py`).

    Attributes:
        values: What is taken of it, by section and field, in the units of `Settings`; empty where nothing is, or has changed.
        message: The same in the words of the file, or why nothing of it is taken.
        is_refused: Whether nothing of it is taken.
        at_ns: When [ns].
    """

    values: Mapping[str, float]
    message: str
    at_ns: int
    is_refused: bool = False


class ExitRequested(Struct, frozen=True, kw_only=True):
    """SIGTERM or Ctrl-C: end cleanly within 5 s."""

    at_ns: int


Event: TypeAlias = (
    SampleArrived
    | SampleRefused
    | LinkUp
    | LinkDown
    | RouteObserved
    | RobotsAnnounced
    | Sighting
    | CommandRequested
    | TargetArrived
    | ClientSeen
    | EndpointHeard
    | ClientGone
    | Suspended
    | TakenOver
    | HeldElsewhere
    | GuardSeen
    | PartEnded
    | SettingsRead
    | ExitRequested
)
