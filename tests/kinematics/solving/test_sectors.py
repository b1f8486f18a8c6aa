"""Circle and sectors: the self-motion of a pose, and the arm angles that limits leave of it, against brute force."""

from __future__ import annotations

import math

import pytest

from gateway.kinematics.placement import Placement, rows_from_rpy
from gateway.kinematics.solving.circle import Circle, arm_angle_rad, elbows, wrist_of
from gateway.kinematics.solving.sectors import sectors, windows
from gateway.values import Side
from tests.kinematics.bodies import ARMS, difference, samples
from tests.thoroughness import either

STEP = math.radians(0.5)


def circles(side: Side, q) -> list[Circle]:
    """Both circles of the pose of a configuration."""
    shape = ARMS[side].shape
    line, wrist = wrist_of(shape, ARMS[side].chain.forward(q))
    return [Circle(shape, side, line, wrist, elbow) for elbow in elbows(shape, math.hypot(*line))]


def axes(side: Side, angles) -> tuple[float, ...]:
    """Joint angles as angles about the coordinate axes, or back."""
    return tuple(s * a for s, a in zip(ARMS[side].shape.signs, angles, strict=True))


def limits(side: Side) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The limits about the coordinate axes."""
    lower, upper = axes(side, ARMS[side].lower_rad), axes(side, ARMS[side].upper_rad)
    return tuple(map(min, lower, upper)), tuple(map(max, lower, upper))


@pytest.mark.parametrize("side", list(Side))
def test_every_arm_angle_of_every_branch_holds_the_end_effector_where_it_is(side):
    """Eight branches, any arm angle: the same pose to rounding, and the arm angle is the one asked for."""
    arm = ARMS[side]
    for number, q in enumerate(samples(side, 50)):
        target = arm.chain.forward(q)
        for circle in circles(side, q):
            for shoulder in (1.0, -1.0):
                for wrist in (1.0, -1.0):
                    asked = -3.0 + 0.12 * number
                    angles, _ = circle.at(asked, shoulder, wrist)
                    assert max(difference(arm.chain.forward(axes(side, angles)), target)) < 1e-12
                    assert math.remainder(arm_angle_rad(arm.shape, side, angles) - asked, math.tau) == pytest.approx(
                        0, abs=1e-9
                    )


@pytest.mark.parametrize("side", list(Side))
def test_a_configuration_lies_on_the_circle_of_its_pose(side):
    """At its own arm angle, one of the eight branches is the configuration itself."""
    for q in samples(side, 100):
        a = axes(side, q)
        at = arm_angle_rad(ARMS[side].shape, side, a)
        branches = [c.at(at, s, w)[0] for c in circles(side, q) for s in (1.0, -1.0) for w in (1.0, -1.0)]
        assert min(max(abs(x - y) for x, y in zip(a, branch, strict=True)) for branch in branches) < 1e-9


@pytest.mark.parametrize("side", list(Side))
def test_the_rates_are_what_finite_differences_give(side):
    """How fast each joint turns as the elbow is lifted."""
    for q in samples(side, 50):
        for circle in circles(side, q):
            for branch in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
                behind, ahead = circle.at(0.7 - 1e-7, *branch)[0], circle.at(0.7 + 1e-7, *branch)[0]
                for x, y, rate in zip(behind, ahead, circle.at(0.7, *branch)[1], strict=True):
                    assert math.remainder(y - x, math.tau) / 2e-7 == pytest.approx(rate, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("side", list(Side))
def test_the_elbow_hangs_below_at_zero_and_is_lifted_outward(side):
    """With the wrist straight ahead: below at 0, at the arm's own side at a right angle, above at half a turn."""
    arm = ARMS[side]
    out = 1.0 if side is Side.LEFT else -1.0
    target = Placement((0.4, 0.0, 0.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    for angle, wanted in ((0.0, (0.0, -1.0)), (math.pi / 2, (out, 0.0)), (math.pi, (0.0, 1.0))):
        for branch in arm.branches(target.pose, angle):
            _, y, z = _elbow(arm, branch.q_rad)
            length = math.hypot(y, z)
            assert (y / length, z / length) == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize(
    "wrist_m", [(-0.4, 0.0, 0.0), (-0.4, 1e-9, 0.0), (-0.4, 0.0, -1e-5), (0.0, 0.4, 0.0), (0.0, 0.0, -0.4)]
)
def test_a_wrist_straight_behind_or_along_an_axis_is_reached_as_exactly(side, wrist_m):
    """Straight behind, "below" has no direction of its own; one is chosen, and the poses are right."""
    arm = ARMS[side]
    target = Placement(wrist_m, rows_from_rpy((0.3, -0.2, 0.5)))
    branches = [branch for n in range(24) for branch in arm.branches(target.pose, n * math.tau / 24)]
    assert len(branches) == 24 * 8
    assert max(max(difference(arm.chain.forward(branch.q_rad), target)) for branch in branches) < 1e-12


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize("off", [0.0, 1e-13, 1e-9, 1e-6, 1e-4])
def test_axes_in_one_line_take_nothing_from_the_accuracy(side, off):
    """Axes 1 and 3, or 5 and 7, nearly one: only the sum of their angles is known, and it is known exactly."""
    arm = ARMS[side]
    for q in samples(side, 20, seed=3):
        for number, straight in ((1, 0.0), (5, math.pi / 2)):
            bent = [straight + off if n == number else v for n, v in enumerate(q)]
            target = arm.chain.forward(bent)
            branches = arm.branches(target.pose, arm.arm_angle_rad(bent))
            assert max(max(difference(arm.chain.forward(branch.q_rad), target)) for branch in branches) < 3e-10


def _elbow(arm, q) -> tuple[float, float, float]:
    """A point on the elbow's axis in the shoulder frame, in the arm's plane."""
    (ux, uy), shape = arm.shape.upper_m, arm.shape
    a1, a2, a3 = (s * a for s, a in zip(shape.signs[:3], q[:3], strict=True))
    c1, s1, c2, s2, c3, s3 = math.cos(a1), math.sin(a1), math.cos(a2), math.sin(a2), math.cos(a3), math.sin(a3)
    first = Placement((0.0, 0.0, 0.0), ((c1, 0.0, s1), (0.0, 1.0, 0.0), (-s1, 0.0, c1)))
    second = Placement((0.0, 0.0, 0.0), ((1.0, 0.0, 0.0), (0.0, c2, -s2), (0.0, s2, c2)))
    third = Placement((0.0, 0.0, 0.0), ((c3, 0.0, s3), (0.0, 1.0, 0.0), (-s3, 0.0, c3)))
    return first.after(second).after(third).point((ux, uy, 0.0))


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize("widening", [0.0, 1.0])
def test_sectors_are_the_arm_angles_at_which_no_joint_is_out(side, widening):
    """Tried at every half degree, with the robot's limits and with ones so wide that all branches are open."""
    lower, upper = limits(side)
    lower, upper = tuple(max(v - widening, -3.1) for v in lower), tuple(min(v + widening, 3.1) for v in upper)
    open_ways = windows(lower, upper)
    assert len(open_ways) == (6 if widening else 1)
    inside = 0
    for q in samples(side, either(8, 25), seed=1):
        for circle in circles(side, q):
            for way in open_ways:
                found = sectors(circle, way)
                for number in range(720):
                    angle = -math.pi + number * STEP
                    angles, _ = circle.at(angle, way.shoulder, way.wrist)
                    margin = min(
                        min(a - low, high - a)
                        for joint, (a, low, high) in enumerate(zip(angles, way.lower, way.upper, strict=True))
                        if joint != 3
                    )
                    if abs(margin) > 1e-9:
                        is_in = any((angle - begin) % math.tau <= end - begin for begin, end in found)
                        assert is_in == (margin > 0.0)
                        inside += margin > 0.0
    assert inside > 100
