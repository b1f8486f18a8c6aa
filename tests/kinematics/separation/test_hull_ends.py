"""Bounds of how near parts may come on a way: the arrays against plain floats, pair by pair."""

from __future__ import annotations

import random

import numpy as np
import pytest

from gateway.kinematics.separation.hull_ends import HullEnds, Reach
from gateway.kinematics.separation.levers import levers
from gateway.kinematics.separation.posture_arrays import Parts, PostureArrays
from gateway.kinematics.separation.stopping import STAYS
from gateway.values import ARM_DOF, Side
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


def joints(flags):
    """Return the joints of both arms, 0 to 6, that are flagged."""
    return {(tuple(Side)[k // ARM_DOF], k % ARM_DOF) for k in flags.nonzero()[0].tolist()}


def test_arrays_say_what_plain_floats_say():
    """The same pairs, the same gaps now and kept, the same joints that close them; also on ways inside those given first."""
    rng, parts, reach_m, seen = random.Random(5), Parts(model()), levers(model()), 0
    for _ in range(either(60, 600)):
        q_rad, widest = random_joints(rng), random_ways(rng, rng.choice([0.01, 0.05, 0.3]))
        posture = model().posture(q_rad)
        narrow = {side: [(0.5 * low, 0.7 * high) for low, high in row] for side, row in widest.items()}
        ends = HullEnds(parts.stand([q_rad]), parts, Reach([widest]), MARGIN_M)
        numbers = ends.numbers.tolist()
        both = ends.on(Reach([widest, narrow]))
        for way, ways in enumerate((widest, narrow)):
            plain = PlainEnds(posture, reach_m, ways)
            rows = sorted(plain.within(MARGIN_M), key=lambda row: row[1])
            kept = ends.on(Reach([ways]))
            assert both.gap_m[way] == pytest.approx(kept.gap_m[0], abs=1e-15)
            assert {number for _, number in rows} <= set(numbers)
            closing = kept.closing(np.arange(len(numbers)))
            for gap_m, number in rows:
                row = numbers.index(number)
                assert ends.gap_m[0, row] == pytest.approx(gap_m, abs=1e-12)
                assert kept.gap_m[0, row] == pytest.approx(plain.kept_m(gap_m, number), abs=1e-12)
                assert joints(closing[row]) == plain.closing(number)
                seen += 1
            for row in set(range(len(numbers))) - {numbers.index(number) for _, number in rows}:
                assert kept.gap_m[0, row] >= MARGIN_M  # only the wider ways can bring it near
    assert seen > 500


def test_several_postures_at_once_are_as_each_alone():
    """Each with ways of its own, among a few pairs: what one of them has near is told of all."""
    rng, parts = random.Random(9), Parts(model())
    for _ in range(
        either(20, 100)
    ):  # in the fifteenth one of eight pairs has two parts that move: numbers 64 bytes apart
        q_rads = [random_joints(rng) for _ in range(3)]
        ways = [random_ways(rng, 0.1) for _ in q_rads]
        among = np.array(sorted(rng.sample(range(len(model().pairs)), 40)))
        ends = HullEnds(parts.stand(q_rads), parts, Reach(ways), MARGIN_M, among)
        kept = ends.on(Reach(ways))
        assert set(ends.numbers.tolist()) <= set(among.tolist())
        for n, q_rad in enumerate(q_rads):
            alone = HullEnds(parts.stand([q_rad]), parts, Reach([ways[n]]), MARGIN_M, among)
            rows = [ends.numbers.tolist().index(number) for number in alone.numbers.tolist()]
            assert ends.gap_m[n, rows] == pytest.approx(alone.gap_m[0], abs=1e-12)
            assert kept.gap_m[n, rows] == pytest.approx(alone.on(Reach([ways[n]])).gap_m[0], abs=1e-12)


def test_pairs_that_are_dropped_are_out_and_the_others_stay_as_they_were():
    """Whichever go: gaps and joints of the rest are the same."""
    rng, parts, seen = random.Random(6), Parts(model()), 0
    for _ in range(either(20, 200)):
        q_rad, ways = random_joints(rng), random_ways(rng, 0.3)
        ends = HullEnds(parts.stand([q_rad]), parts, Reach([ways]), MARGIN_M)
        before, numbers = ends.on(Reach([ways])), ends.numbers
        goes = np.array([rng.random() < 0.5 for _ in numbers], dtype=bool)
        stays = (~goes).nonzero()[0]
        closing = before.closing(stays)
        ends.drop(goes)
        after = ends.on(Reach([ways]))
        assert ends.numbers.tolist() == numbers[stays].tolist()
        assert after.gap_m[0] == pytest.approx(before.gap_m[0, stays], abs=1e-15)
        assert (after.closing(np.arange(len(stays))) == closing).all()
        seen += len(stays)
    assert seen > 100


def test_where_nothing_can_come_near_there_is_nothing_to_say():
    """No pairs, no gaps."""
    parts, still = Parts(model()), {side: [STAYS] * 7 for side in Side}
    rng = random.Random(1)
    q_rad = random_joints(rng)
    while model().posture(q_rad).nearest().gap_m < 0.05:
        q_rad = random_joints(rng)
    ends = HullEnds(parts.stand([q_rad]), parts, Reach([still]), MARGIN_M)
    ends.drop(np.empty(0, dtype=bool))
    assert len(ends.numbers) == 0 and ends.on(Reach([still])).gap_m.shape == (1, 0)


@pytest.mark.parametrize("apart_m", [0.0, 0.03])
def test_lines_that_cross_have_a_direction_between_them_all_the_same(apart_m):
    """Two parts whose lines meet: that of their middles, as told by the posture; or any, where these are one."""
    rng, parts = random.Random(3), Parts(model())
    ways = {side: [(-1e-3, 1e-3)] * 7 for side in Side}
    q_rad = random_joints(rng)
    posture, arrays = model().posture(q_rad), parts.stand([q_rad])
    number = next(n for n, (i, j, *_) in enumerate(model().pairs) if parts.square_m2[i] == parts.square_m2[j])
    i, j, _, _ = model().pairs[number]
    pieces = arrays.pieces.copy()
    pieces[..., j] = pieces[..., i]
    x, y, z, u, v, w, square = posture.segments[i]
    off = [apart_m * c / square**0.5 for c in (u, v, w)]
    pieces[0, 0, :, j] += [*off, *off[:2]]
    posture.segments[j] = (x + off[0], y + off[1], z + off[2], u, v, w, square)
    posture.middles[j] = tuple(a + b for a, b in zip(posture.middles[i], off, strict=True))
    ends = HullEnds(PostureArrays(pieces, arrays.lines), parts, Reach([ways]), MARGIN_M)
    plain = PlainEnds(posture, levers(model()), ways)
    rows = {at: plain.kept_m(gap_m, at) for gap_m, at in plain.within(MARGIN_M)}
    row = ends.numbers.tolist().index(number)
    assert ends.on(Reach([ways])).gap_m[0, row] == pytest.approx(rows[number], abs=1e-12)
