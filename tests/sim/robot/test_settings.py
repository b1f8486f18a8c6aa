"""Rules of the settings."""

from __future__ import annotations

import pytest

from gateway.sim.robot.geometry import arm_geometry
from gateway.sim.robot.manual import LOWER_RAD, UPPER_RAD, ArmMode, Side
from gateway.sim.robot.settings import HANGING_RAD, SimSettings


@pytest.mark.parametrize("side", Side)
def test_hanging_arm_is_well_inside_the_limits_and_below_the_shoulder(side):
    """The starting pose leaves 0.05 rad to every limit of §4.13, and the hand hangs half a metre down."""
    for q, low, high in zip(HANGING_RAD[side], LOWER_RAD[side], UPPER_RAD[side], strict=True):
        assert low + 0.05 <= q <= high - 0.05
    assert arm_geometry(side).forward(HANGING_RAD[side]).position_m[2] < -0.45


def test_hanging_arms_mirror_each_other():
    """Left and right hang symmetrically."""
    assert HANGING_RAD[Side.RIGHT] == tuple(-q for q in HANGING_RAD[Side.LEFT])


def test_default_is_a_standard_robot_in_joint_mode():
    """Without a word: standard model, API mode, both arms enabled in joint mode, no lift (§1.2)."""
    settings = SimSettings()
    assert not settings.has_lift
    assert all(settings.arm_enabled(side) and settings.arm_mode(side) is ArmMode.JOINT for side in Side)


def test_sides_are_told_apart():
    """Modes, switches, objects and gravity of the two sides are independent; gravity is mirrored."""
    settings = SimSettings(right_mode="pose", enable_left_arm=False, left_object_rad=0.3, model="lift")
    assert (settings.arm_mode(Side.LEFT), settings.arm_mode(Side.RIGHT)) == (ArmMode.JOINT, ArmMode.POSE)
    assert (settings.arm_enabled(Side.LEFT), settings.arm_enabled(Side.RIGHT)) == (False, True)
    assert (settings.object_rad(Side.LEFT), settings.object_rad(Side.RIGHT)) == (0.3, None)
    assert settings.holding_nm(Side.RIGHT) == tuple(-value for value in settings.holding_nm(Side.LEFT))
    assert settings.has_lift


def test_servos_carry_gravity_unless_they_are_compliant():
    """By default a held arm stands on its target."""
    assert not any(SimSettings().sag_rad(Side.LEFT))


def test_compliant_servos_lower_the_hand_a_little():
    """Holding the home pose the hand sinks by some millimetres; no joint is off by 0.02 rad."""
    sag = SimSettings(compliance_radpnm=1e-3).sag_rad(Side.LEFT)
    geometry = arm_geometry(Side.LEFT)
    q = (0.41, 1.16, -0.47, 0.90, 0.23, -0.15, 0.60)
    sunk_m = (
        geometry.forward([a + b for a, b in zip(q, sag, strict=True)]).position_m[2] - geometry.forward(q).position_m[2]
    )
    assert max(map(abs, sag)) < 0.02
    assert -0.005 < sunk_m < -0.0005


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"model": "plus"}, "plus"),
        ({"left_mode": "velocity"}, "left_mode"),
        ({"right_mode": ""}, "right_mode"),
        ({"pose_silence": "waits"}, "pose_silence"),
        ({"namespace": "bot*"}, "namespace"),
        ({"compliance_radpnm": -1e-3}, "compliance_radpnm"),
        ({"clock_drift_ppm": 1001.0}, "clock_drift_ppm"),
        ({"clock_drift_ppm": float("nan")}, "clock_drift_ppm"),
        ({"differs_percent": 5.0}, "differs 5 % .* needs physics"),
        ({"differs_percent": 31.0, "physics": "mujoco"}, "differs 31 %"),
        ({"differs_percent": float("nan"), "physics": "mujoco"}, "differs nan %"),
        ({"lag_s": 0.2}, "lag_s"),
        ({"brake_s": 0.0}, "brake_s"),
        ({"state_period_ns": 1}, "state_period_ns"),
    ],
)
def test_meaningless_settings_are_refused_by_name(wrong, named):
    """A wrong name or number is an error that says which setting it was."""
    with pytest.raises(ValueError, match=named):
        SimSettings(**wrong)
