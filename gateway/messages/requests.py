"""What clients may ask for: one definition for user code, the wire and the engine. Frozen values, strict, not yet judged.

Rules
    * What goes in is strict: unknown fields, unknown types and oversized values are refused, because to ignore half of a
      demand is dangerous. Only `stop` and `estop` take whatever a later release adds, and reasons of any length.
    * Decoding checks form only: lengths, limits and finiteness are judged later, with value, bound and remedy.
    * What only an owner may ask for carries the epoch of the lease under which it is made.
"""

from __future__ import annotations

from typing import Annotated, TypeAlias

from msgspec import Meta, field

from gateway.messages.incoming import (
    Admittance,
    Count,
    Incoming,
    IncomingMotion,
    Joints,
    Name,
    Offset,
    OnLimit,
    OnLoss,
    Pid,
    Points,
    Text,
    Times,
    Tolerances,
)
from gateway.messages.load_requests import SetPayload, Weigh
from gateway.values import Side, Space

__all__ = [
    "Abandon",
    "Acquire",
    "Cancel",
    "CheckFollow",
    "CloseStream",
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
    "OpenStream",
    "Recover",
    "RegisterEndpoint",
    "Release",
    "Request",
    "SetGripper",
    "SetPayload",
    "Stop",
    "StopChassis",
    "StopLift",
    "Take",
    "Weigh",
]


class Acquire(Incoming, frozen=True, kw_only=True):
    """Ask for the lease when it is free. `pid` and `name` are shown to others. Reply: `epoch`."""

    name: Name
    pid: Pid
    on_loss: OnLoss = OnLoss.HOLD


class Take(Incoming, frozen=True, kw_only=True):
    """Take the lease from its owner, for people; brakes first. Reply: `epoch`."""

    name: Name
    pid: Pid
    reason: Text
    on_loss: OnLoss = OnLoss.HOLD


class Release(Incoming, frozen=True, kw_only=True):
    """Give the lease back: brake, rest, heartbeat 0.0."""

    epoch: Count


class Abandon(Incoming, frozen=True, kw_only=True):
    """Leave as if the client had vanished: brake and hold, the clocks run."""

    epoch: Count


class Enable(Incoming, frozen=True, kw_only=True):
    """Bring the FSM to READY; the outcome is seen in the snapshot."""

    epoch: Count


class Disable(Incoming, frozen=True, kw_only=True):
    """Brake to rest, then heartbeat 0.0; the lease stays."""

    epoch: Count


class Move(IncomingMotion, frozen=True, kw_only=True):
    """Point to point, all joints of all named arms ending together. Reply: `motion_id`, `clipped`.

    Attributes:
        epoch: Lease epoch.
        targets_rad: Per side seven joints [rad]; offsets from the reference when `relative`.
        relative: Whether the targets are offsets.
        speed: Factor on velocity, 0 < speed <= 1.
        tolerance_rad: Settling tolerance [rad]; None for the configured one.
        on_limit: Reject or clip.
    """

    epoch: Count
    targets_rad: dict[Side, Joints]
    relative: bool = False
    speed: float = 1.0
    tolerance_rad: float | None = None
    on_limit: OnLimit = OnLimit.REJECT


class Follow(IncomingMotion, frozen=True, kw_only=True):
    """Follow a trajectory or an action chunk with one or both arms, on one clock.

    Reply: `motion_id`, `duration_ns`, `begins_ns`, `skipped` (points whose time had passed), `moved` (by smoothing).

    Attributes:
        epoch: Lease epoch.
        points: Per side 2 to 450 points, both sides as many: seven joints [rad], or x, y, z [m], qx, qy, qz, qw.
        space: Of the points.
        frames: For poses, per side the frame they are in: the arm's own shoulder (manual §4.0.1).
        dt_s: Time from point to point [s]; the first is passed at 0. Either this or `times_s`.
        times_s: When each point is passed, rising, from 0 on [s].
        stretch: Factor by which all of it becomes slower, 1 to 100.
        smoothing_s: Jitter is averaged over so much time on each side of a point [s]; needs `dt_s`.
        open_end: Whether it ends at speed, with a successor to come; else it ends at rest at its last point.
        start_at_ns: When its time is 0, on the monotonic clock of the daemon's host [ns]; None for `start_in_ns`.
        start_in_ns: The same, counted from the arrival of the request [ns], negative for the past; None for now.
        path_tolerance: Per arm seven tolerances on the way [rad], for poses two [m, rad]; None where there is none.
        goal_tolerance: The same at the end; None for the configured one.
        goal_time_ns: How long after its end it may settle [ns]; None for the configured time.
    """

    epoch: Count
    points: dict[Side, Points]
    space: Space = Space.JOINT
    frames: dict[Side, Name] = field(default_factory=dict)
    dt_s: float | None = None
    times_s: Times | None = None
    stretch: float = 1.0
    smoothing_s: float = 0.0
    open_end: bool = False
    start_at_ns: Count | None = None
    start_in_ns: Offset | None = None
    path_tolerance: dict[Side, Tolerances] = field(default_factory=dict)
    goal_tolerance: dict[Side, Tolerances] = field(default_factory=dict)
    goal_time_ns: Count | None = None


class CheckFollow(Incoming, frozen=True, kw_only=True):
    """Judge a trajectory or a chunk as `Follow` would, and move nothing. Anybody may ask; it needs no lease.

    What is not judged is whether the robot may move now (the refusals of the snapshot say that), and whether the arms can
    get onto a trajectory that begins at speed. Reply: `duration_ns`, `skipped`, `moved`, and `away`: per side how far it
    begins from where the arm is, per joint [rad] or position and orientation [m, rad].

    Attributes:
        follow: The request to be judged, whatever its epoch.
        from_here: Whether it must also begin near enough to where the arms are now.
    """

    follow: Follow
    from_here: bool = True


class MovePose(IncomingMotion, frozen=True, kw_only=True):
    """Point to point for end effectors, position and orientation of all named arms ending together.

    Arms in end-effector mode go straight; those in joint mode by the body model, straight or as their joints like. Working
    that out takes some tenths of a second, in which the motion is `queued`. Reply: `motion_id`, `values`, `clipped`.

    Attributes:
        epoch: Lease epoch.
        targets: Per side x, y, z [m], qx, qy, qz, qw.
        frames: Per side the frame of its target: the arm's own shoulder (manual §4.0.1).
        speed: Factor on the velocities, 0 < speed <= 1.
        tolerance_m: Settling tolerance of the position [m]; None for the configured one.
        tolerance_rad: Settling tolerance of the orientation [rad]; None for the configured one.
        on_limit: Reject, or move a position beyond the reach to its end.
        straight: Whether an arm in joint mode goes straight, too; else its joints go as they like.
    """

    epoch: Count
    targets: dict[Side, Joints]
    frames: dict[Side, Name]
    speed: float = 1.0
    tolerance_m: float | None = None
    tolerance_rad: float | None = None
    on_limit: OnLimit = OnLimit.REJECT
    straight: bool = False


class OpenStream(IncomingMotion, frozen=True, kw_only=True):
    """Open a stream of targets for one arm, of joints or of poses; it starts at the present reference.

    Reply: `stream_id`, `values` (where it starts).

    Attributes:
        epoch: Lease epoch.
        side: Which arm.
        space: Of the targets.
        frame: Of poses: the arm's own shoulder (manual §4.0.1); empty for joints.
        speed: Factor on velocity, 0 < speed <= 1.
        on_limit: Reject or clip.
        expiry_ns: Life of a target [ns]; None for the configured one.
        admittance: How the hand yields around the targets, of poses, while they come; None where it goes to them.
    """

    epoch: Count
    side: Side
    space: Space = Space.JOINT
    frame: Text = ""
    speed: float = 1.0
    on_limit: OnLimit = OnLimit.REJECT
    expiry_ns: Count | None = None
    admittance: Admittance | None = None


class CloseStream(Incoming, frozen=True, kw_only=True):
    """End a stream: brake to rest and hold."""

    epoch: Count
    stream_id: Count


class Hold(Incoming, frozen=True, kw_only=True):
    """Brake the named arms and hold; ends their motions as cancelled."""

    epoch: Count
    sides: Annotated[tuple[Side, ...], Meta(max_length=8)]


class Cancel(Incoming, frozen=True, kw_only=True):
    """Brake and end one motion."""

    epoch: Count
    motion_id: Count


class SetGripper(Incoming, frozen=True, kw_only=True):
    """Send a gripper another force input, until a later one. Its arm must be enabled (manual §4.4).

    Reply: `raw`, `torque_nm`.

    Attributes:
        epoch: Lease epoch.
        side: Which gripper.
        raw: 0 (opens most) to 1 (closes most); 0.1 is no torque.
    """

    epoch: Count
    side: Side
    raw: float


class DriveChassis(Incoming, frozen=True, kw_only=True):
    """Drive the chassis at a velocity for a while; a later one replaces it. The chassis ramps there and, at its end, to rest.

    Reply: `drive_id`.

    Attributes:
        epoch: Lease epoch.
        vx_mps: Along x [m/s].
        vy_mps: Along y [m/s].
        wz_radps: Around z [rad/s].
        expiry_ns: How long without a successor [ns]; None for the configured time.
        drive_id: 0 begins a drive; the number of one goes on with it, and is refused when something has ended it.
    """

    epoch: Count
    vx_mps: float
    vy_mps: float
    wz_radps: float
    expiry_ns: Count | None = None
    drive_id: Count = 0


class StopChassis(Incoming, frozen=True, kw_only=True):
    """Zeros for the chassis at once; it brakes as quickly as it can."""

    epoch: Count


class DriveLift(Incoming, frozen=True, kw_only=True):
    """Drive the lift at a velocity for a while; a later one replaces it. At its end it stops, its servo stays on.

    Reply: `drive_id`.

    Attributes:
        epoch: Lease epoch.
        velocity: Part of full speed, -1 (down) to 1 (up).
        expiry_ns: How long without a successor [ns]; None for the configured time.
        drive_id: 0 begins a drive; the number of one goes on with it, and is refused when something has ended it.
    """

    epoch: Count
    velocity: float
    expiry_ns: Count | None = None
    drive_id: Count = 0


class StopLift(Incoming, frozen=True, kw_only=True):
    """Stop the lift at once; its servo stays on."""

    epoch: Count


class DisableLift(Incoming, frozen=True, kw_only=True):
    """Stop the lift, then take its servo off."""

    epoch: Count


class Stop(Incoming, frozen=True, kw_only=True, forbid_unknown_fields=False):
    """Stop everything. Anybody may; latches unless the owner asks. Reply: `stop_undelivered`."""

    reason: str = ""


class Estop(Incoming, frozen=True, kw_only=True, forbid_unknown_fields=False):
    """Stop everything and pause the FSM. Anybody may; latches; the grip is lost. It replaces no physical emergency stop."""

    reason: str = ""


class Recover(Incoming, frozen=True, kw_only=True, omit_defaults=True):
    """Clear all latches, or none when a cause persists. Never moves, never enables.

    A reason lets silent stop endpoints go. Reply: `cleared`, `dismissed`.
    """

    reason: Text = ""


class RegisterEndpoint(Incoming, frozen=True, kw_only=True):
    """Promise to be heard: the robot is held, or paused, while this client is not. Anybody may. Reply: `endpoint_id`.

    Attributes:
        name: Shown to others.
        timeout_ns: Its period [ns]: it is silent when it was not heard for longer.
        on_silence: What its silence does.
    """

    name: Name
    timeout_ns: Count
    on_silence: OnLoss = OnLoss.HOLD


class LeaveEndpoint(Incoming, frozen=True, kw_only=True):
    """Take that promise back."""


Request: TypeAlias = (
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
    | SetPayload
    | Weigh
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
