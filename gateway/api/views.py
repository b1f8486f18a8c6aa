"""The snapshot as structs: what every viewer of the daemon gets.

Field for field the classes of `core/messages/snapshot.py`, where each is documented (tests compare them); unknown fields are
ignored, so that a later daemon may add some. Ages are given at `at_ns` of the daemon's monotonic clock. Import these
names from `gateway.api.protocol`.
"""

from __future__ import annotations

from msgspec import Struct

__all__ = [
    "ArmView",
    "ChassisView",
    "EnableView",
    "EndpointView",
    "Finding",
    "GripView",
    "GuardView",
    "LeaseView",
    "LiftView",
    "LinkView",
    "LoopView",
    "ModeView",
    "ModelView",
    "MotionView",
    "MotorView",
    "OtherView",
    "OthersView",
    "RefusalView",
    "SlowingView",
    "Snapshot",
    "SpacingView",
    "StreamView",
    "TargetView",
    "TopicView",
]


class LinkView(Struct, frozen=True, kw_only=True):
    """The robot's side: is there a transport, is the state fresh (newest fast topic at most 100 ms old)."""

    up: bool
    router_zid: str
    fresh: bool
    age_ns: int | None


class OtherView(Struct, frozen=True, kw_only=True):
    """Somebody else who commands the robot, or could: `data`, `token`, `publisher` or `gateway`, who, where, since when."""

    kind: str
    topic: str
    zid: str
    link: str
    since_ns: int
    last_ns: int | None
    count: int
    armed: bool


class OthersView(Struct, frozen=True, kw_only=True):
    """Us beside others: our zenoh id, whether our claim to command stands, and who else commands the robot, or could."""

    zid: str
    armed: bool
    seen: tuple[OtherView, ...]


class ModeView(Struct, frozen=True, kw_only=True):
    """`/api/current_mode` (manual §4.11.2), per side keyed `left`, `right`."""

    api: bool
    joint_mode: dict[str, bool]
    arm_enabled: dict[str, bool]
    chassis_enabled: bool
    lift_enabled: bool
    collision_check: bool
    age_ns: int


class EndpointView(Struct, frozen=True, kw_only=True):
    """A stop endpoint: its period, what its silence does, and when it was last heard."""

    endpoint_id: int
    name: str
    timeout_ns: int
    on_silence: str
    age_ns: int
    is_silent: bool


class LeaseView(Struct, frozen=True, kw_only=True):
    """Who owns the robot, under which epoch, and which clocks run after its loss."""

    owned: bool
    name: str
    client_id: str
    pid: int
    epoch: int
    since_ns: int
    on_loss: str
    lost_ns: int | None
    free_in_ns: int | None
    down_in_ns: int | None


class MotorView(Struct, frozen=True, kw_only=True):
    """Measured motors: position [rad], velocity [rad/s], torque [N·m], robot stamp [ns], age [ns]."""

    q_rad: tuple[float, ...]
    dq_radps: tuple[float, ...]
    tau_nm: tuple[float, ...]
    stamp_ns: int
    age_ns: int


class ModelView(Struct, frozen=True, kw_only=True):
    """Whether the body model agrees with an arm: `agrees`, `differs` or `unknown`, why, and by how much (medians)."""

    state: str
    reason: str
    pairs: int
    position_m: float | None
    angle_rad: float | None
    lag_ns: int


class ArmView(Struct, frozen=True, kw_only=True):
    """One arm: measured joints and end-effector pose (shoulder frame, xyzw), reference, distance between them."""

    measured: MotorView | None
    p_m: tuple[float, ...]
    quat_xyzw: tuple[float, ...]
    pose_age_ns: int | None
    q_ref_rad: tuple[float, ...]
    dq_ref_radps: tuple[float, ...]
    streaming: bool
    tracking_rad: float | None
    space: str = "joint"
    ref_p_m: tuple[float, ...] = ()
    ref_quat_xyzw: tuple[float, ...] = ()
    ref_v_mps: tuple[float, ...] = ()
    ref_w_radps: tuple[float, ...] = ()
    tracking_m: float | None = None
    model: ModelView | None = None


class TopicView(Struct, frozen=True, kw_only=True):
    """A state topic: age [ns], measured rate [Hz], worst gap in the last 10 s [ns], counters."""

    age_ns: int | None
    rate_hz: float
    worst_gap_ns: int
    count: int
    duplicates: int
    refused: int


class StreamView(Struct, frozen=True, kw_only=True):
    """A command stream to the robot: running, frames sent, measured rate [Hz], worst gap in the last 10 s [ns]."""

    running: bool
    sent: int
    rate_hz: float
    worst_gap_ns: int


class TargetView(Struct, frozen=True, kw_only=True):
    """A stream of the owner's targets: open or ended (code), last accepted seq, refusals, lagging behind limits."""

    stream_id: int
    side: str
    open: bool
    code: str
    seq: int
    refused: int
    refusal_code: str
    refusal_message: str
    limited: bool
    space: str = "joint"


class MotionView(Struct, frozen=True, kw_only=True):
    """A point-to-point motion: `queued`, `executing`, `reached`, `cancelled`, `superseded` or `aborted`."""

    motion_id: int
    sides: tuple[str, ...]
    state: str
    progress: float
    error_rad: float | None
    duration_ns: int
    code: str
    message: str
    space: str = "joint"
    error_m: float | None = None


class GripView(Struct, frozen=True, kw_only=True):
    """What a gripper is told, and an estimate whether it holds something."""

    streaming: bool
    input_ratio: float | None
    torque_nm: float | None
    holding: bool | None


class ChassisView(Struct, frozen=True, kw_only=True):
    """What the chassis is told; there is no odometry (manual §4.12)."""

    driven: bool
    drive_id: int
    code: str
    wanted_mps: tuple[float, ...]
    wanted_radps: float
    commanded_mps: tuple[float, ...]
    commanded_radps: float
    left_ns: int | None


class LiftView(Struct, frozen=True, kw_only=True):
    """What the lift is told; the robot publishes no position of it (manual §4.12)."""

    driven: bool
    drive_id: int
    code: str
    velocity_ratio: float
    servo_on: bool
    left_ns: int | None


class EnableView(Struct, frozen=True, kw_only=True):
    """The latest `enable`: which attempt, `none`, `running`, `ok` or `failed`, and why it failed."""

    attempt: int
    outcome: str
    code: str
    message: str


class GuardView(Struct, frozen=True, kw_only=True):
    """The guard: shall there be one, its pid (0 for none), does it reach the robot, how many ended, does an earlier hold."""

    expected: bool
    pid: int
    linked: bool
    lost: int
    earlier_holds: bool


class LoopView(Struct, frozen=True, kw_only=True):
    """The control loop: ticks run, periods skipped, latest and worst lateness in the last 10 s [ns]."""

    ticks: int
    skipped: int
    late_ns: int
    worst_late_ns: int


class Finding(Struct, frozen=True, kw_only=True):
    """Why the robot does not do what it is told, inferred: code, sentence, remedy, since when [ns], numbers with units."""

    code: str
    message: str
    hint: str
    since_ns: int
    facts: dict[str, float]


class RefusalView(Struct, frozen=True, kw_only=True):
    """Why a kind of request would be refused now, as the refusal itself would say it."""

    code: str
    message: str
    field: str
    value: str
    bound: str
    unit: str
    hint: str


class SpacingView(Struct, frozen=True, kw_only=True):
    """How near parts of the body are to each other, as measured, and whether arms are kept apart."""

    on: bool
    why: str
    gap_m: float | None
    first: str
    second: str
    margin_m: float
    held: tuple[str, ...]


class SlowingView(Struct, frozen=True, kw_only=True):
    """How near a singularity an arm is whose poses are streamed: the part of the speed limits left, and the joint to blame."""

    on: bool
    why: str
    speed_ratio: float
    held: bool
    joint: int
    joint_radps: float
    bound_radps: float


class Snapshot(Struct, frozen=True, kw_only=True):
    """All of it at one instant; `seq` rises by one with each."""

    seq: int
    at_ns: int
    state: str
    shown: str
    latches: dict[str, str]
    link: LinkView
    fsm: int | None
    mode: ModeView | None
    lease: LeaseView
    arms: dict[str, ArmView]
    grippers: dict[str, MotorView | None]
    chassis: MotorView | None
    topics: dict[str, TopicView]
    streams: dict[str, StreamView]
    motions: tuple[MotionView, ...]
    targets: tuple[TargetView, ...]
    grips: dict[str, GripView]
    drive: ChassisView
    lift: LiftView | None
    enable: EnableView
    loop: LoopView
    findings: tuple[Finding, ...]
    refusals: dict[str, RefusalView]
    guard: GuardView
    others: OthersView
    spacing: SpacingView | None = None
    slowing: dict[str, SlowingView] = {}
    endpoints: tuple[EndpointView, ...] = ()
