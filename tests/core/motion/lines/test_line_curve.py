"""Joints along a line: on it everywhere, inside their limits, each place beside the one before; else where it ends."""

from __future__ import annotations

import random

import pytest

from gateway.core.motion.lines.line import line_to
from gateway.core.motion.lines.line_curve import OFF_M, OFF_RAD, Coarse, parts_for, place, solve
from gateway.core.motion.lines.line_elbow import Elbow, chosen
from gateway.errors import Code, Refusal
from gateway.kinematics.arm import ArmModel
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side
from tests.changed import replace
from tests.core.lines import HOME, LIMITS, beside, finished, off_line, random_way
from tests.kinematics.bodies import ARMS, difference, nudged
from tests.thoroughness import either

L = Side.LEFT


def solved(target, q_rad=HOME_Q_RAD[L], side=L, finer=1, limits=None):
    """Joints along the line to a pose, and the line."""
    line = line_to(ARMS[side].forward(q_rad), target)
    limits = limits or LIMITS[side]
    elbow, _ = finished(chosen(ARMS[side], line, q_rad, limits))
    return finished(solve(side, ARMS[side], line, elbow, q_rad, parts_for([line], finer), limits))[0], line


def test_places_are_near_to_each_other_and_nearer_at_the_ends():
    """A centimetre or 0.04 rad from place to place; a short way has twelve steps, a long one is not cut without end."""
    half_metre = line_to(HOME[L], beside(L, (0.0, 0.0, 0.5)))
    short = line_to(HOME[L], beside(L, (0.0, 0.0, 0.001)))
    parts = parts_for([half_metre, short])
    assert (len(parts), parts[0], parts[-1]) == (53, 0.0, 1.0)
    assert parts[1:3] == pytest.approx((0.005, 0.02))
    assert parts[-2] == pytest.approx(0.995)
    assert list(parts) == sorted(parts)
    assert len(parts_for([short])) == 15
    assert len(parts_for([half_metre], 100)) == 483
    assert place(0.426) == "at 43% of the way"


@pytest.mark.parametrize("side", list(Side))
def test_the_joints_are_on_the_line_everywhere_and_inside_their_limits(side):
    """Between the places as well: to OFF_M and OFF_RAD in the middles, little more anywhere; random lines of both arms."""
    rng, found = random.Random(4), 0
    for _ in range(either(25, 300)):
        q_rad, target = random_way(rng, side)
        curve, line = solved(target, q_rad, side)
        if isinstance(curve, (Refusal, Coarse)):
            continue
        found += 1
        assert curve.points[0] == q_rad
        assert off_line(side, curve.points[-1], line.at(1.0)) < 1e-9
        for _ in range(40):
            part = rng.random()
            assert off_line(side, curve.at(part)[0], line.at(part)) < 1.5 * max(OFF_M, OFF_RAD)
        limits = LIMITS[side]
        for peaks, low, high in zip(curve.peaks, limits.lower_rad, limits.upper_rad, strict=True):
            assert low - 1e-12 <= peaks[0] <= peaks[1] <= high + 1e-12
    assert found > 12


def test_derivatives_are_those_of_the_joints():
    """Velocity and acceleration by the part of the way, against differences."""
    curve, _ = solved(beside(L, (0.05, 0.05, 0.05)))
    step = 1e-5
    for part in (0.1, 0.5, 0.77):
        before, here, after = (curve.at(part + by) for by in (-step, 0.0, step))
        for n in range(7):
            assert (after[0][n] - before[0][n]) / (2 * step) == pytest.approx(here[1][n], abs=1e-6)
            assert (after[1][n] - before[1][n]) / (2 * step) == pytest.approx(here[2][n], abs=1e-3)


def test_a_line_on_which_a_joint_leaves_its_limits_is_refused_with_the_place():
    """Joint, value, bound, unit and remedy; the place is where it leaves them, not the end of the line."""
    limits = replace(LIMITS[L], upper_rad=(*LIMITS[L].upper_rad[:3], 0.95, *LIMITS[L].upper_rad[4:]))
    refusal, _ = solved(beside(L, (-0.1, 0.0, 0.0)), limits=limits)
    assert isinstance(refusal, Refusal)
    assert (refusal.code, refusal.field, refusal.bound, refusal.unit) == (
        Code.NO_STRAIGHT_WAY,
        "left_arm[3]",
        "[0.25, 0.95]",
        "rad",
    )
    assert float(refusal.value) > 0.95
    assert "of the way left arm joint 4 (" in refusal.message


def test_a_wrist_beyond_the_reach_is_told_where():
    """With an elbow that may do anything, the bare bones end the way."""
    free = replace(LIMITS[L], lower_rad=(-9.0,) * 7, upper_rad=(9.0,) * 7)
    begin = HOME[L]
    refusal, _ = solved(replace(begin, p_m=tuple(4.0 * c for c in begin.p_m)), limits=free)
    assert isinstance(refusal, Refusal)
    assert (refusal.code, refusal.field, refusal.unit) == (Code.NO_STRAIGHT_WAY, "left_arm", "of the way")
    assert 0.0 < float(refusal.value) < 1.0
    assert "leaves the reach" in refusal.message


@pytest.mark.parametrize("tight", [False, True])
def test_an_arm_of_nearly_the_shape_is_searched_and_refused_alike(tight):
    """A URDF of one robot: on the line by its own numbers; where a limit or the reach ends the way, that is told, too."""
    arm = ArmModel(nudged(L, 5, xyz_m=(0.002, 0.001, -0.003)), L)
    begin = arm.forward(HOME_Q_RAD[L])
    still = Elbow(arm.bend(HOME_Q_RAD[L]).arm_angle_rad)

    def found(by_m, limits=LIMITS[L]):
        line = line_to(begin, replace(begin, p_m=tuple(p + d for p, d in zip(begin.p_m, by_m, strict=True))))
        curve, pieces = finished(solve(L, arm, line, still, HOME_Q_RAD[L], parts_for([line]), limits))
        return line, curve, pieces

    line, curve, pieces = found((0.0, 0.0, 0.03))
    assert max(difference(arm.chain.forward(curve.at(0.4)[0]), line.at(0.4))) < 2 * OFF_M
    assert pieces > 3 * 14
    wide = replace(LIMITS[L], lower_rad=(-9.0,) * 7, upper_rad=(9.0,) * 7)
    _, refusal, _ = found((0.0, -0.02, -0.3), LIMITS[L] if tight else wide)
    assert isinstance(refusal, Refusal)
    assert refusal.unit == ("rad" if tight else "of the way")


def test_places_that_are_too_far_apart_are_not_taken():
    """A long way with few places: the spline is not on the line between them, and says so; more places are enough."""
    rng, seen = random.Random(1), 0
    for _ in range(20):
        q_rad, target = random_way(rng, L, 0.4)
        line = line_to(ARMS[L].forward(q_rad), target)
        still = Elbow(ARMS[L].arm_angle_rad(q_rad))
        found, _ = finished(solve(L, ARMS[L], line, still, q_rad, (0.0, 0.5, 1.0), LIMITS[L]))
        if isinstance(found, Coarse):
            seen += 1
            assert 0.0 < found.part < 1.0
            off = line.at(found.part)
            assert off.p_m != line.begin.p_m
    assert seen > 5


def test_the_work_is_cut_into_pieces():
    """A line of half a metre takes some dozens of them."""
    line = line_to(HOME[L], beside(L, (0.1, 0.0, 0.1)))
    still = Elbow(ARMS[L].arm_angle_rad(HOME_Q_RAD[L]))
    _, pieces = finished(solve(L, ARMS[L], line, still, HOME_Q_RAD[L], parts_for([line], 4), LIMITS[L]))
    assert pieces > 30
