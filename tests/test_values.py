"""Values: whatever exists is well-formed; every wrong shape and every non-finite number is refused with its place."""

from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.values import (
    ARM_DOF,
    ArmState,
    CurrentMode,
    EePose,
    FsmState,
    MotorState,
    Side,
    ValueRefused,
    require_finite,
)

SEVEN = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
BAD_NUMBERS = (math.nan, math.inf, -math.inf)
FINITE = st.floats(allow_nan=False, allow_infinity=False)


@given(st.lists(st.floats(), max_size=12), st.integers(0, 12))
def test_a_vector_passes_only_with_the_right_length_and_finite_elements(values: list[float], length: int) -> None:
    """The check agrees with the rule for any vector and any length."""
    good = len(values) == length and all(math.isfinite(v) for v in values)
    try:
        require_finite("q", tuple(values), length)
    except ValueRefused:
        assert not good
    else:
        assert good


@pytest.mark.parametrize("bad", BAD_NUMBERS)
@pytest.mark.parametrize("index", range(ARM_DOF))
def test_an_arm_state_with_a_non_finite_joint_is_refused_with_its_index(index: int, bad: float) -> None:
    """The message names the element and its value."""
    q = (*SEVEN[:index], bad, *SEVEN[index + 1 :])
    with pytest.raises(ValueRefused, match=rf"position\[{index}\] is {bad}"):
        ArmState(q_rad=q, dq_radps=(), tau_nm=(), stamp_ns=0)


@pytest.mark.parametrize("length", [n for n in range(10) if n != ARM_DOF])
def test_an_arm_has_seven_joints(length: int) -> None:
    """Manual §4.0.3: any other number is no arm."""
    with pytest.raises(ValueRefused, match=f"has {length} values, 7 are needed"):
        ArmState(q_rad=(0.0,) * length, dq_radps=(), tau_nm=(), stamp_ns=0)


@pytest.mark.parametrize("bad", BAD_NUMBERS)
@pytest.mark.parametrize(("field", "name"), [("dq_radps", "velocity"), ("tau_nm", "effort")])
def test_velocity_and_effort_are_checked_as_positions_are(field: str, name: str, bad: float) -> None:
    """A NaN hides in no field."""
    with pytest.raises(ValueRefused, match=rf"{name}\[0\]"):
        MotorState(**{"q_rad": (0.0,), "dq_radps": (), "tau_nm": (), "stamp_ns": 0, field: (bad,)})


@pytest.mark.parametrize(("field", "name"), [("dq_radps", "velocity"), ("tau_nm", "effort")])
def test_velocity_and_effort_are_empty_or_as_long_as_positions(field: str, name: str) -> None:
    """The robot may leave them out, not send some of them."""
    with pytest.raises(ValueRefused, match=f"{name} has 2 values, 3 are needed"):
        MotorState(**{"q_rad": (0.0,) * 3, "dq_radps": (), "tau_nm": (), "stamp_ns": 0, field: (0.0, 0.0)})
    state = MotorState(**{"q_rad": (0.0,) * 3, "dq_radps": (), "tau_nm": (), "stamp_ns": 0, field: (0.0,) * 3})
    assert getattr(state, field) == (0.0,) * 3


def test_a_group_without_motors_is_no_state() -> None:
    """An empty message is nothing to believe in."""
    with pytest.raises(ValueRefused, match="position has 0 values"):
        MotorState(q_rad=(), dq_radps=(), tau_nm=(), stamp_ns=0)


@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: math.hypot(*q) > 0.01), st.floats(0.0, 2.0))
def test_a_quaternion_passes_only_within_five_percent_of_unit_norm(direction: tuple[float, ...], norm: float) -> None:
    """One rule for any direction and any norm; what passes has unit norm and the same direction."""
    length = math.hypot(*direction)
    unit = tuple(c / length for c in direction)
    quat = tuple(norm * c for c in unit)
    try:
        pose = EePose(p_m=(0.0, 0.0, 0.0), quat_xyzw=quat)
    except ValueRefused as error:
        assert abs(norm - 1.0) > 0.05 - 1e-9
        assert "norm" in str(error)
    else:
        assert abs(norm - 1.0) <= 0.05 + 1e-9
        assert math.hypot(*pose.quat_xyzw) == pytest.approx(1.0, abs=1e-12)
        assert pose.quat_xyzw == pytest.approx(unit, abs=1e-9)


@given(st.tuples(FINITE, FINITE, FINITE, FINITE))
def test_any_finite_quaternion_gives_a_unit_one_or_a_refusal(quat: tuple[float, ...]) -> None:
    """Neither overflow nor zero escapes as another error (manual §4.2 forbids all zeros)."""
    try:
        pose = EePose(p_m=(0.0, 0.0, 0.0), quat_xyzw=quat)
    except ValueRefused:
        return
    assert math.hypot(*pose.quat_xyzw) == pytest.approx(1.0)


@pytest.mark.parametrize("bad", BAD_NUMBERS)
@pytest.mark.parametrize(("field", "width"), [("p_m", 3), ("quat_xyzw", 4)])
def test_a_pose_is_finite_in_every_element_and_complete(field: str, width: int, bad: float) -> None:
    """Sweep over every element and every wrong length."""
    good = {"p_m": (0.1, 0.2, 0.3), "quat_xyzw": (0.0, 0.0, 0.0, 1.0)}
    for index in range(width):
        values = list(good[field])
        values[index] = bad
        with pytest.raises(ValueRefused):
            EePose(**{**good, field: tuple(values)})
    for length in (0, width - 1, width + 1):
        with pytest.raises(ValueRefused, match=f"{length} values"):
            EePose(**{**good, field: (0.5,) * length})


def test_values_cannot_be_changed() -> None:
    """A value that was checked stays what it was."""
    state = ArmState(q_rad=SEVEN, dq_radps=SEVEN, tau_nm=SEVEN, stamp_ns=1)
    with pytest.raises(dataclasses.FrozenInstanceError):
        state.q_rad = ()
    assert not hasattr(state, "__dict__")


def _mode(left: bool, right: bool, *, right_joint: bool = True) -> CurrentMode:
    """Return a mode with these arms enabled; the left one takes joints."""
    return CurrentMode(
        api=True,
        joint_mode={Side.LEFT: True, Side.RIGHT: right_joint},
        arm_enabled={Side.LEFT: left, Side.RIGHT: right},
        chassis_enabled=False,
        lift_enabled=False,
        collision_check=False,
    )


@pytest.mark.parametrize(
    ("left", "right", "enabled"),
    [
        (True, True, (Side.LEFT, Side.RIGHT)),
        (True, False, (Side.LEFT,)),
        (False, True, (Side.RIGHT,)),
        (False, False, ()),
    ],
)
def test_enabled_arms_are_listed_left_first(left: bool, right: bool, enabled: tuple[Side, ...]) -> None:
    """All four combinations of manual §4.11.2."""
    assert _mode(left, right).enabled_arms == enabled


@pytest.mark.parametrize(
    ("left", "right", "is_posing"), [(True, True, True), (False, True, True), (True, False, False)]
)
def test_a_robot_poses_when_an_enabled_arm_does(left: bool, right: bool, is_posing: bool) -> None:
    """The mode of an arm that is disabled says nothing (manual §4.11.2)."""
    assert _mode(left, right, right_joint=False).is_posing is is_posing


def test_sides_read_as_topic_parts() -> None:
    """They are put into topic names as they are."""
    assert [str(side) for side in Side] == ["left", "right"]


def test_fsm_states_have_the_manuals_numbers() -> None:
    """Manual §4.11.1, typed from there."""
    assert {state.name: int(state) for state in FsmState} == {
        "ERROR": -1,
        "PAUSE": 0,
        "SLOW_START": 1,
        "READY": 2,
        "LEFT_ARM_ONLY": 3,
        "RIGHT_ARM_ONLY": 4,
        "PLAY_READY": 5,
        "PLAY": 6,
    }
