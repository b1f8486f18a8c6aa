"""A straight way: the position on the line, the orientation on the shorter arc, the same part of both."""

from __future__ import annotations

import math

import pytest

from gateway.core.motion.lines.line import line_to
from gateway.kinematics.placement import Placement, turn_rad
from gateway.values import EePose

BEGIN = EePose(p_m=(0.3, 0.1, -0.2), quat_xyzw=(0.0, 0.0, 0.0, 1.0))


def test_the_ends_of_a_line_are_its_poses_and_its_middle_lies_half_way():
    """A quarter turn about z and a way along x: half of both in the middle."""
    half = math.sqrt(0.5)
    end = EePose(p_m=(0.4, 0.1, -0.2), quat_xyzw=(0.0, 0.0, half, half))
    line = line_to(BEGIN, end)
    for part, pose in ((0.0, BEGIN), (1.0, end)):
        assert line.at(part).p_m == pytest.approx(pose.p_m, abs=1e-15)
        assert math.hypot(*turn_rad(line.at(part).rows, Placement.of(pose).rows)) < 1e-12
    assert line.at(0.5).p_m == pytest.approx((0.35, 0.1, -0.2))
    assert turn_rad(Placement.of(BEGIN).rows, line.at(0.5).rows) == pytest.approx((0.0, 0.0, math.pi / 4.0))
    assert (line.length_m, line.angle_rad) == pytest.approx((0.1, math.pi / 2.0))


def test_both_signs_of_a_quaternion_are_the_same_goal():
    """The turn is the shorter one, whatever the sign that a user gives."""
    end = EePose(p_m=(0.3, 0.1, -0.2), quat_xyzw=(0.0, 0.0, -math.sin(0.1), -math.cos(0.1)))
    assert line_to(BEGIN, end).turned_rad == pytest.approx((0.0, 0.0, 0.2))
