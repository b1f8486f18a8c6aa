"""The door for chunks of poses: each way in which they cannot be followed has its code, and names the first pose."""

from __future__ import annotations

import math

import pytest

from gateway.core.motion.poses.pose_chunk import JUMP_M, check_pose, check_pose_jump, check_pose_motion
from gateway.core.motion.poses.pose_trajectory import interpolate_poses
from gateway.errors import Code
from gateway.values import Side
from tests.core.pose_judge import HOME, about

LEFT = Side.LEFT
BOUNDS = (0.55, 0.25, 1.5, 0.8, 5.0)


@pytest.mark.parametrize(
    ("pose", "code", "field"),
    [
        (HOME[:6], Code.WRONG_SHAPE, "left_arm[4]"),
        ((*HOME[:2], math.nan, *HOME[3:]), Code.NOT_FINITE, "left_arm[4][2]"),
        ((*HOME[:6], math.inf), Code.NOT_FINITE, "left_arm[4][6]"),
        ((0.5, 0.3, 0.0, *HOME[3:]), Code.OUT_OF_RANGE, "left_arm[4]"),
        ((*HOME[:6], 0.94), Code.OUT_OF_RANGE, "left_arm[4][3]"),
        ((*HOME[:3], 0.0, 0.0, 0.0, 0.0), Code.OUT_OF_RANGE, "left_arm[4][3]"),
    ],
)
def test_what_is_no_pose_in_reach_is_refused(pose, code, field):
    """Shape, finiteness, reach (manual §4.0.4), norm."""
    refusal = check_pose(LEFT, 4, pose)
    assert (refusal.code, refusal.field) == (code, field) and "point 4" in refusal.message


def test_a_pose_of_nearly_unit_norm_passes():
    """Policies regress the components; they are normalised."""
    assert check_pose(LEFT, 0, HOME) is None and check_pose(LEFT, 0, (*HOME[:6], 1.04)) is None


def motion(dx_m=0.0, turn_rad=0.0, bend_m=0.0, count=12):
    """Judge an even motion at 10 Hz with a step of so much per pose, which bends half-way."""
    poses = [
        (0.3 + dx_m * n, 0.1 + bend_m * max(n - 6, 0), -0.2, *about((0.0, 0.0, 1.0), turn_rad * n))
        for n in range(count)
    ]
    return check_pose_motion(LEFT, interpolate_poses(poses, [0.1 * n for n in range(count)]), BOUNDS)


def test_a_motion_inside_all_limits_passes():
    """Half the speed limits."""
    assert motion(0.012, 0.04) is None


@pytest.mark.parametrize(
    ("how", "unit", "stretch"),
    [({"dx_m": 0.03}, "m/s", 1.2), ({"turn_rad": 0.1}, "rad/s", 1.25), ({"bend_m": 0.02}, "m/s²", 1.52)],
)
def test_too_fast_a_motion_names_value_bound_and_the_stretch_that_would_do(how, unit, stretch):
    """Linear and angular speed and the bend, as norms."""
    refusal = motion(**how)
    assert refusal.code is Code.TOO_FAST and refusal.unit == unit
    assert float(refusal.hint.split("stretch=")[1].split(" ")[0]) == pytest.approx(stretch, rel=0.08)


def test_a_motion_that_leaves_the_configured_reach_is_refused():
    """At its first pose outside, or on the way there; stretching is no help."""
    refusal = motion(0.024, count=12)
    assert (refusal.code, refusal.unit) == (Code.OUT_OF_RANGE, "m") and "stretch" not in refusal.hint
    assert refusal.field in {"left_arm[8]", "left_arm[9]"}


def test_a_chunk_may_begin_two_centimetres_from_the_reference():
    """And a tenth of a radian; not a hair more."""
    x, y, z, *quat = HOME
    assert check_pose_jump(LEFT, (x + JUMP_M, y, z, *quat), HOME) is None
    far = check_pose_jump(LEFT, (x + 0.021, y, z, *quat), HOME)
    assert (far.code, far.unit, far.bound) == (Code.JUMP_TOO_FAR, "m", "0.02")
    turned = check_pose_jump(LEFT, (x, y, z, *about((1.0, 0.0, 0.0), 0.11)), HOME)
    assert (turned.code, turned.unit, turned.bound) == (Code.JUMP_TOO_FAR, "rad", "0.1")
