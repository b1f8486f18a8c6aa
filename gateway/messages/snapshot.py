"""What the outside may see of the engine, as plain frozen values: published at 50 Hz, shown by every viewer.

Ages are given at `at_ns` of the daemon's monotonic clock. The engine makes them, the wire carries them, the client wraps
them. A reader ignores fields that it does not know; fields that came later have a default, for snapshots of an earlier
daemon, and the engine says every one of them all the same.
"""

from __future__ import annotations

from msgspec import Struct

from gateway.messages.body_views import ContactView, ModelView, SlowingView, SpacingView, TouchView
from gateway.messages.ground_views import ChassisView, GripView, LiftView
from gateway.values import Vector

__all__ = [
    "ArmView",
    "ChassisView",
    "ContactView",
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
    "RefusalMessage",
    "SlowingView",
    "Snapshot",
    "SpacingView",
    "StreamView",
    "TargetView",
    "TopicView",
    "TouchView",
]


class LinkView(Struct, frozen=True, kw_only=True):
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


class OtherView(Struct, frozen=True, kw_only=True):
    """Somebody else who commands the robot, or could.

    Attributes:
        kind: `data` (sends on a command topic), `token` (a ROS bridge announces it), `publisher` (declared on zenoh) or
            `gateway`.
        topic: Command topic; empty for a gateway.
        zid: Zenoh id of the session; empty when it does not name itself.
        link: Its address as the robot's router sees it; empty when unknown.
        since_ns: Since when it has been there (daemon clock) [ns].
        last_ns: Arrival of its last sample [ns]; None where it is not data.
        count: Samples that came; 0 where it is not data.
        armed: For a gateway, whether it commands the robot or is about to.
    """

    kind: str
    topic: str
    zid: str
    link: str
    since_ns: int
    last_ns: int | None
    count: int
    armed: bool


class OthersView(Struct, frozen=True, kw_only=True):
    """Us beside others on the robot (manual §3.3.2).

    Attributes:
        zid: Zenoh id of our own session; empty before the first link.
        armed: Whether other gateways have been shown that we command the robot, and none was first.
        seen: Who else commands the robot, or could; empty is the rule.
    """

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
    """A stop endpoint: its period, what its silence does (`hold`, `pause`), and how long ago it was heard [ns]."""

    endpoint_id: int
    name: str
    timeout_ns: int
    on_silence: str
    age_ns: int
    is_silent: bool


class LeaseView(Struct, frozen=True, kw_only=True):
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


class MotorView(Struct, frozen=True, kw_only=True):
    """Measured motors: position [rad], velocity [rad/s], torque [N·m], robot stamp [ns], age [ns]."""

    q_rad: Vector
    dq_radps: Vector
    tau_nm: Vector
    stamp_ns: int
    age_ns: int


class ArmView(Struct, frozen=True, kw_only=True):
    """One arm.

    Attributes:
        measured: Joint state; None before the first sample.
        p_m: Measured end-effector position in the arm's shoulder frame [m]; empty when unknown.
        quat_xyzw: Measured end-effector orientation; empty when unknown.
        pose_age_ns: Age of that pose [ns]; None when unknown.
        space: `joint` or `pose`: what its setpoints are, as the robot said when the stream was last chosen.
        q_ref_rad: The last setpoint of joints [rad]; empty while their stream is off.
        dq_ref_radps: Its velocity [rad/s].
        ref_p_m: Position of the last setpoint of the end effector [m]; empty while that stream is off.
        ref_quat_xyzw: Its orientation.
        ref_v_mps: Its linear velocity [m/s].
        ref_w_radps: Its angular velocity [rad/s].
        streaming: Whether setpoints are being sent.
        tracking_rad: Largest joint distance, or the angle, between setpoint and measured [rad]; None while off.
        tracking_m: Distance between setpoint and measured position [m]; None while off, and for joints.
        model: How far the body model agrees with it; None where the configuration has no model.
        contact: What pulls at it; None where the configuration asks for no dynamics.
        touch: The last touch that ended what moved it; None before the first.
        guard_n: At what force on the hand whatever moves it is ended (section [model]) [N]; 0 for none.
    """

    measured: MotorView | None
    p_m: Vector
    quat_xyzw: Vector
    pose_age_ns: int | None
    q_ref_rad: Vector
    dq_ref_radps: Vector
    streaming: bool
    tracking_rad: float | None
    space: str = "joint"
    ref_p_m: Vector = ()
    ref_quat_xyzw: Vector = ()
    ref_v_mps: Vector = ()
    ref_w_radps: Vector = ()
    tracking_m: float | None = None
    model: ModelView | None = None
    contact: ContactView | None = None
    touch: TouchView | None = None
    guard_n: float = 0.0


class TopicView(Struct, frozen=True, kw_only=True):
    """A state topic: age [ns] (None before the first sample), measured rate [Hz], worst gap in the last 10 s [ns], counters."""

    age_ns: int | None
    rate_hz: float
    worst_gap_ns: int
    count: int
    duplicates: int
    refused: int


class StreamView(Struct, frozen=True, kw_only=True):
    """A command stream: is it running, frames sent, measured rate [Hz], worst gap while running in the last 10 s [ns]."""

    running: bool
    sent: int
    rate_hz: float
    worst_gap_ns: int


class TargetView(Struct, frozen=True, kw_only=True):
    """A stream of the owner's targets.

    Attributes:
        stream_id: As in the reply to the opening.
        side: `left` or `right`.
        space: `joint` or `pose`.
        open: Whether targets are still taken.
        code: Why it ended; empty while open.
        seq: Sequence number of the last accepted target; 0 before the first.
        refused: How many targets were refused.
        refusal_code: Code of the last refusal; empty when none.
        refusal_message: Its message.
        limited: Whether the reference lags because the targets ask for more than the limits allow.
        lead_ns: By how much the last accepted target came before the instant of the next setpoint, which was the first to
            follow it [ns]; negative when that setpoint was late itself. None before the first target that was followed.
        touch: The touch that ended it; None else.
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
    space: str = "joint"
    lead_ns: int | None = None
    touch: TouchView | None = None


class MotionView(Struct, frozen=True, kw_only=True):
    """A point-to-point motion.

    Attributes:
        motion_id: As in the reply.
        sides: Arms that take part.
        space: `joint` or `pose`.
        state: `queued`, `executing`, `reached`, `touched`, `cancelled`, `superseded` or `aborted`.
        progress: Part of the path's duration that is behind us, 0..1.
        error_rad: Largest measured joint distance, or angle, to the goal [rad]; None before the first sample.
        error_m: Largest measured distance to the goal [m]; None before the first sample, and for joints.
        duration_ns: Planned duration [ns].
        code: Why it ended otherwise than by reaching; empty else.
        message: The same in words.
        touch: The touch that ended it; None else.
    """

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
    touch: TouchView | None = None


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
    """Why the robot does not do what it is told, inferred: since when [ns], and numbers with units in their names."""

    code: str
    message: str
    hint: str
    since_ns: int
    facts: dict[str, float]


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


class Snapshot(Struct, frozen=True, kw_only=True):
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
        findings: What seems to keep the robot from doing what it is told; empty when all is well.
        refusals: What the owner would be refused now, by kind of request (`enable`, `left_arm`, `chassis` ...), and why.
        grips: What the grippers are told; what their motors do is in `grippers`.
        drive: What the chassis is told.
        lift: What the lift is told; None on a model without one.
        others: Who else commands the robot, or could.
        spacing: How near parts of the body are to each other; None where nobody asked for them to be kept apart.
        slowing: Arms whose poses are streamed now, keyed `left`, `right`: how near a singularity each is.
        endpoints: Stop endpoints: who must be heard, or the robot is held.
        settings_read_ns: When the settings file was last read anew [ns]; 0 when it was not since the start.
        settings_refused: Why nothing of it was taken then; empty when it was.
        refused: How many requests were refused since the daemon's start, by code.
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
    grips: dict[str, GripView]
    drive: ChassisView
    lift: LiftView | None
    enable: EnableView
    loop: LoopView
    findings: tuple[Finding, ...]
    refusals: dict[str, RefusalMessage]
    guard: GuardView
    others: OthersView
    spacing: SpacingView | None = None
    slowing: dict[str, SlowingView] = {}
    endpoints: tuple[EndpointView, ...] = ()
    settings_read_ns: int = 0
    settings_refused: str = ""
    refused: dict[str, int] = {}
