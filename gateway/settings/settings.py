"""Frozen settings: one value per section, defaults from the project's behaviour table. Parsing lives in `toml_file.py`.

Those of the groups that move are in `motion.py`. Every field has its unit in its name. Times are integer
nanoseconds inside; the TOML file has seconds or milliseconds.
A settings object that exists is inside the hard limits of `robot/limits.py`: constructors refuse anything looser.
"""

from __future__ import annotations

import re

from msgspec import Struct, field

from gateway.robot.limits import HARD_V_RADPS, TOUCH_N
from gateway.robot.topics import VARIANTS, Variant
from gateway.settings.bounds import HARD, MS, OURS, S, SettingsRefused, within
from gateway.settings.motion import ArmSettings, ChassisSettings, LiftSettings, PoseSettings
from gateway.values import Side

__all__ = [
    "ArmSettings",
    "ChassisSettings",
    "EnableSettings",
    "ForeignSettings",
    "GuardSettings",
    "LiftSettings",
    "LinkSettings",
    "LocalSettings",
    "LossSettings",
    "ModelSettings",
    "PoseSettings",
    "RealtimeSettings",
    "Settings",
    "SettingsRefused",
]

ENDPOINT = re.compile(r"(tcp|udp|tls|quic|ws)/(\[[0-9A-Fa-f:.]+(?:%[\w.-]+)?\]|[^\s\[\]/:?#]+):([0-9]{1,5})([?#]\S*)?")
"""zenoh locator of a network address; options of zenoh may follow after `?` or `#`."""

NAMESPACE = re.compile(r"/?[A-Za-z0-9_]+(/[A-Za-z0-9_]+)*")
"""ROS namespace: no wildcard of a zenoh key can hide in it."""

POLICIES = ("hold", "warn")
"""What may be done about foreign writers."""


class LossSettings(Struct, frozen=True, kw_only=True):
    """What happens when the owner vanishes, stage by stage.

    Attributes:
        keepalive_ns: Silence of the client library after which the owner counts as lost [ns].
        free_after_ns: The lease is free this long after the loss [ns].
        down_after_ns: Everything goes down this long after the loss [ns].
    """

    keepalive_ns: int = 250 * MS
    free_after_ns: int = 10 * S
    down_after_ns: int = 60 * S

    def __post_init__(self) -> None:
        """Refuse stages out of order."""
        within("loss.keepalive_ns", self.keepalive_ns, 100 * MS, 250 * MS, "ns", HARD)
        within("loss.free_after_ns", self.free_after_ns, 1 * S, 600 * S, "ns", OURS)
        source = "not before the lease is free"
        within("loss.down_after_ns", self.down_after_ns, self.free_after_ns, 3600 * S, "ns", source)


class EnableSettings(Struct, frozen=True, kw_only=True):
    """Starting, staleness and continuing.

    Attributes:
        timeout_ns: ENABLING ends with ENABLE_TIMEOUT after this [ns].
        stale_ns: No changing frame leaves while the newest state is older than this [ns].
        hold_stale_ns: Constant hold frames at rest go on this long when stale; a stall shorter than this is short [ns].
        fsm_valid_ns: `/fsm_state` older than this is unknown [ns].
        mode_valid_ns: `/api/current_mode` older than this is unknown [ns].
        seed_ns: Duration of good samples demanded before a stream is seeded [ns].
        seed_lag_ns: A good sample's stamp lag is at most this above its running minimum [ns].
        zero_timeout_ns: 0.0 is repeated at most this long when FSM 0 is not seen [ns].
        late_ns: A tick later than this is skipped [ns].
    """

    timeout_ns: int = 10 * S
    stale_ns: int = 100 * MS
    hold_stale_ns: int = 800 * MS
    fsm_valid_ns: int = 500 * MS
    mode_valid_ns: int = 3 * S
    seed_ns: int = 300 * MS
    seed_lag_ns: int = 100 * MS
    zero_timeout_ns: int = 2 * S
    late_ns: int = 50 * MS

    def __post_init__(self) -> None:
        """Refuse looser values than the behaviour table."""
        within("enable.timeout_ns", self.timeout_ns, 1 * S, 60 * S, "ns", OURS)
        within("enable.stale_ns", self.stale_ns, 20 * MS, 100 * MS, "ns", "hard bound: a stalled link sends bursts")
        within("enable.hold_stale_ns", self.hold_stale_ns, self.stale_ns, 800 * MS, "ns", HARD)
        # /fsm_state comes at 20 Hz and /api/current_mode at 1 Hz: shorter than two periods would flicker.
        within("enable.fsm_valid_ns", self.fsm_valid_ns, 100 * MS, 500 * MS, "ns", "manual §4.11.1: 20 Hz")
        within("enable.mode_valid_ns", self.mode_valid_ns, 2 * S, 3 * S, "ns", "manual §4.11.2: about 1 Hz")
        within("enable.seed_ns", self.seed_ns, 300 * MS, 5 * S, "ns", HARD)
        within("enable.seed_lag_ns", self.seed_lag_ns, 10 * MS, 100 * MS, "ns", HARD)
        within("enable.zero_timeout_ns", self.zero_timeout_ns, 1 * S, 2 * S, "ns", HARD)
        # The gap invariants hold for ticks up to 20 ms late: such a tick must not be skipped.
        within("enable.late_ns", self.late_ns, 20 * MS, 50 * MS, "ns", HARD)


class LinkSettings(Struct, frozen=True, kw_only=True):
    """The robot's side.

    Attributes:
        endpoint: zenoh endpoint of the robot's router (manual §2.4), e.g. `tcp/192.168.1.20:9000`.
        namespace: Namespace of the robot's bridge, empty for none.
        model: `lite`, `standard` or `lift` (manual §1.2).
        serial: Serial number, which calibrations of this very robot carry (manual A.4); empty when nobody said it.
        lease_ms: Lease announced to the robot's router [ms]: the fence at the robot's end.
    """

    endpoint: str = "tcp/127.0.0.1:9000"
    namespace: str = ""
    model: str = "standard"
    serial: str = ""
    lease_ms: int = 250

    def __post_init__(self) -> None:
        """Refuse an unknown model, a malformed endpoint or a long lease."""
        if self.model not in VARIANTS:
            rule = f"is unknown: one of {', '.join(VARIANTS)}"
            raise SettingsRefused("robot.model", self.model, rule=rule, source="manual §1.2")
        found = ENDPOINT.fullmatch(self.endpoint)
        if found is None or not 1 <= int(found[3]) <= 65535:
            rule = "is no endpoint: tcp/HOST:9000 is the usual form, a port is 1 to 65535"
            raise SettingsRefused("robot.endpoint", self.endpoint, rule=rule, source="manual §2.4")
        if self.namespace and NAMESPACE.fullmatch(self.namespace) is None:
            rule = "is no ROS namespace: words of letters, digits and _, joined by /"
            raise SettingsRefused("robot.namespace", self.namespace, rule=rule)
        if self.serial != self.serial.strip() or not self.serial.isprintable():
            rule = "is no serial number: printable, without spaces around it"
            raise SettingsRefused("robot.serial", self.serial, rule=rule, source="manual A.4")
        within("robot.lease_ms", self.lease_ms, 200, 1000, "ms", "fence against stale setpoints")

    @property
    def variant(self) -> Variant:
        """Facts of the configured model."""
        return VARIANTS[self.model]


class LocalSettings(Struct, frozen=True, kw_only=True):
    """The users' side.

    Attributes:
        socket: Path of the unix socket; empty for the default of this user (see `api.protocol.default_socket`).
        socket_mode: Permission bits of the socket.
        tcp: Further listener `HOST:PORT`, empty for none; it needs users or certificates of clients, beyond loopback TLS.
        tcp_open_to_every_user_of_this_host: Whether a port on loopback asks nobody who he is.
        users_file: zenoh user dictionary (`name:password` a line), empty for none.
        roles_file: Roles of users, or of certificates by their common name (`name:role` a line); empty: all are admins.
        tls_certificate: PEM file of the listener, empty for no TLS.
        tls_private_key: PEM file (PKCS8).
        tls_root_ca: PEM file; when given, clients must show a certificate of it.
        audit_log: File to which each request, who sent it and its answer are appended, as JSON; empty for none.
        audit_log_mb: Size at which it is set aside and begun anew [MB]; five earlier ones are kept.
        snapshot_hz: Rate of published snapshots [Hz].
        demand_stop_endpoint: Whether nothing may move while no stop endpoint is registered.
        black_box: Whether the last minute and the events are written to the disk, and kept when it matters (`ta2 incident`).
    """

    socket: str = ""
    socket_mode: int = 0o660
    tcp: str = ""
    tcp_open_to_every_user_of_this_host: bool = False
    users_file: str = ""
    roles_file: str = ""
    tls_certificate: str = ""
    tls_private_key: str = ""
    tls_root_ca: str = ""
    audit_log: str = ""
    audit_log_mb: int = 16
    snapshot_hz: float = 50.0
    demand_stop_endpoint: bool = False
    black_box: bool = True

    def __post_init__(self) -> None:
        """Refuse rates and modes that make no sense. Listener rules are checked when the listener opens."""
        within("local.audit_log_mb", self.audit_log_mb, 1, 1024, "MB", OURS)
        within("local.snapshot_hz", self.snapshot_hz, 1.0, 100.0, "Hz", OURS)
        if self.socket_mode & ~0o770 or self.socket_mode & 0o600 != 0o600:
            rule = "lets everybody in, or not even the owner: 0o660 or 0o600"
            raise SettingsRefused("local.socket_mode", f"0o{self.socket_mode:o}", rule=rule)


class GuardSettings(Struct, frozen=True, kw_only=True):
    """The process that holds when the daemon cannot.

    Attributes:
        enabled: Whether there is one.
        freeze_ns: A daemon that has not ticked for this long while it commands the robot is ended, and held for [ns].
        hold_ns: A hold that no daemon takes over goes down after this [ns].
    """

    enabled: bool = True
    freeze_ns: int = 80 * MS
    hold_ns: int = 10 * S

    def __post_init__(self) -> None:
        """Refuse a hold that would begin behind the robot's own watchdogs, or last longer than agreed."""
        within("guard.freeze_ns", self.freeze_ns, 40 * MS, 120 * MS, "ns", "arms stop at 150 ms, manual §4.3")
        within("guard.hold_ns", self.hold_ns, 1 * S, 10 * S, "ns", HARD)


class ForeignSettings(Struct, frozen=True, kw_only=True):
    """What is done about others who command the robot (manual §3.3.2).

    Attributes:
        policy: `hold`: they stop us and are waited out; `warn`: they are told of and shown, no more. Another gateway that
            is armed is never fought, whatever this says.
    """

    policy: str = "hold"

    def __post_init__(self) -> None:
        """Refuse a policy that is none."""
        if self.policy not in POLICIES:
            rule = f"is unknown: one of {', '.join(POLICIES)}"
            raise SettingsRefused("foreign.policy", self.policy, rule=rule, source="manual §3.3.2")


class ModelSettings(Struct, frozen=True, kw_only=True):
    """The body model: the live check of it, its numbers, and what it is used for.

    Attributes:
        check: Whether there is a model: FK(joint_states) is compared with `current_ee_pose`, and what needs it may be on.
        position_tolerance_m: Largest median distance of the two at which the model agrees [m].
        angle_tolerance_rad: Largest median angle of the two at which the model agrees [rad].
        window_ns: The medians are over so long [ns].
        urdf: Path of a URDF whose numbers are used in place of our own; empty for our own.
        calibration: Path of this robot's own, as `ta2 identify` writes it; empty for none.
        self_collision: Whether setpoints are kept from driving the body's parts into each other.
        margin_m: What then stays free between any two parts [m].
        singularity_slowdown: Whether streams of poses to an arm in end-effector mode are slowed down near singularities, where
            the robot's own IK would have the joints race. On by default: it can only slow, it never stops an arm, and away
            from singularities it changes nothing.
        singularity_radps: What the fastest joint may have to do then [rad/s]. The default is the hard bound of joint motions,
            so that only what no joint motion could do either is slowed: at full speed every fifth direction of every posture
            there is, few of those that people work in.
        dynamics: Whether efforts are compared with what masses and motion ask for: what pulls at the arms (extra `body`).
        left_touch_n: At what force on the left hand whatever moves that arm is ended [N]; 0 for none. Needs `dynamics`.
        right_touch_n: The same of the right hand [N].
        left_gripper_closed_rad: What the left gripper's motor angle is told as when it is closed [rad]: 0 in manual §4.4.2,
            whose coordinate need not be what is told; §4.8 shows 1.13 where the description ends at 1.
        right_gripper_closed_rad: The same of the right gripper [rad].
    """

    check: bool = True
    position_tolerance_m: float = 0.005
    angle_tolerance_rad: float = 0.02
    window_ns: int = 3 * S
    urdf: str = ""
    calibration: str = ""
    self_collision: bool = False
    margin_m: float = 0.02
    singularity_slowdown: bool = True
    singularity_radps: float = HARD_V_RADPS
    dynamics: bool = False
    left_touch_n: float = 0.0
    right_touch_n: float = 0.0
    left_gripper_closed_rad: float = 0.0
    right_gripper_closed_rad: float = 0.0

    def __post_init__(self) -> None:
        """Refuse tolerances that judge nothing, and a guard without a model."""
        within("model.position_tolerance_m", self.position_tolerance_m, 0.0005, 0.02, "m", OURS)
        within("model.angle_tolerance_rad", self.angle_tolerance_rad, 0.002, 0.1, "rad", OURS)
        within("model.window_ns", self.window_ns, 1 * S, 30 * S, "ns", OURS)
        within("model.margin_m", self.margin_m, 0.02, 0.2, "m", HARD)
        within("model.singularity_radps", self.singularity_radps, 0.3, HARD_V_RADPS, "rad/s", HARD)
        if self.self_collision and not self.check:
            rule = "needs model.check = true: nothing may be kept apart by a model that nobody compares with the robot"
            raise SettingsRefused("model.self_collision", "true", rule=rule)
        if self.dynamics and not self.check:
            rule = "needs model.check = true: nothing is felt by a model that nobody compares with the robot"
            raise SettingsRefused("model.dynamics", "true", rule=rule)
        for side in Side:
            name, force_n = f"model.{side}_touch_n", self.touch_n(side)
            if force_n != 0.0:  # NaN is none of both
                within(name, force_n, *TOUCH_N, "N", "0 for none")
                if not self.dynamics:
                    rule = "needs model.dynamics = true: else nobody feels a touch"
                    raise SettingsRefused(name, force_n, unit="N", rule=rule)
            within(f"model.{side}_gripper_closed_rad", self.gripper_closed_rad(side), -3.2, 3.2, "rad", OURS)

    def gripper_closed_rad(self, side: Side) -> float:
        """Return what a closed gripper's motor angle is told as [rad]."""
        return self.left_gripper_closed_rad if side is Side.LEFT else self.right_gripper_closed_rad

    def touch_n(self, side: Side) -> float:
        """Return at what force on its hand whatever moves an arm is ended [N]; 0 for none."""
        return self.left_touch_n if side is Side.LEFT else self.right_touch_n


class RealtimeSettings(Struct, frozen=True, kw_only=True):
    """Scheduling of the daemon; everything degrades with one clear line when it is not permitted.

    Attributes:
        fifo: Whether to ask for SCHED_FIFO on every thread.
        fifo_priority: Priority of the loop thread; the others get 20 less.
        lock_memory: Whether to lock memory on fault.
        one_core: Whether to keep all threads on one core; only under SCHED_FIFO.
    """

    fifo: bool = True
    fifo_priority: int = 60
    lock_memory: bool = True
    one_core: bool = True

    def __post_init__(self) -> None:
        """Refuse priorities that the kernel does not have."""
        within("realtime.fifo_priority", self.fifo_priority, 21, 90, "", "SCHED_FIFO range")


class Settings(Struct, frozen=True, kw_only=True):
    """Everything a daemon needs to know, frozen."""

    arm: ArmSettings = field(default_factory=ArmSettings)
    chassis: ChassisSettings = field(default_factory=ChassisSettings)
    lift: LiftSettings = field(default_factory=LiftSettings)
    pose: PoseSettings = field(default_factory=PoseSettings)
    loss: LossSettings = field(default_factory=LossSettings)
    enable: EnableSettings = field(default_factory=EnableSettings)
    link: LinkSettings = field(default_factory=LinkSettings)
    local: LocalSettings = field(default_factory=LocalSettings)
    realtime: RealtimeSettings = field(default_factory=RealtimeSettings)
    guard: GuardSettings = field(default_factory=GuardSettings)
    model: ModelSettings = field(default_factory=ModelSettings)
    foreign: ForeignSettings = field(default_factory=ForeignSettings)
