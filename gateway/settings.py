"""Frozen settings: one value per section, defaults from the project's behaviour table. Parsing lives in `config.py`.

Every field has its unit in its name. Times are integer nanoseconds inside; the TOML file has seconds or milliseconds.
A settings object that exists is inside the hard limits of `robot.py`: constructors refuse anything looser.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from gateway import robot
from gateway.values import ARM_DOF, Side, Vector

__all__ = [
    "ArmSettings",
    "EnableSettings",
    "LinkSettings",
    "LocalSettings",
    "LossSettings",
    "RealtimeSettings",
    "Settings",
    "SettingsRefused",
]

MS = 1_000_000
S = 1_000_000_000

OURS = "ours"
HARD = "hard bound of the gateway"

ENDPOINT = re.compile(r"(tcp|udp|tls|quic|ws)/(\[[0-9A-Fa-f:.]+(?:%[\w.-]+)?\]|[^\s\[\]/:?#]+):([0-9]{1,5})([?#]\S*)?")
"""zenoh locator of a network address; options of zenoh may follow after `?` or `#`."""

NAMESPACE = re.compile(r"/?[A-Za-z0-9_]+(/[A-Za-z0-9_]+)*")
"""ROS namespace: no wildcard of a zenoh key can hide in it."""

SOCKET_PATH_BYTES = 107
"""Longest path of a unix socket on Linux: `sun_path` has 108 bytes, one of them the final zero."""


class SettingsRefused(ValueError):
    """A setting is looser than the robot's hard limit, or makes no sense. The text has value, bound and unit.

    Attributes:
        name: Section and field, e.g. `arm.v_radps`, with side and index where one number of a list is to blame.
        value: What was asked for.
        bound: Lowest and highest value allowed; None when the setting is no number.
        unit: Unit of value and bound; empty where there is none.
        rule: What is allowed instead, in words; empty when the bound says it all.
        source: Where the rule comes from; empty when the rule speaks for itself.
    """

    def __init__(
        self,
        name: str,
        value: float | str,
        *,
        bound: tuple[float, float] | None = None,
        unit: str = "",
        rule: str = "",
        source: str = "",
    ) -> None:
        super().__init__(name, value)
        self.name = name
        self.value = value
        self.bound = bound
        self.unit = unit
        self.rule = rule
        self.source = source

    def __str__(self) -> str:
        """Return `name = value unit is outside [low, high] unit (source)`, or the rule in place of the bound."""
        unit = f" {self.unit}" if self.unit else ""
        rule = self.rule if self.bound is None else f"is outside {self.bound_text}{unit}"
        source = f" ({self.source})" if self.source else ""
        return f"{self.name} = {self.value!r}{unit} {rule}{source}"

    @property
    def bound_text(self) -> str:
        """The bound as `[low, high]`; empty when the setting is no number."""
        return "" if self.bound is None else "[{:.12g}, {:.12g}]".format(*self.bound)

    def in_unit(self, name: str, unit: str, scale: int) -> SettingsRefused:
        """Return the same refusal as the file has it: under another name, value and bound divided by `scale`."""
        value = self.value
        if not isinstance(value, str):
            value = value / scale if value % scale else value // scale
        bound = None if self.bound is None else (self.bound[0] / scale, self.bound[1] / scale)
        return SettingsRefused(name, value, bound=bound, unit=unit, rule=self.rule, source=self.source)


def _within(name: str, value: float, low: float, high: float, unit: str, source: str) -> None:
    if not low <= value <= high:  # NaN compares false
        raise SettingsRefused(name, value, bound=(low, high), unit=unit, source=source)


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmSettings:
    """Limits and tolerances of both arms in joint mode.

    Attributes:
        v_radps: Velocity limit of every joint [rad/s].
        a_radps2: Acceleration limit of every joint [rad/s²].
        j_radps3: Jerk limit of every joint [rad/s³].
        lower_rad: Lower position limit per side, shape (7,) [rad]; inside manual §4.13.
        upper_rad: Upper position limit per side, shape (7,) [rad]; inside manual §4.13.
        rate_hz: Rate of the joint stream [Hz].
        settle_rad: A move is reached when every joint is measured within this of the goal [rad] (§6.6).
        settle_ns: ... for this long [ns].
        settle_timeout_ns: A move that has not settled this long after its path ended is aborted [ns].
        tracking_rad: Distance between reference and measured that aborts [rad].
        tracking_ns: ... when it lasts this long [ns].
        target_expiry_ns: A streamed target lives this long without a successor [ns].
        start_margin_rad: A start this far outside a position limit is moved to the limit [rad].
    """

    v_radps: float = 1.0
    a_radps2: float = 3.0
    j_radps3: float = 20.0
    lower_rad: Mapping[Side, Vector] = field(default_factory=lambda: dict(robot.JOINT_LOWER_RAD))
    upper_rad: Mapping[Side, Vector] = field(default_factory=lambda: dict(robot.JOINT_UPPER_RAD))
    rate_hz: float = 100.0
    settle_rad: float = 0.05
    settle_ns: int = 500 * MS
    settle_timeout_ns: int = 5 * S
    tracking_rad: float = 0.3
    tracking_ns: int = 300 * MS
    target_expiry_ns: int = 1500 * MS
    start_margin_rad: float = 0.05

    def __post_init__(self) -> None:
        """Refuse limits looser than the robot's."""
        _within("arm.v_radps", self.v_radps, 1e-3, robot.HARD_V_RADPS, "rad/s", HARD)
        _within("arm.a_radps2", self.a_radps2, 1e-3, robot.HARD_A_RADPS2, "rad/s²", HARD)
        _within("arm.j_radps3", self.j_radps3, 1e-2, robot.HARD_J_RADPS3, "rad/s³", HARD)
        _within("arm.rate_hz", self.rate_hz, 50.0, 200.0, "Hz", "manual §4.3: 50 Hz or more")
        _within("arm.settle_rad", self.settle_rad, 1e-4, 0.2, "rad", "manual §6.6: 0.05")
        _within("arm.settle_ns", self.settle_ns, 0, 5 * S, "ns", OURS)
        _within("arm.settle_timeout_ns", self.settle_timeout_ns, 100 * MS, 60 * S, "ns", OURS)
        _within("arm.tracking_rad", self.tracking_rad, 0.02, 0.5, "rad", HARD)
        _within("arm.tracking_ns", self.tracking_ns, 20 * MS, 1 * S, "ns", OURS)
        _within("arm.target_expiry_ns", self.target_expiry_ns, 50 * MS, 3 * S, "ns", HARD)
        _within("arm.start_margin_rad", self.start_margin_rad, 0.0, 0.05, "rad", HARD)
        for side in Side:
            self._check_positions(side)

    def _check_positions(self, side: Side) -> None:
        bounds = {"lower_rad": self.lower_rad.get(side, ()), "upper_rad": self.upper_rad.get(side, ())}
        for name, values in bounds.items():
            if len(values) != ARM_DOF:
                rule = f"values: {ARM_DOF} are needed, in the order of manual §4.0.3"
                raise SettingsRefused(f"arm.{name}.{side}", len(values), rule=rule)
            for n, value in enumerate(values):
                hard = (robot.JOINT_LOWER_RAD[side][n], robot.JOINT_UPPER_RAD[side][n])
                _within(f"arm.{name}.{side}[{n}]", value, *hard, "rad", f"{side} arm joint {n + 1}, manual §4.13")
        for n, (lower, upper) in enumerate(zip(bounds["lower_rad"], bounds["upper_rad"], strict=True)):
            if lower >= upper:
                rule = f"is not below the upper limit of {side} arm joint {n + 1}, {upper:g} rad"
                raise SettingsRefused(f"arm.lower_rad.{side}[{n}]", lower, unit="rad", rule=rule)


@dataclass(frozen=True, slots=True, kw_only=True)
class LossSettings:
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
        _within("loss.keepalive_ns", self.keepalive_ns, 100 * MS, 250 * MS, "ns", HARD)
        _within("loss.free_after_ns", self.free_after_ns, 1 * S, 600 * S, "ns", OURS)
        source = "not before the lease is free"
        _within("loss.down_after_ns", self.down_after_ns, self.free_after_ns, 3600 * S, "ns", source)


@dataclass(frozen=True, slots=True, kw_only=True)
class EnableSettings:
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
        _within("enable.timeout_ns", self.timeout_ns, 1 * S, 60 * S, "ns", OURS)
        _within("enable.stale_ns", self.stale_ns, 20 * MS, 100 * MS, "ns", "hard bound: a stalled link sends bursts")
        _within("enable.hold_stale_ns", self.hold_stale_ns, self.stale_ns, 800 * MS, "ns", HARD)
        # /fsm_state comes at 20 Hz and /api/current_mode at 1 Hz: shorter than two periods would flicker.
        _within("enable.fsm_valid_ns", self.fsm_valid_ns, 100 * MS, 500 * MS, "ns", "manual §4.11.1: 20 Hz")
        _within("enable.mode_valid_ns", self.mode_valid_ns, 2 * S, 3 * S, "ns", "manual §4.11.2: about 1 Hz")
        _within("enable.seed_ns", self.seed_ns, 300 * MS, 5 * S, "ns", HARD)
        _within("enable.seed_lag_ns", self.seed_lag_ns, 10 * MS, 100 * MS, "ns", HARD)
        _within("enable.zero_timeout_ns", self.zero_timeout_ns, 1 * S, 2 * S, "ns", HARD)
        # The gap invariants hold for ticks up to 20 ms late: such a tick must not be skipped.
        _within("enable.late_ns", self.late_ns, 20 * MS, 50 * MS, "ns", HARD)


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkSettings:
    """The robot's side.

    Attributes:
        endpoint: zenoh endpoint of the robot's router (manual §2.4), e.g. `tcp/192.168.1.20:9000`.
        namespace: Namespace of the robot's bridge, empty for none.
        model: `lite`, `standard` or `lift` (manual §1.2).
        lease_ms: Lease announced to the robot's router [ms]: the fence at the robot's end.
    """

    endpoint: str = "tcp/127.0.0.1:9000"
    namespace: str = ""
    model: str = "standard"
    lease_ms: int = 500

    def __post_init__(self) -> None:
        """Refuse an unknown model, a malformed endpoint or a long lease."""
        if self.model not in robot.VARIANTS:
            rule = f"is unknown: one of {', '.join(robot.VARIANTS)}"
            raise SettingsRefused("robot.model", self.model, rule=rule, source="manual §1.2")
        found = ENDPOINT.fullmatch(self.endpoint)
        if found is None or not 1 <= int(found[3]) <= 65535:
            rule = "is no endpoint: tcp/HOST:9000 is the usual form"
            raise SettingsRefused("robot.endpoint", self.endpoint, rule=rule, source="manual §2.4")
        if self.namespace and NAMESPACE.fullmatch(self.namespace) is None:
            rule = "is no ROS namespace: words of letters, digits and _, joined by /"
            raise SettingsRefused("robot.namespace", self.namespace, rule=rule)
        _within("robot.lease_ms", self.lease_ms, 200, 1000, "ms", "fence against stale setpoints")

    @property
    def variant(self) -> robot.Variant:
        """Facts of the configured model."""
        return robot.VARIANTS[self.model]


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalSettings:
    """The users' side.

    Attributes:
        socket: Path of the unix socket; empty for the default of this user (see `api.protocol.default_socket`).
        socket_mode: Permission bits of the socket.
        tcp: Further listener `HOST:PORT`, empty for none; beyond loopback it needs users or TLS.
        users_file: zenoh user dictionary (`name:password` a line), empty for none.
        tls_certificate: PEM file of the listener, empty for no TLS.
        tls_private_key: PEM file (PKCS8).
        tls_root_ca: PEM file; when given, clients must show a certificate of it.
        snapshot_hz: Rate of published snapshots [Hz].
    """

    socket: str = ""
    socket_mode: int = 0o660
    tcp: str = ""
    users_file: str = ""
    tls_certificate: str = ""
    tls_private_key: str = ""
    tls_root_ca: str = ""
    snapshot_hz: float = 50.0

    def __post_init__(self) -> None:
        """Refuse rates and modes that make no sense. Listener rules are checked when the listener opens."""
        _within("local.snapshot_hz", self.snapshot_hz, 1.0, 100.0, "Hz", OURS)
        if len(self.socket.encode(errors="surrogateescape")) > SOCKET_PATH_BYTES:
            rule = f"is too long for a unix socket: at most {SOCKET_PATH_BYTES} bytes"
            raise SettingsRefused("local.socket", self.socket, rule=rule)
        if self.socket_mode & ~0o770 or self.socket_mode & 0o600 != 0o600:
            rule = "lets everybody in, or not even the owner: 0o660 or 0o600"
            raise SettingsRefused("local.socket_mode", f"0o{self.socket_mode:o}", rule=rule)


@dataclass(frozen=True, slots=True, kw_only=True)
class RealtimeSettings:
    """Scheduling of the daemon; everything degrades with one clear line when it is not permitted.

    Attributes:
        fifo: Whether to ask for SCHED_FIFO on every thread.
        fifo_priority: Priority of the loop thread; the others get 20 less.
        lock_memory: Whether to lock memory on fault.
    """

    fifo: bool = True
    fifo_priority: int = 60
    lock_memory: bool = True

    def __post_init__(self) -> None:
        """Refuse priorities that the kernel does not have."""
        _within("realtime.fifo_priority", self.fifo_priority, 21, 90, "", "SCHED_FIFO range")


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Everything a daemon needs to know, frozen."""

    arm: ArmSettings = field(default_factory=ArmSettings)
    loss: LossSettings = field(default_factory=LossSettings)
    enable: EnableSettings = field(default_factory=EnableSettings)
    link: LinkSettings = field(default_factory=LinkSettings)
    local: LocalSettings = field(default_factory=LocalSettings)
    realtime: RealtimeSettings = field(default_factory=RealtimeSettings)
