"""What clients may ask for: frozen values, not yet checked against anything.

Every request but the leases' own, `stop`, `estop` and `recover` carries the epoch of the lease under which it is made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TypeAlias

from gateway.core.motion.chunk import Chunk
from gateway.core.motion.tolerance import PerJoint
from gateway.values import Side, Space, Vector

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
    "OnLimit",
    "OnLoss",
    "OpenStream",
    "Recover",
    "RegisterEndpoint",
    "Release",
    "Request",
    "SetGripper",
    "Stop",
    "StopChassis",
    "StopLift",
    "Take",
]


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
class Follow:
    """Follow a trajectory or an action chunk with one or both arms, on one clock.

    Attributes:
        epoch: Lease epoch.
        chunk: The motion through its points (`chunk.prepare`).
        frames: For poses, per side the frame they are in: the arm's own shoulder.
        open_end: Whether it ends at speed, with a successor to come; else it ends at rest at its last point.
        start_at_ns: When its time is 0, on this host's monotonic clock [ns], past or future; None for `start_in_ns`.
        start_in_ns: The same, counted from the arrival of the request [ns], negative for the past; None for now.
        path_tolerance: Per arm seven tolerances on the way [rad], for poses two [m, rad]; None where there is none.
        goal_tolerance: The same at the end; None for the configured one.
        goal_time_ns: How long after its end it may settle [ns]; None for the configured time.
    """

    epoch: int
    chunk: Chunk
    frames: Mapping[Side, str] = field(default_factory=dict)
    open_end: bool = False
    start_at_ns: int | None = None
    start_in_ns: int | None = None
    path_tolerance: Mapping[Side, PerJoint] = field(default_factory=dict)
    goal_tolerance: Mapping[Side, PerJoint] = field(default_factory=dict)
    goal_time_ns: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckFollow:
    """Judge what `Follow` would judge, and move nothing. Anybody may ask, whoever owns the robot, enabled or not.

    Attributes:
        follow: The request to be judged; its epoch does not matter.
        from_here: Whether it must also begin near enough to where the arms are now.
    """

    follow: Follow
    from_here: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class MovePose:
    """Point to point for end effectors, position and orientation of all named arms ending together.

    Arms in end-effector mode go straight; those in joint mode by the body model, straight or as their joints like.

    Attributes:
        epoch: Lease epoch.
        targets: Per side x, y, z [m], qx, qy, qz, qw.
        frames: Per side the frame of its target: the arm's own shoulder.
        speed: Factor on the velocities, 0 < speed <= 1.
        tolerance_m: Settling tolerance of the position [m]; None for the configured one.
        tolerance_rad: Settling tolerance of the orientation [rad]; None for the configured one.
        on_limit: Reject, or move a position beyond the reach to its end.
        straight: Whether an arm in joint mode goes straight, too; else its joints go as they like.
    """

    epoch: int
    targets: Mapping[Side, Vector]
    frames: Mapping[Side, str]
    speed: float = 1.0
    tolerance_m: float | None = None
    tolerance_rad: float | None = None
    on_limit: OnLimit = OnLimit.REJECT
    straight: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenStream:
    """Open a stream of targets for one arm, of joints or of poses; it starts at the present reference.

    Attributes:
        epoch: Lease epoch.
        side: Which arm.
        space: Of the targets.
        frame: Of poses: the arm's own shoulder; empty for joints.
        speed: Factor on velocity, 0 < speed <= 1.
        on_limit: Reject or clip.
        expiry_ns: Life of a target [ns]; None for the configured one.
    """

    epoch: int
    side: Side
    space: Space = Space.JOINT
    frame: str = ""
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
class SetGripper:
    """Send a gripper another force input, until a later one. Its arm must be enabled (manual §4.4).

    Attributes:
        epoch: Lease epoch.
        side: Which gripper.
        raw: 0 (opens most) to 1 (closes most); 0.1 is no torque.
    """

    epoch: int
    side: Side
    raw: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveChassis:
    """Drive the chassis at a velocity for a while; a later one replaces it. The chassis ramps there and, at its end, to rest.

    Attributes:
        epoch: Lease epoch.
        vx_mps: Along x [m/s].
        vy_mps: Along y [m/s].
        wz_radps: Around z [rad/s].
        expiry_ns: How long without a successor [ns]; None for the configured time.
        drive_id: 0 begins a drive; the number of one goes on with it, and is refused when something has ended it.
    """

    epoch: int
    vx_mps: float
    vy_mps: float
    wz_radps: float
    expiry_ns: int | None = None
    drive_id: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class StopChassis:
    """Zeros for the chassis at once; it brakes as quickly as it can."""

    epoch: int


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveLift:
    """Drive the lift at a velocity for a while; a later one replaces it. At its end it stops, its servo stays on.

    Attributes:
        epoch: Lease epoch.
        velocity: Part of full speed, -1 (down) to 1 (up).
        expiry_ns: How long without a successor [ns]; None for the configured time.
        drive_id: 0 begins a drive; the number of one goes on with it, and is refused when something has ended it.
    """

    epoch: int
    velocity: float
    expiry_ns: int | None = None
    drive_id: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class StopLift:
    """Stop the lift at once; its servo stays on."""

    epoch: int


@dataclass(frozen=True, slots=True, kw_only=True)
class DisableLift:
    """Stop the lift, then take its servo off."""

    epoch: int


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
    """Clear all latches, or none when a cause persists. Never moves, never enables. A reason lets silent stop endpoints go."""

    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class RegisterEndpoint:
    """Promise to be heard: the robot is held, or paused, while this client is not. Anybody may.

    Attributes:
        name: Shown to others.
        timeout_ns: Its period [ns]: it is silent when it was not heard for longer.
        on_silence: What its silence does.
    """

    name: str
    timeout_ns: int
    on_silence: OnLoss = OnLoss.HOLD


@dataclass(frozen=True, slots=True, kw_only=True)
class LeaveEndpoint:
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
