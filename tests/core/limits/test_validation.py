"""Validation: every refusal has a code, the value, the bound, its unit and a remedy; everything else passes unchanged."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.limits import validation
from gateway.core.limits.validation import Checked, Fitness
from gateway.errors import Code, Refusal, to_exception
from gateway.messages.incoming import OnLimit
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.settings.settings import ArmSettings
from gateway.values import CurrentMode, Side
from tests.changed import replace

SETTINGS = ArmSettings()
TIGHT = ArmSettings(
    lower_rad={side: tuple(q + 0.1 for q in JOINT_LOWER_RAD[side]) for side in Side},
    upper_rad={side: tuple(q - 0.1 for q in JOINT_UPPER_RAD[side]) for side in Side},
)
"""A configuration that keeps 0.1 rad away from every limit of the robot."""
HOME = HOME_Q_RAD
API = CurrentMode(
    api=True,
    joint_mode=dict.fromkeys(Side, True),
    arm_enabled=dict.fromkeys(Side, True),
    chassis_enabled=True,
    lift_enabled=False,
    collision_check=True,
)
FIT = Fitness(mode=API, part_fresh=dict.fromkeys(Side, True), streaming=dict.fromkeys(Side, True))
BOTH = tuple(Side)
S = 1_000_000_000


def facts(refusal: Refusal | Checked | None) -> tuple[Code, str, str, str, str]:
    """Code, field, value, bound and unit of a refusal; it must speak and know a remedy."""
    assert isinstance(refusal, Refusal)
    assert refusal.message and to_exception(refusal).hint
    return refusal.code, refusal.field, refusal.value, refusal.bound, refusal.unit


def moved(q_rad: tuple[float, ...], joint: int, value: float) -> tuple[float, ...]:
    """The same position with one joint somewhere else."""
    return (*q_rad[:joint], value, *q_rad[joint + 1 :])


# ------------------------------------------------------------------------------------------- latches and the mode


def test_nothing_latched_lets_motion_pass():
    """Validation has no opinion of its own about latches."""
    assert validation.latched({}) is None


def test_latches_refuse_with_all_their_causes():
    """Code and message of each: what a person has to look at before `recover`."""
    refusal = validation.latched({Code.ESTOP: "by ann", Code.TRACKING_ERROR: "0.4 rad off"})
    assert facts(refusal) == (Code.LATCHED, "latches", "ESTOP, TRACKING_ERROR", "", "")
    assert refusal.message == "motion is latched off (ESTOP: by ann; TRACKING_ERROR: 0.4 rad off)"
    assert "recover" in to_exception(refusal).hint


def test_only_a_known_api_mode_passes():
    """VR mode takes no API commands; an unknown mode is not taken for API (manual §3.1.1, §4.11.2)."""
    assert validation.check_mode(API) is None
    assert facts(validation.check_mode(None)) == (Code.MODE_UNKNOWN, "mode", "unknown", "API", "")
    assert facts(validation.check_mode(replace(API, api=False))) == (Code.MODE_VR, "mode", "VR", "API", "")


# ------------------------------------------------------------------------------------------------------ the arms


def test_arms_that_are_enabled_in_joint_mode_streaming_and_fresh_pass():
    """Any of them, both, or none."""
    for sides in ((), (Side.LEFT,), (Side.RIGHT,), BOTH):
        assert validation.check_arms(FIT, sides) is None


@pytest.mark.parametrize(("mode", "code"), [(None, Code.MODE_UNKNOWN), (replace(API, api=False), Code.MODE_VR)])
def test_the_mode_is_asked_first(mode, code):
    """Without API mode nothing else about the arms matters."""
    nothing = Fitness(mode=mode, part_fresh=dict.fromkeys(Side, False), streaming=dict.fromkeys(Side, False))
    assert facts(validation.check_arms(nothing, BOTH))[0] is code


def without(what: str, side: Side) -> Fitness:
    """The fit robot, but for one thing of one arm."""
    lacking = {**dict.fromkeys(Side, True), side: False}
    if what in {"arm_enabled", "joint_mode"}:
        return replace(FIT, mode=replace(API, **{what: lacking}))
    return replace(FIT, **{what: lacking})


@pytest.mark.parametrize("side", BOTH)
@pytest.mark.parametrize(
    ("what", "code", "value", "bound", "unit"),
    [
        ("arm_enabled", Code.ARM_DISABLED, "disabled", "enabled", ""),
        ("joint_mode", Code.WRONG_CONTROL_MODE, "end-effector", "joint", ""),
        ("part_fresh", Code.PART_STALE, "", "100", "ms"),
        ("streaming", Code.NOT_ENABLED, "", "", ""),
    ],
)
def test_an_arm_that_lacks_something_is_refused_and_named(side, what, code, value, bound, unit):
    """Only when it is asked for; the other arm is not held back by it."""
    other = next(s for s in Side if s is not side)
    lacking = without(what, side)
    assert validation.check_arms(lacking, (other,)) is None
    for sides in ((side,), BOTH):
        refusal = validation.check_arms(lacking, sides)
        assert facts(refusal) == (code, f"{side}_arm", value, bound, unit)
        assert f"the {side} arm" in refusal.message or f"the state of the {side} arm" in refusal.message


def test_the_bound_of_freshness_is_the_one_that_was_asked_with():
    """A tighter configuration is told as such."""
    refusal = validation.check_arms(replace(without("part_fresh", Side.LEFT), stale_ns=20_000_000), BOTH)
    assert refusal.bound == "20" and refusal.message == "the state of the left arm is older than 20 ms"


def test_what_only_a_reboot_changes_is_named_before_what_passes_by_itself():
    """Disabled, then control mode, then freshness, then not streaming: the most lasting reason first."""
    lacks = dict.fromkeys(Side, False)
    mode = replace(API, arm_enabled=lacks, joint_mode=lacks)
    nothing = Fitness(mode=mode, part_fresh=lacks, streaming=lacks)
    codes = []
    for repair in (
        {"mode": replace(mode, arm_enabled=API.arm_enabled)},
        {"mode": API},
        {"part_fresh": FIT.part_fresh},
        {"streaming": FIT.streaming},
    ):
        codes.append(facts(validation.check_arms(nothing, (Side.LEFT,)))[0])
        nothing = replace(nothing, **repair)
    assert codes == [Code.ARM_DISABLED, Code.WRONG_CONTROL_MODE, Code.PART_STALE, Code.NOT_ENABLED]
    assert validation.check_arms(nothing, (Side.LEFT,)) is None


# ------------------------------------------------------------------------------------------------------ options


@pytest.mark.parametrize("speed", [1e-3, 0.5, 1.0])
def test_a_speed_factor_from_a_thousandth_to_1_passes(speed):
    """It scales the configured velocity limit down, never up."""
    assert validation.check_speed(speed) is None


@pytest.mark.parametrize("speed", [0.0, 5e-324, math.nextafter(1e-3, 0.0), -0.5, math.nextafter(1.0, 2.0), 100.0])
def test_a_speed_factor_outside_is_refused(speed):
    """And no clipping is offered: there is none for a speed."""
    refusal = validation.check_speed(speed)
    assert facts(refusal) == (Code.OUT_OF_RANGE, "speed", str(speed), "[0.001, 1]", "")
    assert "clip" not in to_exception(refusal).hint


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_options_must_be_finite(value):
    """NaN compares false with everything; it must not slip through a bound."""
    assert facts(validation.check_speed(value)) == (Code.NOT_FINITE, "speed", str(value), "[0.001, 1]", "")
    assert facts(validation.check_tolerance(value)) == (
        Code.NOT_FINITE, "tolerance_rad", str(value), "[0.0001, 0.2]", "rad",
    )  # fmt: skip


@pytest.mark.parametrize("tolerance_rad", [None, 1e-4, 0.05, 0.2])
def test_a_tolerance_inside_its_bounds_or_none_passes(tolerance_rad):
    """None means the configured one (manual §6.6: 0.05 rad); tighter on request."""
    assert validation.check_tolerance(tolerance_rad) is None


@pytest.mark.parametrize("tolerance_rad", [0.0, -0.05, math.nextafter(1e-4, 0.0), math.nextafter(0.2, 1.0)])
def test_a_tolerance_outside_is_refused(tolerance_rad):
    """Below what the arm can measure, or so wide that reaching means nothing."""
    refusal = validation.check_tolerance(tolerance_rad)
    assert facts(refusal) == (Code.OUT_OF_RANGE, "tolerance_rad", str(tolerance_rad), "[0.0001, 0.2]", "rad")
    assert "clip" not in to_exception(refusal).hint


@pytest.mark.parametrize("expiry_ns", [None, S // 20, 1_500_000_000, 3 * S])
def test_an_expiry_inside_its_bounds_or_none_passes(expiry_ns):
    """Targets may come at 1 Hz; 3 s is the hard bound (BEHAVIOUR, values)."""
    assert validation.check_expiry(expiry_ns) is None


@pytest.mark.parametrize(("expiry_ns", "value"), [(S // 20 - 1, "0.049999999"), (3 * S + 1, "3.000000001"), (0, "0.0")])
def test_an_expiry_outside_is_refused(expiry_ns, value):
    """In seconds, as the user gave it."""
    refusal = validation.check_expiry(expiry_ns)
    assert facts(refusal) == (Code.OUT_OF_RANGE, "expiry_ns", value, "[0.05, 3]", "s")
    assert "clip" not in to_exception(refusal).hint


# ------------------------------------------------------------------------------------------------------ goals


@pytest.mark.parametrize("side", BOTH)
@pytest.mark.parametrize("on_limit", list(OnLimit))
def test_a_goal_inside_the_limits_passes_as_it_is(side, on_limit):
    """The limits themselves included; a list becomes a tuple."""
    for q_rad in (HOME[side], SETTINGS.lower_rad[side], SETTINGS.upper_rad[side]):
        assert validation.check_goal(side, list(q_rad), SETTINGS, on_limit) == Checked(values=tuple(q_rad), clipped=())


@pytest.mark.parametrize("side", BOTH)
@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("settings", [SETTINGS, TIGHT], ids=["hard limits", "tighter"])
def test_every_joint_has_its_two_bounds(side, joint, settings):
    """Swept from below to above: refused outside with joint, value and bound, or clipped to the bound and reported."""
    low, high = settings.lower_rad[side][joint], settings.upper_rad[side][joint]
    base = tuple((a + b) / 2 for a, b in zip(settings.lower_rad[side], settings.upper_rad[side], strict=True))
    outside = [low - 1.0, math.nextafter(low, -9.0), math.nextafter(high, 9.0), high + 1.0]
    for n in range(41):
        value = low - 0.2 + (high - low + 0.4) * n / 40
        passes = isinstance(validation.check_goal(side, moved(base, joint, value), settings, OnLimit.REJECT), Checked)
        assert passes is (low <= value <= high)
    for value in outside:
        goal = moved(base, joint, value)
        refusal = validation.check_goal(side, goal, settings, OnLimit.REJECT)
        assert facts(refusal) == (
            Code.OUT_OF_RANGE, f"{side}_arm[{joint}]", f"{value:.6g}", f"[{low}, {high}]", "rad",
        )  # fmt: skip
        assert f"{side} arm joint {joint + 1} ({side.value[0]}_joint{joint + 1})" in refusal.message
        assert "§4.13" in refusal.message
        clipped = moved(base, joint, low if value < low else high)
        assert validation.check_goal(side, goal, settings, OnLimit.CLIP) == Checked(values=clipped, clipped=(joint,))


def test_clipping_reports_every_joint_that_it_moved():
    """Rejecting is the rule; clipping is asked for, and said (DESIGN §10)."""
    goal = validation.check_goal(Side.LEFT, (9.0, 0.5, -9.0, 1.0, 0.0, 0.0, 9.0), SETTINGS, OnLimit.CLIP)
    assert goal == Checked(values=(1.8, 0.5, -2.6, 1.0, 0.0, 0.0, 0.7), clipped=(0, 2, 6))


@pytest.mark.parametrize("on_limit", list(OnLimit))
@pytest.mark.parametrize("count", [0, 1, 6, 8, 14])
def test_a_goal_has_seven_values(count, on_limit):
    """The robot refuses fewer and would ignore more (manual §4.10)."""
    refusal = validation.check_goal(Side.RIGHT, (0.0,) * count, SETTINGS, on_limit)
    assert facts(refusal) == (Code.WRONG_SHAPE, "right_arm", str(count), "7", "values")
    assert f"the right arm's goal has {count} values, 7 are needed" in refusal.message


@pytest.mark.parametrize("on_limit", list(OnLimit))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_goal_is_finite_and_infinity_is_never_clipped(value, on_limit):
    """A clipped infinity would be a full swing that nobody meant (manual §4.10)."""
    refusal = validation.check_goal(Side.LEFT, moved(HOME[Side.LEFT], 3, value), SETTINGS, on_limit)
    assert facts(refusal) == (Code.NOT_FINITE, "left_arm[3]", str(value), "[0.25, 2.2]", "rad")
    assert "left arm joint 4 (l_joint4)" in refusal.message


@given(
    side=st.sampled_from(Side),
    q_rad=st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=5, max_size=9),
    on_limit=st.sampled_from(OnLimit),
)
def test_whatever_is_asked_only_seven_finite_values_inside_the_limits_pass(side, q_rad, on_limit):
    """For any input there is a goal inside the limits or a refusal, and never an exception."""
    goal = validation.check_goal(side, q_rad, SETTINGS, on_limit)
    if isinstance(goal, Refusal):
        assert facts(goal)[0] in {Code.WRONG_SHAPE, Code.NOT_FINITE, Code.OUT_OF_RANGE}
        return
    bounds = zip(SETTINGS.lower_rad[side], goal.values, SETTINGS.upper_rad[side], strict=True)
    assert all(low <= q <= high for low, q, high in bounds)
    assert goal.clipped == tuple(n for n, q in enumerate(q_rad) if q != goal.values[n])
    assert on_limit is OnLimit.CLIP or not goal.clipped


# ------------------------------------------------------------------------------------------------------ starts


@pytest.mark.parametrize("side", BOTH)
@pytest.mark.parametrize("joint", range(7))
def test_a_start_may_be_a_little_outside_and_then_begins_at_the_limit(side, joint):
    """Noise at the end of a range: up to 0.05 rad beyond (BEHAVIOUR, values); further out enabling is refused."""
    low, high = SETTINGS.lower_rad[side][joint], SETTINGS.upper_rad[side][joint]
    base = HOME[side]
    for bound, outwards in ((low, -1.0), (high, 1.0)):
        assert validation.check_start(side, moved(base, joint, bound), SETTINGS) == Checked(
            values=moved(base, joint, bound)
        )
        for beyond in (1e-9, 0.01, 0.0499):
            start = validation.check_start(side, moved(base, joint, bound + outwards * beyond), SETTINGS)
            assert start == Checked(values=moved(base, joint, bound), clipped=(joint,))
        for beyond in (0.0501, 0.5, 3.0):
            value = bound + outwards * beyond
            refusal = validation.check_start(side, moved(base, joint, value), SETTINGS)
            assert facts(refusal) == (
                Code.START_OUTSIDE_LIMITS, f"{side}_arm[{joint}]", f"{value:.6g}", f"[{low}, {high}]", "rad",
            )  # fmt: skip
            assert f"{side} arm joint {joint + 1}" in refusal.message and "0.05 rad" in refusal.message


def test_the_margin_of_a_start_is_the_configured_one():
    """It may only be tightened; with none, the limit itself is the bound."""
    strict = ArmSettings(start_margin_rad=0.0)
    assert validation.check_start(Side.LEFT, moved(HOME[Side.LEFT], 0, 1.8), strict) == Checked(
        values=moved(HOME[Side.LEFT], 0, 1.8)
    )
    assert (
        facts(validation.check_start(Side.LEFT, moved(HOME[Side.LEFT], 0, 1.8001), strict))[0]
        is Code.START_OUTSIDE_LIMITS
    )


def test_a_start_reports_every_joint_that_it_moved():
    """Each gets a notice of its own."""
    start = validation.check_start(Side.LEFT, (1.82, 0.5, 0.0, 0.23, 0.0, 0.0, 0.0), SETTINGS)
    assert start == Checked(values=(1.8, 0.5, 0.0, 0.25, 0.0, 0.0, 0.0), clipped=(0, 3))
