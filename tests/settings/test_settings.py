"""Settings: every bound is swept from below to above, and what is refused names value, bound and unit."""

from __future__ import annotations

import dataclasses
import math
import pickle
from dataclasses import dataclass

import pytest
from msgspec import structs

from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import VARIANTS
from gateway.settings.settings import (
    ArmSettings,
    ChassisSettings,
    EnableSettings,
    ForeignSettings,
    GuardSettings,
    LiftSettings,
    LinkSettings,
    LocalSettings,
    LossSettings,
    ModelSettings,
    PoseSettings,
    RealtimeSettings,
    Settings,
    SettingsRefused,
)
from gateway.values import Side

MS = 1_000_000
S = 1_000_000_000
MARGIN_RAD = 0.01


@dataclass(frozen=True)
class Bound:
    """A field and the closed interval it may be in, given its neighbours."""

    part: type
    field: str
    low: float
    high: float
    neighbours: dict[str, float] = dataclasses.field(default_factory=dict)

    def __str__(self) -> str:
        """Return the field's name, for the name of the test."""
        return f"{self.part.__name__}.{self.field}"


BOUNDS = [
    Bound(ArmSettings, "v_radps", 0.001, 3.0),
    Bound(ArmSettings, "a_radps2", 0.001, 15.0),
    Bound(ArmSettings, "j_radps3", 0.01, 300.0),
    Bound(ArmSettings, "rate_hz", 50.0, 200.0),
    Bound(ArmSettings, "settle_rad", 0.0001, 0.2),
    Bound(ArmSettings, "settle_ns", 0, 5 * S),
    Bound(ArmSettings, "settle_timeout_ns", 100 * MS, 60 * S),
    Bound(ArmSettings, "tracking_rad", 0.02, 0.5),
    Bound(ArmSettings, "tracking_ns", 20 * MS, 1 * S),
    Bound(ArmSettings, "target_expiry_ns", 50 * MS, 3 * S),
    Bound(ArmSettings, "start_margin_rad", 0.0, 0.05),
    Bound(ChassisSettings, "v_mps", 0.01, 0.5),
    Bound(ChassisSettings, "w_radps", 0.01, 1.0),
    Bound(ChassisSettings, "up_mps2", 0.01, 0.3),
    Bound(ChassisSettings, "down_mps2", 0.01, 0.6),
    Bound(ChassisSettings, "j_mps3", 0.1, 100.0),
    Bound(ChassisSettings, "expiry_ns", 50 * MS, 3 * S),
    Bound(LiftSettings, "v_max", 0.01, 1.0),
    Bound(LiftSettings, "expiry_ns", 50 * MS, 3 * S),
    Bound(PoseSettings, "rate_hz", 50.0, 77.0),
    Bound(PoseSettings, "v_mps", 0.001, 0.5),
    Bound(PoseSettings, "a_mps2", 0.01, 5.0),
    Bound(PoseSettings, "j_mps3", 0.1, 100.0),
    Bound(PoseSettings, "w_radps", 0.01, 1.5),
    Bound(PoseSettings, "dw_radps2", 0.8**2, 15.0),
    Bound(PoseSettings, "ddw_radps3", 0.8 * 5.0, 300.0),
    Bound(PoseSettings, "reach_m", 0.1, 0.55),
    Bound(PoseSettings, "settle_m", 0.0001, 0.05),
    Bound(PoseSettings, "settle_rad", 0.0001, 0.2),
    Bound(PoseSettings, "tracking_m", 0.005, 0.1),
    Bound(PoseSettings, "tracking_rad", 0.02, 0.5),
    Bound(PoseSettings, "start_margin_m", 0.0, 0.01),
    Bound(LossSettings, "keepalive_ns", 100 * MS, 250 * MS),
    Bound(LossSettings, "free_after_ns", 1 * S, 600 * S, {"down_after_ns": 3600 * S}),
    Bound(LossSettings, "down_after_ns", 10 * S, 3600 * S),
    Bound(EnableSettings, "timeout_ns", 1 * S, 60 * S),
    Bound(EnableSettings, "stale_ns", 20 * MS, 100 * MS),
    Bound(EnableSettings, "hold_stale_ns", 100 * MS, 800 * MS),
    Bound(EnableSettings, "fsm_valid_ns", 100 * MS, 500 * MS),
    Bound(EnableSettings, "mode_valid_ns", 2 * S, 3 * S),
    Bound(EnableSettings, "seed_ns", 300 * MS, 5 * S),
    Bound(EnableSettings, "seed_lag_ns", 10 * MS, 100 * MS),
    Bound(EnableSettings, "zero_timeout_ns", 1 * S, 2 * S),
    Bound(EnableSettings, "late_ns", 20 * MS, 50 * MS),
    Bound(LinkSettings, "lease_ms", 200, 1000),
    Bound(LocalSettings, "snapshot_hz", 1.0, 100.0),
    Bound(LocalSettings, "audit_log_mb", 1, 1024),
    Bound(RealtimeSettings, "fifo_priority", 21, 90),
    Bound(GuardSettings, "freeze_ns", 40 * MS, 120 * MS),
    Bound(GuardSettings, "hold_ns", 1_000 * MS, 10_000 * MS),
    Bound(ModelSettings, "position_tolerance_m", 0.0005, 0.02),
    Bound(ModelSettings, "angle_tolerance_rad", 0.002, 0.1),
    Bound(ModelSettings, "window_ns", 1 * S, 30 * S),
    Bound(ModelSettings, "margin_m", 0.02, 0.2),
    Bound(ModelSettings, "singularity_radps", 0.3, 3.0),
    Bound(ModelSettings, "left_gripper_closed_rad", -3.2, 3.2),
    Bound(ModelSettings, "right_gripper_closed_rad", -3.2, 3.2),
]

UNBOUNDED = {
    "lower_rad",
    "upper_rad",
    "fifo",
    "lock_memory",
    "one_core",
    "socket_mode",
    "enabled",
    "check",
    "self_collision",
    "singularity_slowdown",
    "tcp_open_to_every_user_of_this_host",
    "demand_stop_endpoint",
    "black_box",
    "dynamics",
    "left_touch_n",  # 0 for none: below
    "right_touch_n",
}
"""Fields with rules of their own (below), or without a number."""


@pytest.mark.parametrize("bound", BOUNDS, ids=str)
def test_a_number_passes_exactly_inside_its_bound(bound: Bound) -> None:
    """Sweep from below the low end to above the high end, both ends included."""
    step = 1 if isinstance(bound.low, int) else (bound.high - bound.low) * 1e-9 + 1e-12
    span = bound.high - bound.low
    inside = [bound.low, bound.high, *(type(bound.low)(bound.low + span * k / 8) for k in range(1, 8))]
    outside = [bound.low - step, bound.high + step, bound.low - span, bound.high + span, -bound.high - step]
    for value in inside:
        assert getattr(bound.part(**{**bound.neighbours, bound.field: value}), bound.field) == value
    for value in [*outside, math.nan, math.inf, -math.inf]:
        with pytest.raises(SettingsRefused) as refused:
            bound.part(**{**bound.neighbours, bound.field: value})
        assert refused.value.name.endswith(f".{bound.field}")
        assert repr(value) in str(refused.value)
        assert refused.value.unit in str(refused.value)
        assert refused.value.source


def test_every_number_of_every_section_is_in_the_sweep() -> None:
    """A new field must get a bound, or say above why it has none."""
    swept = {(bound.part, bound.field) for bound in BOUNDS}
    for part in (f.default_factory for f in structs.fields(Settings)):
        for field in structs.fields(part):
            is_number = isinstance(getattr(part(), field.name), (int, float))
            assert ((part, field.name) in swept) == (is_number and field.name not in UNBOUNDED), field.name


def test_the_defaults_are_those_of_the_behaviour_table() -> None:
    """Typed again from BEHAVIOUR, Values."""
    arm, loss, enable = ArmSettings(), LossSettings(), EnableSettings()
    assert GuardSettings() == GuardSettings(enabled=True, freeze_ns=80_000_000, hold_ns=10_000_000_000)
    assert (arm.v_radps, arm.a_radps2, arm.j_radps3) == (1.0, 3.0, 20.0)
    assert (arm.settle_rad, arm.settle_ns) == (0.05, 500_000_000)
    assert (arm.tracking_rad, arm.tracking_ns) == (0.3, 300_000_000)
    assert (arm.target_expiry_ns, arm.start_margin_rad) == (1_500_000_000, 0.05)
    pose = PoseSettings()
    assert (pose.rate_hz, pose.v_mps, pose.w_radps) == (70.0, 0.25, 0.8)
    assert (pose.settle_m, pose.settle_rad) == (0.005, 0.05)
    assert (loss.keepalive_ns, loss.free_after_ns, loss.down_after_ns) == (250_000_000, 10_000_000_000, 60_000_000_000)
    assert (enable.timeout_ns, enable.stale_ns, enable.hold_stale_ns) == (10_000_000_000, 100_000_000, 800_000_000)
    assert (enable.fsm_valid_ns, enable.mode_valid_ns) == (500_000_000, 3_000_000_000)
    assert (enable.seed_ns, enable.seed_lag_ns) == (300_000_000, 100_000_000)
    assert (enable.zero_timeout_ns, enable.late_ns) == (2_000_000_000, 50_000_000)
    chassis, lift = ChassisSettings(), LiftSettings()
    assert (chassis.v_mps, chassis.w_radps, chassis.up_mps2, chassis.down_mps2) == (0.3, 0.5, 0.3, 0.6)
    assert chassis.expiry_ns == lift.expiry_ns == 300_000_000 and lift.v_max == 1.0
    assert LinkSettings().lease_ms == 250
    assert (LocalSettings().socket_mode, LocalSettings().snapshot_hz) == (0o660, 50.0)


def _moved(side: Side, upper: bool, n: int, by_rad: float) -> dict[str, dict[Side, tuple[float, ...]]]:
    table = dict(JOINT_UPPER_RAD if upper else JOINT_LOWER_RAD)
    values = list(table[side])
    values[n] += by_rad
    table[side] = tuple(values)
    return {"upper_rad" if upper else "lower_rad": table}


@pytest.mark.parametrize("side", Side)
@pytest.mark.parametrize("upper", [False, True], ids=["lower", "upper"])
@pytest.mark.parametrize("n", range(7))
def test_a_position_limit_may_move_inwards_only(side: Side, upper: bool, n: int) -> None:
    """§4.13 for every joint, both ends, both arms."""
    inwards = -MARGIN_RAD if upper else MARGIN_RAD
    ArmSettings(**_moved(side, upper, n, inwards))
    with pytest.raises(SettingsRefused) as refused:
        ArmSettings(**_moved(side, upper, n, -inwards))
    assert refused.value.name == f"arm.{'upper' if upper else 'lower'}_rad.{side}[{n}]"
    assert refused.value.bound == (JOINT_LOWER_RAD[side][n], JOINT_UPPER_RAD[side][n])
    assert f"{side} arm joint {n + 1}" in str(refused.value)


@pytest.mark.parametrize("side", Side)
def test_a_range_of_a_joint_is_never_empty(side: Side) -> None:
    """A lower limit at or above the upper one leaves nowhere to go."""
    upper = JOINT_UPPER_RAD[side]
    limits = {**JOINT_LOWER_RAD, side: (*JOINT_LOWER_RAD[side][:6], upper[6])}
    with pytest.raises(SettingsRefused, match=f"is not below the upper limit of {side} arm joint 7, 0.7 rad"):
        ArmSettings(lower_rad=limits)


@pytest.mark.parametrize("values", [(), (0.0,) * 6, (0.0,) * 8])
@pytest.mark.parametrize("field", ["lower_rad", "upper_rad"])
def test_position_limits_have_seven_values(field: str, values: tuple[float, ...]) -> None:
    """§4.0.3: one for each joint."""
    with pytest.raises(SettingsRefused, match=f"arm.{field}.left = {len(values)} values: 7 are needed"):
        ArmSettings(**{field: {Side.LEFT: values, Side.RIGHT: JOINT_LOWER_RAD[Side.RIGHT]}})


def test_position_limits_name_both_arms() -> None:
    """A table without one side is refused, not a crash."""
    with pytest.raises(SettingsRefused, match=r"arm\.lower_rad\.right = 0 values"):
        ArmSettings(lower_rad={Side.LEFT: JOINT_LOWER_RAD[Side.LEFT]})


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_position_limits_are_finite(bad: float) -> None:
    """A NaN limit would let everything pass."""
    with pytest.raises(SettingsRefused):
        ArmSettings(**_moved(Side.LEFT, False, 0, bad))


def test_stages_of_a_loss_keep_their_order() -> None:
    """Everything goes down when the lease is free, or later."""
    LossSettings(free_after_ns=20 * S, down_after_ns=20 * S)
    LossSettings(free_after_ns=600 * S, down_after_ns=600 * S)
    with pytest.raises(SettingsRefused, match="not before the lease is free"):
        LossSettings(free_after_ns=20 * S, down_after_ns=20 * S - 1)
    with pytest.raises(SettingsRefused):
        LossSettings(free_after_ns=600 * S + 1, down_after_ns=3600 * S)


def test_hold_frames_outlast_the_stale_limit() -> None:
    """Holding while stale cannot be shorter than becoming stale."""
    EnableSettings(stale_ns=20 * MS, hold_stale_ns=20 * MS)
    with pytest.raises(SettingsRefused):
        EnableSettings(stale_ns=50 * MS, hold_stale_ns=50 * MS - 1)


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/127.0.0.1:9000",
        "tcp/192.168.1.20:9000",
        "tcp/ta2.local:1",
        "tls/robot:65535",
        "quic/[::1]:9000",
        "tcp/[fe80::1%eth0]:9000",
        "udp/10.0.0.1:7447#iface=eth0",
        "tcp/10.0.0.1:7447?prio=1-3",
    ],
)
def test_an_endpoint_of_zenoh_passes(endpoint: str) -> None:
    """Protocol, host and port, with zenoh's own options behind."""
    assert LinkSettings(endpoint=endpoint).endpoint == endpoint


@pytest.mark.parametrize(
    "endpoint",
    [
        "",
        "192.168.1.20",
        "192.168.1.20:9000",
        "tcp/192.168.1.20",
        "tcp/:9000",
        "tcp/robot:",
        "tcp/robot:0",
        "tcp/robot:65536",
        "tcp/robot:٩٠٠٠",
        "tcp/::1:9000",
        "http://robot:9000",
        "ftp/robot:9000",
        "tcp/robot:9000 ",
        "tcp/ro bot:9000",
    ],
)
def test_what_is_no_endpoint_is_refused_with_the_usual_form(endpoint: str) -> None:
    """The commonest slip is a bare address."""
    with pytest.raises(SettingsRefused, match="tcp/HOST:9000"):
        LinkSettings(endpoint=endpoint)


@pytest.mark.parametrize("namespace", ["", "bot1", "/bot1", "lab/bot_2", "/a/b/c"])
def test_a_ros_namespace_passes(namespace: str) -> None:
    """With and without the leading slash."""
    assert LinkSettings(namespace=namespace).namespace == namespace


@pytest.mark.parametrize("serial", [" TA2-0042", "TA2-0042\n", "TA2\t42"])
def test_a_serial_number_has_nothing_invisible(serial: str) -> None:
    """It is compared with what calibration files say (manual A.4)."""
    assert LinkSettings(serial="TA2-0042").serial == "TA2-0042" and LinkSettings().serial == ""
    with pytest.raises(SettingsRefused, match="no serial number"):
        LinkSettings(serial=serial)


@pytest.mark.parametrize("namespace", ["*", "**", "a/*", "a//b", "a/", "/", "a b", "$*", "a?b", "a#b", "@/x", "bot-1"])
def test_a_namespace_cannot_hide_a_wildcard(namespace: str) -> None:
    """One mailbox per topic, no wildcard: a key expression in the namespace would subscribe to all robots."""
    with pytest.raises(SettingsRefused, match="no ROS namespace"):
        LinkSettings(namespace=namespace)


def test_an_unknown_policy_towards_others_is_refused_with_the_known_ones() -> None:
    """§3.3.2."""
    assert [ForeignSettings(policy=name).policy for name in ("hold", "warn")] == ["hold", "warn"]
    with pytest.raises(SettingsRefused, match=r"'fight' is unknown: one of hold, warn \(manual §3.3.2\)"):
        ForeignSettings(policy="fight")


def test_an_unknown_model_is_refused_with_the_known_ones() -> None:
    """§1.2."""
    for name in VARIANTS:
        assert LinkSettings(model=name).variant is VARIANTS[name]
    with pytest.raises(SettingsRefused, match=r"'plus' is unknown: one of lite, standard, lift \(manual §1.2\)"):
        LinkSettings(model="plus")


@pytest.mark.parametrize("mode", range(0o1000))
def test_a_socket_is_never_open_to_everybody_and_always_to_its_owner(mode: int) -> None:
    """Every one of the 512 modes."""
    good = mode & 0o007 == 0 and mode & 0o600 == 0o600
    if good:
        assert LocalSettings(socket_mode=mode).socket_mode == mode
    else:
        with pytest.raises(SettingsRefused, match=f"0o{mode:o}"):
            LocalSettings(socket_mode=mode)


@pytest.mark.parametrize("mode", [660, -1, 0o1660])
def test_a_mode_without_its_octal_prefix_is_refused(mode: int) -> None:
    """660 is 0o1224: a slip that would open the socket."""
    with pytest.raises(SettingsRefused, match="0o660"):
        LocalSettings(socket_mode=mode)


def test_a_refusal_has_a_unit_of_the_file_too() -> None:
    """The file has milliseconds, the settings nanoseconds: value and bound change together, words stay."""
    ranged = SettingsRefused("loss.x_ns", 300_000_000, bound=(100_000_000, 250_000_000), unit="ns", source="ours")
    assert str(ranged) == "loss.x_ns = 300000000 ns is outside [100000000, 250000000] ns (ours)"
    assert str(ranged.in_unit("loss.x_ms", "ms", MS)) == "loss.x_ms = 300 ms is outside [100, 250] ms (ours)"
    assert ranged.in_unit("loss.x_s", "s", S).value == 0.3
    worded = SettingsRefused("local.x", "a", rule="is bad").in_unit("local.y", "", 1)
    assert (str(worded), worded.bound_text) == ("local.y = 'a' is bad", "")


def test_a_refusal_survives_pickling() -> None:
    """It may cross a process border with all its facts."""
    error = SettingsRefused("a.b", 1.0, bound=(2.0, 3.0), unit="rad", source="x")
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_settings_cannot_be_changed() -> None:
    """One frozen value, no globals."""
    settings = Settings()
    with pytest.raises(AttributeError):
        settings.arm = ArmSettings()
    with pytest.raises(AttributeError):
        settings.arm.v_radps = 9.0


def test_nothing_is_kept_apart_by_a_model_that_nobody_compares() -> None:
    """The guard stands on the check."""
    assert ModelSettings(self_collision=True).check
    with pytest.raises(SettingsRefused, match=r"needs model\.check = true") as refused:
        ModelSettings(check=False, self_collision=True)
    assert refused.value.name == "model.self_collision"
    with pytest.raises(SettingsRefused) as refused:
        ModelSettings(check=False, dynamics=True)
    assert refused.value.name == "model.dynamics"


@pytest.mark.parametrize("side", list(Side))
def test_a_touch_that_ends_motions_is_in_reach_of_what_is_felt(side: Side) -> None:
    """0 is none; from 1 N on, where efforts are looked at."""
    name = f"{side}_touch_n"
    assert ModelSettings().touch_n(side) == 0.0
    for force_n in (1.0, 200.0):
        assert ModelSettings(dynamics=True, **{name: force_n}).touch_n(side) == force_n
    for force_n in (0.5, 201.0, -8.0, math.nan, math.inf):
        with pytest.raises(SettingsRefused) as refused:
            ModelSettings(dynamics=True, **{name: force_n})
        assert refused.value.bound == (1.0, 200.0) and refused.value.unit == "N"
    with pytest.raises(SettingsRefused, match=r"needs model\.dynamics"):
        ModelSettings(**{name: 30.0})
