"""Tests of rectification: rows agree, disparity is depth, what cannot rectify is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.kinematics.cameras.lens import Pinhole
from gateway.kinematics.cameras.stereo import StereoPair, level_pinhole, rectified_by, turned_level
from gateway.kinematics.transform import Points, Transform
from gateway.values import ValueRefused
from tests.kinematics.lenses import example_lens, skewed_pair
from tests.kinematics.test_transform import random_transform

LEFT = "head_left_camera"


def seen_level(pair, rectification, xyz_m):
    """Return pixels of points of the left eye in both levelled pictures."""
    right = (pair.right_T_left @ Points(LEFT, xyz_m)).xyz_m
    return (
        rectification.pinhole.project(xyz_m @ rectification.level_R_left.T).px,
        rectification.pinhole.project(right @ rectification.level_R_right.T).px,
    )


@pytest.fixture
def points():
    """Things in front of the head, 0.2 to 5 m away."""
    rng = np.random.default_rng(1)
    return np.stack((rng.uniform(-0.6, 0.6, 500), rng.uniform(-0.6, 0.6, 500), np.ones(500)), -1) * rng.uniform(
        0.2, 5.0, (500, 1)
    )


def test_a_point_is_in_one_row_and_its_disparity_is_its_depth(points):
    """Whatever the eyes' mounting: v equal in both pictures, z = f b / (u_left − u_right)."""
    pair = skewed_pair()
    rectification = turned_level(pair)
    left, right = seen_level(pair, rectification, points)
    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=1e-9)
    depth = (points @ rectification.level_R_left.T)[:, 2]
    np.testing.assert_allclose(rectification.depth_m(left[:, 0] - right[:, 0]), depth, rtol=1e-9)
    assert rectification.baseline_m == pytest.approx(np.linalg.norm(pair.right_T_left.p_m))


def test_the_eyes_turn_as_little_as_possible():
    """Parallel level eyes are not turned at all; else each by half of what lies between, and the rest for both."""
    level = StereoPair(
        left=example_lens(),
        right=example_lens(),
        right_T_left=Transform.of("head_right_camera_T_head_left_camera", p_m=(-0.065, 0, 0)),
    )
    rectification = turned_level(level)
    np.testing.assert_allclose(rectification.level_R_left, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(rectification.level_R_right, np.eye(3), atol=1e-15)
    pair = skewed_pair()
    found = turned_level(pair)
    between = Transform.of("a_T_b", rotation=found.level_R_right.T @ found.level_R_left)
    given = Transform.of("a_T_b", rotation=pair.right_T_left.rotation)
    assert between.angle_to_rad(given) < 1e-12
    still = Transform.of("a_T_b")
    turns = [still.angle_to_rad(Transform.of("a_T_b", rotation=r)) for r in (found.level_R_left, found.level_R_right)]
    assert max(turns) < 0.06


def test_turns_that_a_file_brings_are_used_when_they_rectify(points):
    """Any common roll about the baseline is a rectification, too (RRawL_Row, RRawR_Row of §5.5)."""
    pair = skewed_pair()
    own = turned_level(pair)
    roll = Transform.of_quaternion("a_T_b", (0, 0, 0), (math.sin(0.05), 0, 0, math.cos(0.05))).rotation
    brought = rectified_by(pair, roll @ own.level_R_left, roll @ own.level_R_right)
    left, right = seen_level(pair, brought, points)
    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=1e-9)
    np.testing.assert_allclose(brought.depth_m(left[:, 0] - right[:, 0]), (points @ brought.level_R_left.T)[:, 2])


def test_turns_that_do_not_rectify_are_refused():
    """The other way round, of other eyes, or no turns at all."""
    pair = skewed_pair()
    own = turned_level(pair)
    with pytest.raises(ValueRefused, match="rows and columns swapped"):
        rectified_by(pair, own.level_R_left.T, own.level_R_right.T)
    with pytest.raises(ValueRefused, match="from parallel and level"):
        rectified_by(pair, own.level_R_right, own.level_R_left)
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    with pytest.raises(ValueRefused, match="from parallel and level"):
        rectified_by(pair, quarter @ own.level_R_left, quarter @ own.level_R_right)
    for bad in (2 * np.eye(3), np.diag([1.0, 1.0, -1.0])):
        with pytest.raises(ValueRefused, match="RRawL_Row is no rotation"):
            rectified_by(pair, bad, own.level_R_right)


@pytest.mark.parametrize("p_m", [(0.065, 0, 0), (0, -0.065, 0), (0, 0, -0.065), (0.0, 0.0, 0.0)])
def test_the_right_eye_is_on_the_right(p_m):
    """R | T the other way round, or swapped eyes, would turn every depth inside out: refused."""
    with pytest.raises(ValueRefused, match="not to its right"):
        StereoPair(left=example_lens(), right=example_lens(), right_T_left=Transform.of("r_T_l", p_m=p_m))


def test_no_disparity_is_infinitely_far():
    """Zero and negative disparities have no finite depth, and no warning."""
    found = turned_level(skewed_pair()).depth_m(np.array([0.0, -1.0, 2.0]))
    assert np.isinf(found[:2]).all() and np.isfinite(found[2])


def test_a_levelled_picture_has_the_field_of_view_asked_for():
    """The outermost columns look half of it aside; π and more is no pinhole."""
    pinhole = turned_level(skewed_pair(), math.radians(100)).pinhole
    assert isinstance(pinhole, Pinhole) and pinhole.intrinsics.size_px == (960, 960)
    edge = pinhole.rays((959.5, 479.5))
    assert math.atan2(edge[0], edge[2]) == pytest.approx(math.radians(50))
    for angle in (0.0, math.pi, math.nan):
        with pytest.raises(ValueRefused, match="less than π"):
            level_pinhole(960, 960, angle)


def test_rectification_holds_for_any_mounting():
    """Random mounts up to 15° apart: after levelling the eyes are parallel and the baseline is the row."""
    rng = np.random.default_rng(6)
    for _ in range(100):
        turn = random_transform(rng).rotation
        axis = turn[:, 0]
        half = 0.5 * rng.uniform(0, math.radians(15))
        rotation = Transform.of_quaternion("a_T_b", (0, 0, 0), (*(axis * math.sin(half)), math.cos(half))).rotation
        p_m = np.array([-0.06, *rng.uniform(-0.01, 0.01, 2)])
        pair = StereoPair(
            left=example_lens(), right=example_lens(), right_T_left=Transform.of("r_T_l", p_m=p_m, rotation=rotation)
        )
        found = turned_level(pair)
        np.testing.assert_allclose(found.level_R_right @ rotation, found.level_R_left, atol=1e-12)
        np.testing.assert_allclose(-found.level_R_right @ p_m, (np.linalg.norm(p_m), 0, 0), atol=1e-12)
