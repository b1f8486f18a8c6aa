"""What chassis and lift may be asked for: each condition with its code, each bound from below to above."""

from __future__ import annotations

import math

import pytest

from gateway.core.limits import ground_rules as rules
from gateway.errors import Code, Refusal
from gateway.settings.settings import ChassisSettings, LiftSettings
from gateway.values import FsmState
from tests.changed import replace
from tests.core.stage import MODE

CHASSIS, LIFT = ChassisSettings(), LiftSettings(v_max=0.5)


def code(refusal: Refusal | None) -> Code | None:
    """Why, or None; every refusal says what is to blame."""
    assert refusal is None or (refusal.message and refusal.field)
    return None if refusal is None else refusal.code


@pytest.mark.parametrize(
    ("mode", "chassis", "lift"),
    [
        (None, Code.MODE_UNKNOWN, Code.MODE_UNKNOWN),
        (replace(MODE, api=False), Code.MODE_VR, Code.MODE_VR),
        (replace(MODE, chassis_enabled=False), Code.CHASSIS_DISABLED, None),
        (replace(MODE, lift_enabled=False), None, Code.LIFT_DISABLED),
        (MODE, None, None),
    ],
    ids=["unknown", "vr", "no chassis", "no lift", "all"],
)
def test_mode_and_switch_decide(mode, chassis, lift):
    """API mode and the part's own switch (manual §4.11.2); nothing else of the configuration."""
    assert code(rules.check_chassis(mode, FsmState.PAUSE)) is chassis
    assert code(rules.check_lift(mode, FsmState.PAUSE)) is lift


@pytest.mark.parametrize("fsm", [None, *FsmState])
def test_an_fsm_that_is_somebody_elses_refuses_both_and_an_error_the_lift(fsm):
    """Neither group needs the FSM to be enabled; in ERROR the robot stops its lift (manual §4.6); 3-6 are not ours."""
    busy = Code.FSM_BUSY if fsm is not None and fsm > FsmState.READY else None
    assert code(rules.check_lift(MODE, fsm)) is (Code.FSM_ERROR if fsm == FsmState.ERROR else busy)
    assert code(rules.check_chassis(MODE, fsm)) is busy
    assert code(rules.check_chassis(MODE, 17)) is Code.FSM_BUSY


def test_a_lift_that_is_not_there_is_named():
    """With what would have it."""
    assert code(rules.no_lift()) is Code.NO_LIFT and rules.no_lift().bound == "the lift model"


@pytest.mark.parametrize(
    ("velocity", "field"),
    [
        ((0.0, 0.0, 0.0), None),
        ((0.3, 0.0, 0.5), None),
        ((0.0, -0.3, -0.5), None),
        ((0.21, 0.21, 0.0), None),
        ((0.301, 0.0, 0.0), "vx_mps, vy_mps"),
        ((0.0, -0.301, 0.0), "vx_mps, vy_mps"),
        ((0.22, 0.22, 0.0), "vx_mps, vy_mps"),
        ((0.0, 0.0, 0.501), "wz_radps"),
        ((0.0, 0.0, -0.501), "wz_radps"),
    ],
)
def test_the_speed_over_the_ground_and_the_turning_are_bounded(velocity, field):
    """Whatever the direction: two components at their limits are faster than one (BEHAVIOUR, values)."""
    refusal = rules.check_chassis_velocity(velocity, CHASSIS)
    assert (refusal.field if refusal else None) == field
    if refusal is not None:
        assert refusal.code is Code.OUT_OF_RANGE and refusal.bound and refusal.unit in ("m/s", "rad/s")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused(value):
    """It would spoil the speed state of the robot (manual §4.5)."""
    for n, name in enumerate(("vx_mps", "vy_mps", "wz_radps")):
        velocity = tuple(value if n == m else 0.0 for m in range(3))
        refusal = rules.check_chassis_velocity(velocity, CHASSIS)
        assert refusal is not None and (refusal.code, refusal.field) == (Code.NOT_FINITE, name)
    refusal = rules.check_lift_velocity(value, LIFT)
    assert refusal is not None and (refusal.code, refusal.field) == (Code.NOT_FINITE, "velocity")


@pytest.mark.parametrize(
    ("velocity", "passes"), [(0.5, True), (-0.5, True), (0.0, True), (0.51, False), (-0.51, False)]
)
def test_the_lift_is_bounded_both_ways(velocity, passes):
    """As a part of full speed; the configured part counts."""
    refusal = rules.check_lift_velocity(velocity, LIFT)
    assert (refusal is None) is passes
    if refusal is not None:
        assert (refusal.code, refusal.bound, refusal.unit) == (Code.OUT_OF_RANGE, "[-0.5, 0.5]", "")
