"""How far two setpoints are apart, in joint space and in pose space."""

from __future__ import annotations

import math

import pytest

from gateway.core.motion.gap import Gap, gap
from gateway.values import Space

HERE = (0.3, 0.1, -0.2, 0.0, 0.0, 0.0, 1.0)


def test_joints_are_as_far_apart_as_the_worst_of_them():
    """In either direction."""
    assert gap(Space.JOINT, (0.0,) * 7, (0.1, -0.4, 0.0, 0.0, 0.0, 0.0, 0.2)) == Gap(0.4)


def test_poses_are_apart_by_distance_and_by_angle():
    """Both signs of a quaternion are the same orientation."""
    there = (0.3, 0.13, -0.24, 0.0, 0.0, -math.sin(0.1), -math.cos(0.1))
    assert gap(Space.POSE, HERE, there) == pytest.approx(Gap(0.2, 0.05))


@pytest.mark.parametrize(("rad", "m", "beyond"), [(0.3, 0.06, False), (0.31, 0.0, True), (0.0, 0.061, True)])
def test_a_bound_is_exceeded_in_either(rad, m, beyond):
    """At the bound it is not."""
    assert Gap(rad, m).exceeds(Gap(0.3, 0.06)) is beyond


def test_the_worst_of_two_is_the_worst_of_each():
    """Distance and angle on their own."""
    assert Gap(0.1, 0.4).worst(Gap(0.2, 0.3)) == Gap(0.2, 0.4)


def test_a_gap_is_told_in_the_units_of_its_space():
    """No metres where there are joints."""
    assert Gap(0.0312, 0.012).text(Space.JOINT) == "0.0312 rad"
    assert Gap(0.0312, 0.012).text(Space.POSE) == "0.012 m and 0.0312 rad"
