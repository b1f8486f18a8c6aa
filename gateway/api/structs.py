"""Messages of the local API as structs: requests and targets going in, replies, notices and facts coming out.

Rules
    * What goes in is strict: unknown fields, unknown types and oversized values are refused, because to ignore half of
      a demand is dangerous. What comes out is tolerant: a later daemon may add fields without breaking this client.
    * A field has the name it has in the core (tests compare them); units are in the names.
    * Structs check form only. Lengths, limits and finiteness are judged by the core, with value, bound and remedy:
      msgpack carries NaN, JSON cannot.
    * Reasons of `stop` and `estop` have no length limit: a stop is never refused.

Knows nothing of the core, of zenoh or of clocks. Import these names from `gateway.api.protocol`.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from msgspec import Meta, Struct, field

__all__ = [
    "Abandon",
    "Acquire",
    "Cancel",
    "CloseStream",
    "Command",
    "Disable",
    "Enable",
    "Estop",
    "Hold",
    "Info",
    "Move",
    "Notice",
    "OnLimitName",
    "OnLossName",
    "OpenStream",
    "Recover",
    "RefusalMessage",
    "Release",
    "Reply",
    "Request",
    "Routes",
    "SideName",
    "Stop",
    "Take",
    "Target",
]

SideName = Literal["left", "right"]
OnLossName = Literal["hold", "pause"]
OnLimitName = Literal["reject", "clip"]

_Count = Annotated[int, Meta(ge=0, le=2**62)]
_Pid = Annotated[int, Meta(ge=0, le=2**31)]
_Name = Annotated[str, Meta(min_length=1, max_length=64)]
_Text = Annotated[str, Meta(max_length=512)]
_ClientId = Annotated[str, Meta(pattern=r"^[0-9A-Za-z_-]{1,64}\Z")]
_Joints = Annotated[tuple[float, ...], Meta(max_length=64)]


def _tag(class_name: str) -> str:
    """Return the tag of a request class: `OpenStream` -> `open_stream`."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", class_name).lower()


# ------------------------------------------------------------------------------------------------------- going in


class _Incoming(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="type", tag=_tag):
    """A request; its JSON form has a `type` beside its fields."""


class Acquire(_Incoming, frozen=True):
    """Ask for the lease when it is free. Reply: `epoch`."""

    name: _Name
    pid: _Pid
    on_loss: OnLossName = "hold"


class Take(_Incoming, frozen=True):
    """Take the lease from its owner, for people; brakes first. Reply: `epoch`."""

    name: _Name
    pid: _Pid
    reason: _Text
    on_loss: OnLossName = "hold"


class Release(_Incoming, frozen=True):
    """Give the lease back: brake, rest, heartbeat 0.0."""

    epoch: _Count


class Abandon(_Incoming, frozen=True):
    """Leave as if the client had vanished: brake and hold, the clocks run."""

    epoch: _Count


class Enable(_Incoming, frozen=True):
    """Bring the FSM to READY; the outcome is in the snapshot."""

    epoch: _Count


class Disable(_Incoming, frozen=True):
    """Brake to rest, then heartbeat 0.0; the lease stays."""

    epoch: _Count


class Move(_Incoming, frozen=True):
    """Point to point; all joints of all named arms end together. Reply: `motion_id`, `clipped`.

    Attributes:
        epoch: Lease epoch.
        targets_rad: Per side seven joints [rad]; offsets from the reference when `relative`.
        relative: Whether the targets are offsets.
        speed: Factor on velocity, 0 < speed <= 1.
        tolerance_rad: Settling tolerance [rad]; null for the configured one.
        on_limit: What happens to a target outside the limits.
    """

    epoch: _Count
    targets_rad: dict[SideName, _Joints]
    relative: bool = False
    speed: float = 1.0
    tolerance_rad: float | None = None
    on_limit: OnLimitName = "reject"


class OpenStream(_Incoming, frozen=True):
    """Open a stream of joint targets for one arm. Reply: `stream_id`, `q_rad` (where it starts)."""

    epoch: _Count
    side: SideName
    speed: float = 1.0
    on_limit: OnLimitName = "reject"
    expiry_ns: _Count | None = None


class CloseStream(_Incoming, frozen=True):
    """End a stream: brake to rest and hold."""

    epoch: _Count
    stream_id: _Count


class Hold(_Incoming, frozen=True):
    """Brake the named arms and hold; their motions end as cancelled."""

    epoch: _Count
    sides: Annotated[tuple[SideName, ...], Meta(max_length=8)]


class Cancel(_Incoming, frozen=True):
    """Brake and end one motion."""

    epoch: _Count
    motion_id: _Count


class Stop(_Incoming, frozen=True, forbid_unknown_fields=False):
    """Stop everything. Anybody may; latches unless the owner asks. Reply: `stop_undelivered`.

    Unknown fields do not matter: a stop is never refused for what a later release adds to it.
    """

    reason: str = ""


class Estop(_Incoming, frozen=True, forbid_unknown_fields=False):
    """Stop everything and pause the FSM. Anybody may; always latches. Does not replace the physical emergency stop."""

    reason: str = ""


class Recover(_Incoming, frozen=True):
    """Clear all latches, or none when a cause persists. Never moves, never enables."""


Request = (
    Acquire
    | Take
    | Release
    | Abandon
    | Enable
    | Disable
    | Move
    | OpenStream
    | CloseStream
    | Hold
    | Cancel
    | Stop
    | Estop
    | Recover
)


class Command(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A request in its envelope: the payload of a query on the command key.

    Attributes:
        version: `PROTOCOL_VERSION` of the sender.
        client_id: Unique per client; the same as in its liveliness token, keepalives and targets.
        request_id: Unique per client. The same id again gets the first reply again: a lost reply can be asked for.
        request: What is asked.
    """

    version: _Count
    client_id: _ClientId
    request_id: _Count
    request: Request


class Target(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The newest target of a stream: the payload of a put on the target key. The newest wins; none is answered.

    Attributes:
        epoch: Lease epoch.
        seq: Strictly rising per stream.
        q_rad: Seven joints [rad].
    """

    epoch: _Count
    seq: _Count
    q_rad: _Joints


# ------------------------------------------------------------------------------------------------------ coming out


class RefusalMessage(Struct, frozen=True, kw_only=True):
    """Why a request was not carried out; the fields of `gateway.errors.Refusal`.

    `code` is text here: a later daemon may know codes that this client does not.
    """

    code: str
    message: str
    field: str = ""
    value: str = ""
    bound: str = ""
    unit: str = ""
    hint: str = ""


class Reply(Struct, frozen=True, kw_only=True):
    """The one answer to a command.

    Attributes:
        request_id: Of the command.
        refusal: Why not; null when it was accepted.
        facts: What the caller needs to go on, e.g. `epoch`, `motion_id`, `stream_id`, `q_rad`, `clipped`.
        after_seq: A snapshot with a greater `seq` shows the effect of the command; one with this or a smaller may not.
    """

    request_id: int
    refusal: RefusalMessage | None = None
    facts: dict[str, Any] = field(default_factory=dict)
    after_seq: int = 0


class Notice(Struct, frozen=True, kw_only=True):
    """Something a person or a log should see.

    Attributes:
        code: Stable code.
        level: `info`, `warning` or `error`.
        message: One sentence.
        at_ns: When, on the daemon's monotonic clock [ns].
        facts: Further facts as text.
    """

    code: str
    level: str
    message: str
    at_ns: int
    facts: dict[str, str] = field(default_factory=dict)


class Routes(Struct, frozen=True, kw_only=True):
    """How the robot's bridge stands to each topic, as discovery knows it: the answer to a query on the routes key.

    Attributes:
        routes: Per topic of this model, a few words: `ready`, or what is missing.
        bridge_version: Version of the robot's bridge; empty until it has said it.
        undelivered: Frames that were not handed to zenoh because there was no transport.
    """

    routes: dict[str, str]
    bridge_version: str
    undelivered: int


class Info(Struct, frozen=True, kw_only=True):
    """What does not change while a daemon runs: the answer to a query on the info key.

    Attributes:
        version: Release of the daemon.
        protocol: `PROTOCOL_VERSION` of the daemon.
        pid: Process id of the daemon.
        socket: Path of its unix socket.
        robot: Endpoint of the robot's router.
        model: `lite`, `standard` or `lift` (manual §1.2).
        has_lift: Whether this model has the lift.
        config_hash: Changes with any setting.
        joint_names: Per side, the seven joints in their order (manual §4.0.3).
        lower_rad: Per side, the configured lower position limits [rad].
        upper_rad: Per side, the configured upper position limits [rad].
        v_radps: Velocity limit of every joint [rad/s].
        a_radps2: Acceleration limit [rad/s²].
        j_radps3: Jerk limit [rad/s³].
        arm_rate_hz: Rate of the joint stream to the robot [Hz].
        snapshot_hz: Rate of published snapshots [Hz].
        settle_rad: Default tolerance of a move [rad].
        settle_ns: How long a move must stay within it [ns].
        tracking_rad: Distance between setpoint and measured that aborts when it lasts [rad].
        target_expiry_ns: Default life of a streamed target [ns].
        keepalive_ns: Silence after which an owner counts as lost [ns].
        free_after_ns: The lease is free this long after the loss [ns].
        down_after_ns: Everything goes down this long after the loss [ns].
    """

    version: str
    protocol: int
    pid: int
    socket: str
    robot: str
    model: str
    has_lift: bool
    config_hash: str
    joint_names: dict[str, tuple[str, ...]]
    lower_rad: dict[str, tuple[float, ...]]
    upper_rad: dict[str, tuple[float, ...]]
    v_radps: float
    a_radps2: float
    j_radps3: float
    arm_rate_hz: float
    snapshot_hz: float
    settle_rad: float
    settle_ns: int
    tracking_rad: float
    target_expiry_ns: int
    keepalive_ns: int
    free_after_ns: int
    down_after_ns: int
