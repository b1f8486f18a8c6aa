"""The elbow along a line: smooth, inside the limits where that can be, with little travel, and early enough for the end."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import pytest

from gateway.core.motion.lines.line import line_to
from gateway.core.motion.lines.line_elbow import Elbow, chosen
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side
from tests.changed import replace
from tests.core.lines import HOME, LIMITS, beside, finished
from tests.kinematics.bodies import ARMS
from tests.thoroughness import either

L, R = Side.LEFT, Side.RIGHT


def along(side, line, elbow, q_rad, count=40):
    """Joints along a line with an elbow."""
    return [ARMS[side].bend(q_rad).swivel(line.at(n / count)).at(elbow.at(n / count)) for n in range(count + 1)]


def choice(side, target, limits=None):
    """The elbow's way from home to a pose, the line, and the pieces it took."""
    line = line_to(HOME[side], target)
    elbow, pieces = finished(chosen(ARMS[side], line, HOME_Q_RAD[side], limits or LIMITS[side]))
    return elbow, line, pieces


def is_inside(side, q_rad):
    """Whether joints are inside their limits."""
    return all(a <= q <= b for a, q, b in zip(LIMITS[side].lower_rad, q_rad, LIMITS[side].upper_rad, strict=True))


def test_an_elbow_is_a_parabola_from_where_it_hangs():
    """Begin, end and bulge in the middle."""
    elbow = Elbow(0.5, 0.4, 0.1)
    assert [elbow.at(part) for part in (0.0, 0.5, 1.0)] == pytest.approx([0.5, 0.8, 0.9])


@pytest.mark.parametrize("side", list(Side))
def test_poses_that_can_be_taken_from_home_are_gone_to_inside_the_limits(side):
    """Wherever the inverse kinematics has a solution around home, the elbow finds a way there that keeps every limit."""
    rng, reached, found = random.Random(3), 0, 0
    for _ in range(either(25, 300)):
        target = beside(side, tuple(rng.uniform(-0.1, 0.1) for _ in range(3)))
        if ARMS[side].solution(target, HOME_Q_RAD[side]) is None:
            continue
        reached += 1
        elbow, line, _ = choice(side, target)
        found += all(is_inside(side, q) for q in along(side, line, elbow, HOME_Q_RAD[side]))
    assert reached > 10
    assert found >= 0.98 * reached


def test_it_begins_early_to_go_where_it_must_be_in_the_end():
    """A pose that one arm angle alone allows, 0.35 rad away: the elbow goes there evenly, not at the last moment."""
    elbow, line, _ = choice(R, beside(R, (0.0, -0.03, -0.05)))
    (low, _) = ARMS[R].sectors(line.at(1.0).pose)[0]
    assert elbow.at(0.0) == ARMS[R].arm_angle_rad(HOME_Q_RAD[R]) < low - 0.3
    assert elbow.at(1.0) >= low
    steps = [math.dist(a, b) for a, b in pairwise(along(R, line, elbow, HOME_Q_RAD[R]))]
    assert max(steps) < 2.5 * min(steps)


def test_the_joints_turn_hardly_faster_than_they_must():
    """The fastest joint is within 15 % of the best of 600 parabolas tried by brute force."""
    elbow, line, _ = choice(L, beside(L, (0.04, 0.02, 0.06)))

    def fastest(one):
        rows = along(L, line, one, HOME_Q_RAD[L])
        if not all(is_inside(L, q) for q in rows):
            return math.inf
        return max(abs(b - a) for before, after in pairwise(rows) for a, b in zip(before, after, strict=True))

    begin = elbow.begin_rad
    best = min(fastest(Elbow(begin, 0.05 * n, 0.1 * m)) for n in range(-20, 21) for m in range(-7, 8))
    assert fastest(elbow) < 1.15 * best


def test_where_limits_leave_no_way_it_is_the_one_least_beyond():
    """So that a refusal names what is really missing."""
    tight = replace(LIMITS[L], upper_rad=(*LIMITS[L].upper_rad[:3], 0.92, *LIMITS[L].upper_rad[4:]))
    elbow, line, _ = choice(L, beside(L, (-0.1, 0.0, 0.0)), tight)
    rows = along(L, line, elbow, HOME_Q_RAD[L])
    others = [n for n in range(7) if n != 3]
    assert rows[-1][3] > 0.92  # the elbow's own bend does not depend on the arm angle
    for q in rows:
        assert all(LIMITS[L].lower_rad[n] <= q[n] <= LIMITS[L].upper_rad[n] for n in others)


def test_a_line_out_of_reach_is_looked_at_as_far_as_it_can_be_followed():
    """No station at all, or some of them: a choice all the same, and a refusal later."""
    far = replace(HOME[L], p_m=tuple(4.0 * c for c in HOME[L].p_m))
    assert choice(L, far)[0].begin_rad == ARMS[L].arm_angle_rad(HOME_Q_RAD[L])
    farther = replace(HOME[L], p_m=tuple(40.0 * c for c in HOME[L].p_m))
    assert choice(L, farther)[0] == Elbow(ARMS[L].arm_angle_rad(HOME_Q_RAD[L]))


def test_the_work_is_cut_into_pieces():
    """Some dozens; and no more than a few hundred."""
    assert 40 < choice(L, beside(L, (0.05, 0.05, 0.05)))[2] < 150
