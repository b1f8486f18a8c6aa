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

from typing import Annotated, Any, Literal

from msgspec import Meta, Struct, field

from gateway.api.chunk_structs import CheckFollow, Follow
from gateway.api.ground_structs import DisableLift, DriveChassis, DriveLift, SetGripper, StopChassis, StopLift
from gateway.api.incoming import ClientId, Count, Incoming, Joints, Name, Pid, Secret, SideName, Text

__all__ = [
    "Abandon",
    "Acquire",
    "Cancel",
    "CheckFollow",
    "CloseStream",
    "Command",
    "Disable",
    "DisableLift",
    "DriveChassis",
    "DriveLift",
    "Enable",
    "Estop",
    "Follow",
    "Hold",
    "LeaveEndpoint",
    "Move",
    "MovePose",
    "Notice",
    "OnLimitName",
    "OnLossName",
    "OpenStream",
    "Recover",
    "RefusalMessage",
    "RegisterEndpoint",
    "Release",
    "Reply",
    "Request",
    "SetGripper",
    "SideName",
    "SpaceName",
    "Stop",
    "StopChassis",
    "StopLift",
    "Take",
    "Target",
]

SpaceName = Literal["joint", "pose"]
OnLossName = Literal["hold", "pause"]
OnLimitName = Literal["reject", "clip"]

# ------------------------------------------------------------------------------------------------------- going in


class Acquire(Incoming, frozen=True):
    """Ask for the lease when it is free. Reply: `epoch`."""

    name: Name
    pid: Pid
    on_loss: OnLossName = "hold"


class Take(Incoming, frozen=True):
    """Take the lease from its owner, for people; brakes first. Reply: `epoch`."""

    name: Name
    pid: Pid
    reason: Text
    on_loss: OnLossName = "hold"


class Release(Incoming, frozen=True):
    """Give the lease back: brake, rest, heartbeat 0.0."""

    epoch: Count


class Abandon(Incoming, frozen=True):
    """Leave as if the client had vanished: brake and hold, the clocks run."""

    epoch: Count


class Enable(Incoming, frozen=True):
    """Bring the FSM to READY; the outcome is in the snapshot."""

    epoch: Count


class Disable(Incoming, frozen=True):
    """Brake to rest, then heartbeat 0.0; the lease stays."""

    epoch: Count


class Move(Incoming, frozen=True):
    """Point to point; all joints of all named arms end together. Reply: `motion_id`, `clipped`.

    Attributes:
        epoch: Lease epoch.
        targets_rad: Per side seven joints [rad]; offsets from the reference when `relative`.
        relative: Whether the targets are offsets.
        speed: Factor on velocity, 0 < speed <= 1.
        tolerance_rad: Settling tolerance [rad]; null for the configured one.
        on_limit: What happens to a target outside the limits.
    """

    epoch: Count
    targets_rad: dict[SideName, Joints]
    relative: bool = False
    speed: float = 1.0
    tolerance_rad: float | None = None
    on_limit: OnLimitName = "reject"


class MovePose(Incoming, frozen=True):
    """Point to point for end effectors; all named arms end together. Reply: `motion_id`, `values`, `clipped`.

    Attributes:
        epoch: Lease epoch.
        targets: Per side x, y, z [m], qx, qy, qz, qw.
        frames: Per side the frame of its target: the arm's own shoulder (manual §4.0.1).
        speed: Factor on the velocities, 0 < speed <= 1.
        tolerance_m: Settling tolerance of the position [m]; null for the configured one.
        tolerance_rad: Settling tolerance of the orientation [rad]; null for the configured one.
        on_limit: What happens to a position beyond the reach.
        straight: Whether an arm in joint mode goes straight, too; else its joints go as they like. Working that out takes some
            tenths of a second, in which the motion is `queued`.
    """

    epoch: Count
    targets: dict[SideName, Joints]
    frames: dict[SideName, Name]
    speed: float = 1.0
    tolerance_m: float | None = None
    tolerance_rad: float | None = None
    on_limit: OnLimitName = "reject"
    straight: bool = False


class OpenStream(Incoming, frozen=True):
    """Open a stream of targets for one arm. Reply: `stream_id`, `values` (where it starts).

    Attributes:
        epoch: Lease epoch.
        side: Which arm.
        space: Of the targets: `joint`, or `pose` for an arm in end-effector mode.
        frame: Of poses: the arm's own shoulder (manual §4.0.1); empty for joints.
        speed: Factor on velocity, 0 < speed <= 1.
        on_limit: What happens to a target outside the limits.
        expiry_ns: Life of a target [ns]; null for the configured one.
    """

    epoch: Count
    side: SideName
    space: SpaceName = "joint"
    frame: Text = ""
    speed: float = 1.0
    on_limit: OnLimitName = "reject"
    expiry_ns: Count | None = None


class CloseStream(Incoming, frozen=True):
    """End a stream: brake to rest and hold."""

    epoch: Count
    stream_id: Count


class Hold(Incoming, frozen=True):
    """Brake the named arms and hold; their motions end as cancelled."""

    epoch: Count
    sides: Annotated[tuple[SideName, ...], Meta(max_length=8)]


class Cancel(Incoming, frozen=True):
    """Brake and end one motion."""

    epoch: Count
    motion_id: Count


class Stop(Incoming, frozen=True, forbid_unknown_fields=False):
    """Stop everything. Anybody may; latches unless the owner asks. Reply: `stop_undelivered`.

    Unknown fields do not matter: a stop is never refused for what a later release adds to it.
    """

    reason: str = ""


class Estop(Incoming, frozen=True, forbid_unknown_fields=False):
    """Stop everything and pause the FSM. Anybody may; always latches. Does not replace the physical emergency stop."""

    reason: str = ""


class Recover(Incoming, frozen=True, omit_defaults=True):
    """Clear all latches, or none when a cause persists. Never moves, never enables.

    A reason lets silent stop endpoints go. Reply: `cleared`, `dismissed`.
    """

    reason: Text = ""


class RegisterEndpoint(Incoming, frozen=True):
    """Promise to be heard: the robot is held, or paused, while this client is not. Reply: `endpoint_id`."""

    name: Name
    timeout_ns: Count
    on_silence: OnLossName = "hold"


class LeaveEndpoint(Incoming, frozen=True):
    """Take that promise back."""


Request = (
    Acquire
    | Take
    | Release
    | Abandon
    | Enable
    | Disable
    | Move
    | Follow
    | CheckFollow
    | MovePose
    | OpenStream
    | CloseStream
    | Hold
    | Cancel
    | SetGripper
    | DriveChassis
    | StopChassis
    | DriveLift
    | StopLift
    | DisableLift
    | Stop
    | Estop
    | Recover
    | RegisterEndpoint
    | LeaveEndpoint
)


class Command(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A request in its envelope: the payload of a query on the command key.

    Attributes:
        version: `PROTOCOL_VERSION` of the sender.
        client_id: Unique per client; the same as in its liveliness token, keepalives and targets.
        secret: What proves that `client_id` is this client, from its first command on; no snapshot shows it.
        request_id: Unique per client. The same id again gets the first reply again: a lost reply can be asked for.
        request: What is asked.
    """

    version: Count
    client_id: ClientId
    secret: Secret = ""
    request_id: Count
    request: Request


class Target(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The newest target of a stream: the payload of a put on the target key. The newest wins; none is answered.

    Attributes:
        epoch: Lease epoch.
        seq: Strictly rising per stream.
        values: In the space of the stream: seven joints [rad], or x, y, z [m], qx, qy, qz, qw.
    """

    epoch: Count
    seq: Count
    values: Joints


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
        facts: What the caller needs to go on, e.g. `epoch`, `motion_id`, `stream_id`, `values`, `clipped`.
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
