"""Tolerances per joint: what may be asked for, what stands where nothing is asked, and which joint is the first beyond."""

from __future__ import annotations

import math

import pytest

from gateway.core.motion.tolerance import Deviation, Tolerances, check_tolerances, first_beyond
from gateway.errors import Code, Refusal
from gateway.settings.settings import ArmSettings
from gateway.values import Side, Space

LEFT, RIGHT = Side.LEFT, Side.RIGHT
ARM = ArmSettings()
BOTH = (LEFT, RIGHT)
JOINT = Space.JOINT
S = 1_000_000_000
ALL = (0.2,) * 7


def check(path=None, goal=None, goal_time_ns=None, sides=BOTH):
    """Check tolerances with the usual settings."""
    settled = (ARM.settle_rad,) * 7
    return check_tolerances(sides, path or {}, goal or {}, goal_time_ns, settled, ARM.settle_timeout_ns)


def check_pose(path=None, goal=None):
    """Check tolerances of the left end effector."""
    return check_tolerances((LEFT,), path or {}, goal or {}, None, (0.005, 0.05), S, Space.POSE)


def test_without_any_the_configured_ones_hold_at_the_end_and_none_on_the_way():
    """Path infinite, goal and time as a move's."""
    made = check()
    assert isinstance(made, Tolerances)
    assert made.path == {LEFT: (math.inf,) * 7, RIGHT: (math.inf,) * 7}
    assert made.goal == {LEFT: (ARM.settle_rad,) * 7, RIGHT: (ARM.settle_rad,) * 7}
    assert made.goal_time_ns == ARM.settle_timeout_ns


def test_each_joint_of_each_arm_may_have_its_own():
    """Taken joint by joint, in the order of the joints; an arm without any has the usual ones."""
    goal = tuple(0.01 * (n + 1) for n in range(7))
    made = check({LEFT: ALL}, {RIGHT: goal}, 2_000_000_000)
    assert made.path == {LEFT: ALL, RIGHT: (math.inf,) * 7}
    assert made.goal == {LEFT: (ARM.settle_rad,) * 7, RIGHT: goal}
    assert made.goal_time_ns == 2_000_000_000


def test_a_joint_can_be_left_out():
    """None: no tolerance on the way, the configured one at the end."""
    some = (0.1, None, None, None, None, None, 0.3)
    made = check({LEFT: some}, {LEFT: some}, sides=(LEFT,))
    assert made.path[LEFT] == (0.1, *[math.inf] * 5, 0.3)
    assert made.goal[LEFT] == (0.1, *[ARM.settle_rad] * 5, 0.3)


@pytest.mark.parametrize(
    ("value", "code"),
    [
        (-123.0, Code.OUT_OF_RANGE),
        (0.0, Code.OUT_OF_RANGE),
        (0.51, Code.OUT_OF_RANGE),
        (math.nan, Code.NOT_FINITE),
        (math.inf, Code.NOT_FINITE),
    ],
)
@pytest.mark.parametrize("kind", ["path", "goal"])
def test_a_tolerance_that_is_none_is_refused(kind, value, code):
    """Negative, zero, too large, not finite: with the joint to blame; the defaults are never silently used instead."""
    refusal = check(**{kind: {RIGHT: (0.1, 0.1, value, 0.1, 0.1, 0.1, 0.1)}})
    assert isinstance(refusal, Refusal) and refusal.code is code
    assert refusal.field == f"{kind}_tolerance.right[2]" and refusal.unit == "rad" and "joint 3" in refusal.message


@pytest.mark.parametrize("count", [0, 1, 6, 8])
def test_a_wrong_number_of_tolerances_is_refused(count):
    """A joint each."""
    refusal = check({LEFT: (0.1,) * count})
    assert (refusal.code, refusal.field, refusal.value) == (Code.WRONG_SHAPE, "path_tolerance.left", str(count))


def test_a_tolerance_for_an_arm_that_does_not_move_is_refused():
    """Rather than ignored."""
    refusal = check(goal={RIGHT: ALL}, sides=(LEFT,))
    assert (refusal.code, refusal.field) == (Code.WRONG_SHAPE, "goal_tolerance.right")


@pytest.mark.parametrize("goal_time_ns", [-1, 0, 99_999_999, 60_000_000_001])
def test_a_goal_time_outside_its_bounds_is_refused(goal_time_ns):
    """0.1 s to 60 s: setpoints leave every 10 ms, and the last of them a little after the planned end."""
    refusal = check(goal_time_ns=goal_time_ns)
    assert (refusal.code, refusal.field, refusal.unit) == (Code.OUT_OF_RANGE, "goal_time_ns", "s")


def test_the_first_joint_beyond_its_own_tolerance_is_named():
    """Exactly at the tolerance is within; a value that is no number is not."""
    wanted, bounds = (0.0,) * 7, (0.1, 0.1, 0.01, 0.5, 0.1, 0.1, 0.1)
    assert first_beyond(JOINT, wanted, (0.1, -0.1, 0.01, 0.5, 0.0, 0.0, 0.0), bounds) is None
    off = first_beyond(JOINT, wanted, (0.0, 0.0, -0.02, 0.6, 0.0, 0.0, 0.0), bounds)
    assert off == Deviation(part="joint 3", off=0.02, bound=0.01, unit="rad") and str(off) == "joint 3 is 0.0200 rad"
    assert first_beyond(JOINT, wanted, (0.0, math.nan, 0.0, 0.0, 0.0, 0.0, 0.0), bounds).part == "joint 2"


def test_a_pose_has_a_tolerance_of_its_position_and_one_of_its_orientation():
    """Two values, metres and radians; each may be left out."""
    made = check_pose({LEFT: (0.02, None)}, {LEFT: (None, 0.1)})
    assert (made.path, made.goal, made.space) == ({LEFT: (0.02, math.inf)}, {LEFT: (0.005, 0.1)}, Space.POSE)
    assert check_pose({LEFT: ALL}).code is Code.WRONG_SHAPE
    assert check_pose({LEFT: (0.6, 0.1)}).unit == "m" and "position" in check_pose({LEFT: (0.6, 0.1)}).message
    turned = (0.3, 0.0, 0.04, 0.0, 0.0, math.sin(0.1), math.cos(0.1))
    wanted = (0.3, 0.03, 0.0, 0.0, 0.0, 0.0, 1.0)
    assert first_beyond(Space.POSE, wanted, turned, (0.051, 0.21)) is None
    off = first_beyond(Space.POSE, wanted, turned, (0.049, 0.1))
    assert (off.part, off.unit) == ("position", "m") and off.off == pytest.approx(0.05)
    off = first_beyond(Space.POSE, wanted, turned, (0.051, 0.19))
    assert (off.part, off.unit) == ("orientation", "rad") and off.off == pytest.approx(0.2)
