"""Validation of poses: what is refused, with code, value, bound and unit; and where an end effector may begin."""

from __future__ import annotations

import math

import pytest

from gateway.core.limits.pose_validation import check_frame, check_pose, check_pose_start, check_pose_tolerance
from gateway.core.limits.validation import Checked
from gateway.core.motion.gap import Gap
from gateway.errors import Code, Refusal
from gateway.messages.incoming import OnLimit
from gateway.settings.settings import PoseSettings
from gateway.values import Side

SETTINGS = PoseSettings()
HERE = (0.3, 0.1, -0.2, 0.0, 0.0, 0.0, 1.0)
NAN = float("nan")


@pytest.mark.parametrize("side", Side)
def test_the_frame_of_the_arm_itself_is_needed(side):
    """The other arm's frame is another place; none is none (manual §4.0.1)."""
    own, other = f"{side}_shoulder_base", f"{'right' if side is Side.LEFT else 'left'}_shoulder_base"
    assert check_frame(side, own) is None
    for wrong in (other, "", "base_link", own.upper()):
        refusal = check_frame(side, wrong)
        assert refusal is not None
        assert (refusal.code, refusal.value, refusal.bound) == (Code.WRONG_FRAME, wrong, own)
        assert refusal.field == f"{side}_arm.frame" and own in refusal.message


@pytest.mark.parametrize(
    ("values", "code", "field", "value"),
    [
        (HERE[:6], Code.WRONG_SHAPE, "left_arm", "6"),
        ((*HERE, 1.0), Code.WRONG_SHAPE, "left_arm", "8"),
        ((0.3, NAN, 0.0, 0.0, 0.0, 0.0, 1.0), Code.NOT_FINITE, "left_arm[1]", "nan"),
        ((*HERE[:6], math.inf), Code.NOT_FINITE, "left_arm[6]", "inf"),
        ((*HERE[:3], 0.0, 0.0, 0.0, 0.0), Code.OUT_OF_RANGE, "left_arm.quat_xyzw", "0"),
        ((*HERE[:3], 0.0, 0.0, 0.0, 1.002), Code.OUT_OF_RANGE, "left_arm.quat_xyzw", "1.002"),
        ((0.4, 0.4, 0.0, 0.0, 0.0, 0.0, 1.0), Code.OUT_OF_RANGE, "left_arm.p_m", "0.565685"),
    ],
)
def test_a_pose_that_is_none_is_refused(values, code, field, value):
    """Shape, finiteness, norm and reach, in this order."""
    refusal = check_pose(Side.LEFT, values, SETTINGS)
    assert isinstance(refusal, Refusal)
    assert (refusal.code, refusal.field, refusal.value) == (code, field, value)


def test_a_pose_inside_the_reach_passes_with_a_unit_quaternion():
    """The position as it is; rounding of the quaternion is taken out, its sign kept."""
    assert check_pose(Side.RIGHT, HERE, SETTINGS) == Checked(values=HERE)
    checked = check_pose(Side.RIGHT, (0.55, 0.0, 0.0, 0.0, 0.0, -0.7072, -0.7072), SETTINGS)
    assert isinstance(checked, Checked) and not checked.clipped
    assert checked.values == pytest.approx((0.55, 0.0, 0.0, 0.0, 0.0, -math.sqrt(0.5), -math.sqrt(0.5)))


def test_clipping_moves_a_position_to_the_end_of_the_reach_when_it_was_asked_for():
    """In the same direction, and it is told; nothing else is clipped."""
    checked = check_pose(Side.LEFT, (0.6, 0.8, 0.0, 0.0, 0.0, 0.0, 1.0), SETTINGS, OnLimit.CLIP)
    assert isinstance(checked, Checked) and checked.clipped == (0, 1, 2)
    assert checked.values[:3] == pytest.approx((0.33, 0.44, 0.0))
    assert math.hypot(*checked.values[:3]) <= 0.55
    assert isinstance(check_pose(Side.LEFT, (*HERE[:3], 0.0, 0.0, 0.0, 0.5), SETTINGS, OnLimit.CLIP), Refusal)


@pytest.mark.parametrize(("reach_m", "start_m"), [(0.3, 0.3), (0.55, 0.55), (0.556, 0.55), (0.56, 0.55)])
def test_a_start_up_to_a_centimetre_beyond_the_reach_begins_at_its_end(reach_m, start_m):
    """Noise at the end of the range, as 0.05 rad of a joint; the gate lets nothing further out leave."""
    start = check_pose_start(Side.LEFT, (0.0, 0.0, -reach_m, 0.0, 0.0, 0.0, 1.0), SETTINGS)
    assert isinstance(start, Checked)
    assert start.values[2] == pytest.approx(-start_m, abs=1e-9)
    assert bool(start.clipped) is (reach_m > start_m) and math.hypot(*start.values[:3]) <= 0.55


def test_a_start_further_out_is_refused():
    """With value, bound and unit."""
    refusal = check_pose_start(Side.RIGHT, (0.0, 0.0, -0.5601, 0.0, 0.0, 0.0, 1.0), SETTINGS)
    assert isinstance(refusal, Refusal)
    assert (refusal.code, refusal.field) == (Code.START_OUTSIDE_LIMITS, "right_arm.p_m")
    assert (refusal.value, refusal.bound, refusal.unit) == ("0.5601", "[0, 0.55]", "m")


def test_tolerances_are_the_asked_ones_or_the_configured_ones():
    """5 mm and 0.05 rad; tighter on request, each on its own."""
    assert check_pose_tolerance(None, None, SETTINGS) == Gap(0.05, 0.005)
    assert check_pose_tolerance(0.001, None, SETTINGS) == Gap(0.05, 0.001)
    assert check_pose_tolerance(None, 0.01, SETTINGS) == Gap(0.01, 0.005)


@pytest.mark.parametrize(
    ("tolerances", "code", "field"),
    [
        ((0.06, None), Code.OUT_OF_RANGE, "tolerance_m"),
        ((1e-5, None), Code.OUT_OF_RANGE, "tolerance_m"),
        ((NAN, None), Code.NOT_FINITE, "tolerance_m"),
        ((None, 0.3), Code.OUT_OF_RANGE, "tolerance_rad"),
        ((0.001, math.inf), Code.NOT_FINITE, "tolerance_rad"),
    ],
)
def test_a_tolerance_that_means_nothing_is_refused(tolerances, code, field):
    """Nor one that everything keeps."""
    refusal = check_pose_tolerance(*tolerances, SETTINGS)
    assert isinstance(refusal, Refusal) and (refusal.code, refusal.field) == (code, field)
