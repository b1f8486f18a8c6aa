"""What the outside may see of the engine, as plain frozen values: published at 50 Hz, shown by every viewer.

Ages are given at `at_ns` of the daemon's monotonic clock. Field names are the wire's: `api/protocol.py` has a struct of
the same shape for each class here (a test compares them).
"""

from __future__ import annotations

from dataclasses import dataclass

from gateway.values import Vector

__all__ = [
    "ArmView",
    "EnableView",
    "LeaseView",
    "LinkView",
    "LoopView",
    "ModeView",
    "MotionView",
    "MotorView",
    "Snapshot",
    "StreamView",
    "TargetView",
    "TopicView",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkView:
    """The robot's side: is there a transport, is the state fresh.

    Attributes:
        up: Whether a transport to the robot's router is open.
        router_zid: Its zenoh id; empty when down.
        fresh: Whether the newest fast state topic is at most 100 ms old.
        age_ns: Age of the newest fast state topic [ns]; None before the first sample.
    """

    up: bool
    router_zid: str
    fresh: bool
    age_ns: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeView:
    """`/api/current_mode` (manual §4.11.2), per side keyed `left`, `right`."""

    api: bool
    joint_mode: dict[str, bool]
    arm_enabled: dict[str, bool]
    chassis_enabled: bool
    lift_enabled: bool
    collision_check: bool
    age_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class LeaseView:
    """Who owns the robot.

    Attributes:
        owned: Whether somebody does.
        name: Owner's name; empty when unowned.
        client_id: Owner's client id; empty when unowned.
        pid: Owner's process id; 0 when unowned.
        epoch: Current epoch; commands of another one are refused.
        since_ns: When the lease was given (daemon clock) [ns]; 0 when unowned.
        on_loss: `hold` or `pause`.
        lost_ns: How long the owner has been silent beyond the keepalive limit [ns]; None while it is alive.
        free_in_ns: Time until the lease is free [ns]; None when no clock runs.
        down_in_ns: Time until everything goes down [ns]; None when no clock runs.
    """

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


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorView:
    """Measured motors: position [rad], velocity [rad/s], torque [N·m], robot stamp [ns], age [ns]."""

    q_rad: Vector
    dq_radps: Vector
    tau_nm: Vector
    stamp_ns: int
    age_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmView:
    """One arm.

    Attributes:
        measured: Joint state; None before the first sample.
        p_m: Measured end-effector position in the arm's shoulder frame [m]; empty when unknown.
        quat_xyzw: Measured end-effector orientation; empty when unknown.
        pose_age_ns: Age of that pose [ns]; None when unknown.
        q_ref_rad: The last setpoint [rad]; empty while the stream is off.
        dq_ref_radps: Its velocity [rad/s].
        streaming: Whether setpoints are being sent.
        tracking_rad: Largest joint distance between setpoint and measured [rad]; None while off.
    """

    measured: MotorView | None
    p_m: Vector
    quat_xyzw: Vector
    pose_age_ns: int | None
    q_ref_rad: Vector
    dq_ref_radps: Vector
    streaming: bool
    tracking_rad: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicView:
    """A state topic: age [ns] (None before the first sample), measured rate [Hz], worst gap in the last 10 s [ns], counters."""

    age_ns: int | None
    rate_hz: float
    worst_gap_ns: int
    count: int
    duplicates: int
    refused: int


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamView:
    """A command stream: is it running, frames sent, measured rate [Hz], worst gap while running in the last 10 s [ns]."""

    running: bool
    sent: int
    rate_hz: float
    worst_gap_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetView:
    """A stream of the owner's targets.

    Attributes:
        stream_id: As in the reply to the opening.
        side: `left` or `right`.
        open: Whether targets are still taken.
        code: Why it ended; empty while open.
        seq: Sequence number of the last accepted target; 0 before the first.
        refused: How many targets were refused.
        refusal_code: Code of the last refusal; empty when none.
        refusal_message: Its message.
        limited: Whether the reference lags because the targets ask for more than the limits allow.
    """

    stream_id: int
    side: str
    open: bool
    code: str
    seq: int
    refused: int
    refusal_code: str
    refusal_message: str
    limited: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionView:
    """A point-to-point motion.

    Attributes:
        motion_id: As in the reply.
        sides: Arms that take part.
        state: `queued`, `executing`, `reached`, `cancelled`, `superseded` or `aborted`.
        progress: Part of the path's duration that is behind us, 0..1.
        error_rad: Largest measured joint distance to the goal [rad]; None before the first sample.
        duration_ns: Planned duration [ns].
        code: Why it ended otherwise than by reaching; empty else.
        message: The same in words.
    """

    motion_id: int
    sides: tuple[str, ...]
    state: str
    progress: float
    error_rad: float | None
    duration_ns: int
    code: str
    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class EnableView:
    """The latest `enable`: which attempt, `none`, `running`, `ok` or `failed`, and why it failed."""

    attempt: int
    outcome: str
    code: str
    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopView:
    """The control loop: ticks run, periods skipped, latest and worst lateness in the last 10 s [ns]."""

    ticks: int
    skipped: int
    late_ns: int
    worst_late_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """All of it at one instant.

    Attributes:
        seq: Rises by one with each snapshot.
        at_ns: Daemon monotonic clock [ns].
        state: Supervisor state, e.g. `ACTIVE`.
        shown: What a person should read: ESTOP or FAULT when latched, else the state.
        latches: Causes with their messages.
        fsm: Raw `/fsm_state`; None when unknown (older than 0.5 s).
        motions: The running motions and the latest ended ones, oldest first.
        targets: Open streams of targets and the latest ended ones.
    """

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
    enable: EnableView
    loop: LoopView
