"""The closed form: every pose that can be taken is, exactly, inside the limits, and near the seed."""

from __future__ import annotations

import math
import random

import pytest

from gateway.errors import Refusal
from gateway.kinematics.placement import Placement
from gateway.kinematics.solving.inverse import Solution
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import EePose, Side, ValueRefused
from tests.kinematics.bodies import ARMS, difference, excess, samples
from tests.thoroughness import either

POSE_61 = EePose(
    p_m=(-0.014433992985935767, 0.0181230355198717, -0.545),
    quat_xyzw=(-0.651863775688076, 0.260180077341881, 0.7053938323707012, 0.0989923560353721),
)
"""Target of the manual's §6.1, left arm."""

Q_61 = (-0.28608, 1.61868, 0.30022, 0.54233, 0.73653, 0.15890, -0.45533)
"""A published solution of it."""


def solved(side: Side, target: Placement, seed) -> Solution:
    """Solve, and check that the solution is one, inside the limits."""
    arm = ARMS[side]
    found = arm.inverse(target.pose, seed)
    assert isinstance(found, Solution), found.message
    assert max(difference(arm.chain.forward(found.q_rad), target)) < 1e-9
    assert all(low <= q <= high for low, q, high in zip(arm.lower_rad, found.q_rad, arm.upper_rad, strict=True))
    return found


def apart(a, b) -> float:
    """Distance of two configurations [rad]."""
    return math.dist(a, b)


@pytest.mark.parametrize("side", list(Side))
def test_round_trip_of_random_configurations(side):
    """All poses of random configurations are solved from home, to less than 1e-9 m and rad (of both arms 100,000 at most)."""
    arm = ARMS[side]
    worst = refused = 0
    count = either(3_000, 50_000)
    low, high = zip(*[(a - 1e-15, b + 1e-15) for a, b in zip(arm.lower_rad, arm.upper_rad, strict=True)], strict=True)
    for q in samples(side, count):
        target = arm.chain.forward(q)
        found = arm._closed.nearest(target, HOME_Q_RAD[side])
        if found is None:
            refused += 1
            continue
        at = arm.chain.forward(found.q_rad)
        # Rows of rotation matrices differ by at least angle / sqrt(2) somewhere, and by no more than the angle.
        off = [a - b for a, b in zip(at.p_m, target.p_m, strict=True)]
        off += [a - b for r, s in zip(at.rows, target.rows, strict=True) for a, b in zip(r, s, strict=True)]
        worst = max(worst, math.hypot(*off))
        assert all(a <= v <= b for a, v, b in zip(low, found.q_rad, high, strict=True))
    assert refused <= count // 1000
    assert worst < 1e-9


@pytest.mark.parametrize("side", list(Side))
def test_corners_of_the_limits_are_reached_too(side):
    """With joints exactly at their limits the pose has a single arm angle, or axes 1 and 3 are one line: still solved."""
    arm = ARMS[side]
    rng = random.Random(7)
    for _ in range(either(300, 3000)):
        q = [
            rng.choice([low, high, min(max(0.0, low), high), rng.uniform(low, high)])
            for low, high in zip(arm.lower_rad, arm.upper_rad, strict=True)
        ]
        for seed in (HOME_Q_RAD[side], q):
            solved(side, arm.chain.forward(q), seed)


def test_the_target_of_the_manuals_first_example_is_solved():
    """§6.1 has an exact solution inside the limits; from the published one the nearest is that one's neighbour."""
    found = solved(Side.LEFT, Placement.of(POSE_61), Q_61)
    assert apart(found.q_rad, Q_61) < 2e-5
    solved(Side.LEFT, Placement.of(POSE_61), HOME_Q_RAD[Side.LEFT])


@pytest.mark.parametrize("side", list(Side))
def test_the_configuration_itself_is_its_nearest_solution(side):
    """Asked for the pose where it is, an arm stays; from a neighbour it comes no further than the neighbour was."""
    rng = random.Random(3)
    for q in samples(side, either(300, 2000), seed=2):
        target = ARMS[side].chain.forward(q)
        assert apart(solved(side, target, q).q_rad, q) < 1e-6
        seed = [v + rng.uniform(-0.02, 0.02) for v in q]
        assert apart(solved(side, target, seed).q_rad, seed) <= 1.001 * apart(q, seed) + 1e-9


@pytest.mark.parametrize("side", list(Side))
def test_no_other_arm_angle_is_nearer(side):
    """Against every half degree of the circle: never nearer by a thousandth for a near seed, hardly ever for a far one."""
    arm, rng = ARMS[side], random.Random(5)
    worse = count = 0
    for number, q in enumerate(samples(side, either(100, 400), seed=4)):
        target = arm.chain.forward(q)
        is_near = number % 2 == 0
        seed = [v + rng.uniform(-0.1, 0.1) for v in q] if is_near else HOME_Q_RAD[side]
        here = apart(solved(side, target, seed).q_rad, seed)
        closed = arm._closed
        there = min(
            apart(b.q_rad, seed)
            for circle in closed._circles(target)
            for way in closed._windows
            for n in range(720)
            if (b := closed._branch(circle.at(n * math.tau / 720, way.shoulder, way.wrist)[0])).joint < 0
        )
        if is_near:
            assert here <= 1.001 * there + 1e-4
        else:
            count += 1
            worse += here > 1.001 * there
    assert worse <= 0.07 * count


@pytest.mark.parametrize("side", list(Side))
def test_a_path_is_followed_without_a_jump(side):
    """Solved point by point along a straight move of a hand, each step of the joints stays small."""
    arm = ARMS[side]
    from_q = HOME_Q_RAD[side]
    start = arm.chain.forward(from_q)
    q = from_q
    for step in range(1, 201):
        x, y, z = start.p_m
        target = Placement((x, y, z + 0.0005 * step), start.rows)
        found = solved(side, target, q)
        assert max(abs(a - b) for a, b in zip(found.q_rad, q, strict=True)) < 0.01
        q = found.q_rad


@pytest.mark.parametrize("side", list(Side))
def test_branches_are_eight_ways_and_say_which_joint_is_out(side):
    """All take the pose; those inside the limits come first; the others name the joint and by how much."""
    arm = ARMS[side]
    for q in samples(side, 50, seed=6):
        target = arm.chain.forward(q)
        branches = arm.branches(target.pose, arm.arm_angle_rad(q))
        assert len(branches) == 8
        assert [b.beyond_rad for b in branches] == sorted(b.beyond_rad for b in branches)
        assert branches[0].joint == -1 and apart(branches[0].q_rad, q) < 1e-8
        for branch in branches:
            assert max(difference(arm.chain.forward(branch.q_rad), target)) < 1e-9
            if branch.joint >= 0:
                angle, low, high = (v[branch.joint] for v in (branch.q_rad, arm.lower_rad, arm.upper_rad))
                assert branch.beyond_rad == pytest.approx(max(low - angle, angle - high))


@pytest.mark.parametrize("side", list(Side))
def test_a_pose_is_refused_exactly_when_no_arm_angle_is_left(side):
    """Random poses within reach: a solution where brute force finds one, a refusal where a scan finds none."""
    arm, rng = ARMS[side], random.Random(11)
    solutions = refusals = 0
    for _ in range(either(40, 100)):
        near, far = arm.reach_m()
        direction = [rng.gauss(0.0, 1.0) for _ in range(3)]
        length = rng.uniform(near + 0.001, far - 0.001) / math.hypot(*direction)
        turn = [rng.gauss(0.0, 1.0) for _ in range(4)]
        norm = math.hypot(*turn)
        pose = EePose(p_m=tuple(length * c for c in direction), quat_xyzw=tuple(c / norm for c in turn))
        found = arm.inverse(pose, HOME_Q_RAD[side])
        scan = min(b.beyond_rad for n in range(180) for b in arm.branches(pose, n * math.tau / 180))
        if isinstance(found, Refusal):
            refusals += 1
            assert 0.0 < excess(found) <= scan + 2e-5
            assert scan > 0.0 and not arm.sectors(pose)
        else:
            solutions += 1
            assert scan < 0.05 and arm.sectors(pose)
            solved(side, Placement.of(pose), HOME_Q_RAD[side])
    assert min(solutions, refusals) >= 3


@pytest.mark.parametrize("seed", [(0.0,) * 6, (0.0,) * 6 + (math.nan,)])
def test_a_seed_that_is_none_is_refused(seed):
    """Six joints, or one that is no number."""
    with pytest.raises(ValueRefused, match="seed"):
        ARMS[Side.LEFT].inverse(POSE_61, seed)
