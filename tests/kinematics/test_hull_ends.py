"""Bounds of how near parts may come on a way: the arrays against plain floats, pair by pair."""

from __future__ import annotations

import random

import pytest

from gateway.kinematics.hull_ends import HullEnds, Parts, Reach, levers
from gateway.kinematics.stopping import STAYS
from gateway.values import Side
from tests.kinematics.guarded_arms import MARGIN_M, model, random_joints
from tests.kinematics.plain_ends import PlainEnds
from tests.thoroughness import either


def random_ways(rng, size):
    """Return extents of ways: some joints stay, some go one way, some both."""
    return {
        side: [
            (-rng.uniform(0.0, size) * rng.random() ** 3, rng.uniform(0.0, size)) if rng.random() < 0.6 else STAYS
            for _ in range(7)
        ]
        for side in Side
    }


def test_arrays_say_what_plain_floats_say():
    """The same pairs, the same gaps now and kept, the same joints that close them; also on ways inside those given first."""
    rng, parts, reach_m, seen = random.Random(5), Parts(model()), levers(model()), 0
    for _ in range(either(60, 600)):
        posture, widest = model().posture(random_joints(rng)), random_ways(rng, rng.choice([0.01, 0.05, 0.3]))
        narrow = {side: [(0.5 * low, 0.7 * high) for low, high in row] for side, row in widest.items()}
        ends = HullEnds(posture, parts, Reach(parts, widest), MARGIN_M)
        for ways in (widest, narrow):
            plain = PlainEnds(posture, reach_m, ways)
            rows = sorted(plain.within(MARGIN_M), key=lambda row: row[1])
            kept = ends.on(Reach(parts, ways))
            numbers = ends.numbers.tolist()
            assert {number for _, number in rows} <= set(numbers)
            for gap_m, number in rows:
                row = numbers.index(number)
                assert ends.gap_m[row] == pytest.approx(gap_m, abs=1e-12)
                assert kept.gap_m[row] == pytest.approx(plain.kept_m(gap_m, number), abs=1e-12)
                assert kept.closing([row]) == plain.closing(number)
                seen += 1
            for row in set(range(len(numbers))) - {numbers.index(number) for _, number in rows}:
                assert kept.gap_m[row] >= MARGIN_M  # only the wider ways can bring it near
    assert seen > 500


def test_where_nothing_can_come_near_there_is_nothing_to_say():
    """No pairs, no gaps, no joints."""
    parts, still = Parts(model()), {side: [STAYS] * 7 for side in Side}
    rng = random.Random(1)
    posture = model().posture(random_joints(rng))
    while posture.nearest().gap_m < 0.05:
        posture = model().posture(random_joints(rng))
    ends = HullEnds(posture, parts, Reach(parts, still), MARGIN_M)
    assert len(ends.numbers) == 0 and len(ends.on(Reach(parts, still)).gap_m) == 0
    assert ends.on(Reach(parts, still)).closing([]) == set()


def test_lines_that_cross_have_a_direction_between_them_all_the_same():
    """Two parts whose lines meet: that of their middles, as told by the posture."""
    rng, parts = random.Random(3), Parts(model())
    ways = {side: [(-1e-3, 1e-3)] * 7 for side in Side}
    posture = model().posture(random_joints(rng))
    i, j, _, _ = model().pairs[0]
    posture.segments[j] = posture.segments[i]
    posture.middles[j] = posture.middles[i]
    ends = HullEnds(posture, parts, Reach(parts, ways), MARGIN_M)
    plain = PlainEnds(posture, levers(model()), ways)
    rows = {number: plain.kept_m(gap_m, number) for gap_m, number in plain.within(MARGIN_M)}
    row = ends.numbers.tolist().index(0)
    assert ends.on(Reach(parts, ways)).gap_m[row] == pytest.approx(rows[0], abs=1e-12)
