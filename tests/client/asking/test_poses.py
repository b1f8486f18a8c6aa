"""Poses as a user says them: refused where they are made, with the code that the daemon would give."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.api import translate
from gateway.client.asking.poses import PoseTarget, frame_of, move_pose, numbers, require_space, within_reach
from gateway.core.limits.pose_validation import check_pose
from gateway.errors import Code, Rejected
from gateway.settings.settings import PoseSettings, Settings
from gateway.values import Side

INFO = translate.describe(Settings(), socket="", pid=1)
UNIT = (0.0, 0.0, 0.0, 1.0)
LEFT = "left_shoulder_base"


def refusal(call, *args, **how):
    """The exception of a call that must be refused."""
    with pytest.raises(Rejected) as caught:
        call(*args, **how)
    return caught.value


@pytest.mark.parametrize(
    ("p", "quat", "code"),
    [
        ((0.1, 0.2), UNIT, Code.WRONG_SHAPE),
        ((0.1, 0.2, 0.3), (0.0, 0.0, 1.0), Code.WRONG_SHAPE),
        ("here", UNIT, Code.WRONG_SHAPE),
        (("0.1", "0.2", "0.3"), UNIT, Code.WRONG_SHAPE),
        ((0.1, 0.2, None), UNIT, Code.NOT_FINITE),
        ((0.1, 0.2, 0.3), (False, False, False, True), Code.WRONG_SHAPE),
        ((0.1, 0.2, 10**400), UNIT, Code.WRONG_SHAPE),
        ((0.1, math.nan, 0.3), UNIT, Code.NOT_FINITE),
        ((0.1, 0.2, 0.3), (0.0, 0.0, math.inf, 0.0), Code.NOT_FINITE),
        ((0.1, 0.2, 0.3), (0.0, 0.0, 0.0, 1.01), Code.OUT_OF_RANGE),
    ],
)
def test_what_is_no_pose_is_rejected(p, quat, code):
    """Shape, finiteness, norm."""
    assert refusal(numbers, "left", p, quat).code is code


def test_a_pose_may_be_anything_that_numpy_takes():
    """Lists, tuples, arrays."""
    assert numbers("left", np.array([0.1, 0.2, 0.3]), [0, 0, 0, -1]) == (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, -1.0)


@pytest.mark.parametrize("frame", [None, "", "right_shoulder_base", "base"])
def test_the_frame_of_the_arm_must_be_named(frame):
    """None, or another one: WRONG_FRAME with the right one."""
    error = refusal(frame_of, "left", frame)
    assert error.code is Code.WRONG_FRAME and LEFT in error.message
    assert frame_of("left", LEFT) == LEFT


@pytest.mark.parametrize("p", [(0.55, 0.0, 0.0), (0.3, 0.3, 0.3), (0.4, 0.4, 0.0), (9.0, 0.0, 0.0)])
def test_the_reach_is_judged_as_the_daemon_does(p):
    """The same code and bound; clipped the same way."""
    values = (*p, *UNIT)
    theirs = check_pose(Side.LEFT, values, PoseSettings())
    if math.hypot(*p) <= 0.55:
        assert within_reach("left", values, INFO, "reject") == values == theirs.values
        return
    error = refusal(within_reach, "left", values, INFO, "reject")
    assert (error.code, error.field, error.value, error.bound) == (
        theirs.code,
        theirs.field,
        theirs.value,
        theirs.bound,
    )
    assert math.hypot(*within_reach("left", values, INFO, "clip")[:3]) == pytest.approx(0.55)


def test_a_request_names_each_arm_with_its_frame():
    """Both arms in one request, the left one first."""
    targets = {side: PoseTarget((0.3, 0.0, 0.0), UNIT, f"{side}_shoulder_base") for side in ("right", "left")}
    request = move_pose(3, targets, speed=0.5, tolerance_m=0.001, tolerance_rad=None, on_limit="reject")
    assert list(request.targets) == ["left", "right"] == list(request.frames)
    assert (request.epoch, request.speed, request.tolerance_m) == (3, 0.5, 0.001)
    assert not request.straight
    how = {"speed": 1.0, "tolerance_m": None, "tolerance_rad": None, "on_limit": "reject"}
    assert move_pose(3, targets, straight=True, **how).straight


@pytest.mark.parametrize("targets", [{}, {"middle": PoseTarget((0.3, 0.0, 0.0), UNIT, LEFT)}])
def test_a_motion_needs_an_arm_that_there_is(targets):
    """None, or an unknown one."""
    how = {"speed": 1.0, "tolerance_m": None, "tolerance_rad": None, "on_limit": "reject"}
    assert refusal(move_pose, 1, targets, **how).code is Code.WRONG_SHAPE


@pytest.mark.parametrize("goal", [[0.3, 0.0, 0.0, *UNIT], None, np.zeros(7)], ids=["list", "none", "array"])
def test_a_goal_that_is_no_pose_is_rejected_with_what_it_needs(goal):
    """Seven numbers do not say in which frame they are."""
    how = {"speed": 1.0, "tolerance_m": None, "tolerance_rad": None, "on_limit": "reject"}
    refused = refusal(move_pose, 1, {"left": goal}, **how)
    assert (refused.code, refused.field) == (Code.WRONG_SHAPE, "left_arm") and "PoseTarget" in refused.hint


@pytest.mark.parametrize("name", ["speed", "tolerance_m", "tolerance_rad"])
@pytest.mark.parametrize("value", ["0.5", True, np.bool_(1)])
def test_a_text_or_a_truth_value_is_no_number(name, value):
    """Neither is converted: a full speed must have been meant."""
    how = {"speed": 1.0, "tolerance_m": None, "tolerance_rad": None, "on_limit": "reject", name: value}
    error = refusal(move_pose, 1, {"left": PoseTarget((0.3, 0.0, 0.0), UNIT, LEFT)}, **how)
    assert (error.code, error.field) == (Code.BAD_REQUEST, name)


def test_there_are_two_spaces_and_a_hand_that_yields():
    """Joint and pose."""
    require_space("pose")
    require_space("admittance", yields=True)
    assert refusal(require_space, "pose", yields=True).code is Code.BAD_REQUEST
    assert refusal(require_space, "torque").code is Code.BAD_REQUEST
