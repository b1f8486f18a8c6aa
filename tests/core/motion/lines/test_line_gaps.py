"""What stays free along a row of postures: the first one that is too near is named, and few of the wide ones are looked at."""

from __future__ import annotations

import random

import pytest

from gateway.core.motion.lines.line_gaps import CLOSER_M, LENGTH_M, too_near
from gateway.errors import Code
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side
from tests.core.lines import finished
from tests.kinematics.guarded_arms import model, random_joints
from tests.thoroughness import either

MARGIN_M = 0.02


def row(begin, end, count=60):
    """Postures from one to another, evenly."""
    return [
        {side: tuple(a + (b - a) * n / count for a, b in zip(begin[side], end[side], strict=True)) for side in Side}
        for n in range(count + 1)
    ]


def look(postures, margin_m=MARGIN_M):
    """What is found, and how often it was looked."""
    return finished(too_near(model(), margin_m, postures, "at number {}".format))


def together():
    """Both arms come nearer to something with every posture, until less than the margin is left."""
    rng = random.Random(4)
    while True:
        postures = row(HOME_Q_RAD, random_joints(rng))
        every = gaps(postures)
        last = next((n for n, gap_m in enumerate(every) if gap_m < MARGIN_M), 0)
        first = last
        while first > 0 and every[first - 1] > every[first]:
            first -= 1
        if last - first > 4:
            return postures[first : last + 1]


def gaps(postures):
    """The gap of every posture [m]."""
    return [model().posture(one).nearest().gap_m for one in postures]


def test_it_finds_what_looking_at_every_posture_finds():
    """Random ways: refused exactly where some posture leaves too little, at the first one that does, or where it is passed."""
    rng, refused, free = random.Random(5), 0, 0
    for _ in range(either(25, 300)):
        begin, end = random_joints(rng), random_joints(rng)
        part = 0.3
        end = {s: tuple(a + part * (b - a) for a, b in zip(begin[s], end[s], strict=True)) for s in Side}
        postures = row(begin, end)
        found, _ = look(postures)
        every = gaps(postures)
        least = min(MARGIN_M, every[0] - CLOSER_M)  # by less, coming nearer is rounding
        bad = [n for n, gap_m in enumerate(every) if n and gap_m < least]
        assert (found is not None) == bool(bad)
        if found is None:
            free += 1
            continue
        refused += 1
        number = int(found.message.split("at number ")[1].split()[0])
        assert number == bad[0]
        assert float(found.value) == pytest.approx(every[number], rel=1e-4)
    assert refused > 3
    assert free > 3


def test_a_refusal_names_both_parts_the_gap_and_the_margin():
    """Value, bound and unit as any refusal; in millimetres for people."""
    refusal, _ = look(together())
    assert refusal is not None
    assert (refusal.code, refusal.bound, refusal.unit) == (Code.COLLISION_AHEAD, "0.02", "m")
    assert refusal.field in {capsule.name for capsule in model().capsules}
    assert "20 mm have to stay free" in refusal.message


def test_wide_gaps_are_passed_over():
    """With a metre of joint travel to spare, one look serves many postures; the last one is always looked at."""
    end = {side: tuple(q + 0.02 for q in HOME_Q_RAD[side]) for side in Side}
    found, pieces = look(row(HOME_Q_RAD, end))
    assert found is None
    assert pieces < 10
    assert LENGTH_M * 14 * 0.02 > gaps([HOME_Q_RAD])[0] - MARGIN_M  # more than one look was needed all the same


def test_a_motion_that_begins_inside_the_margin_may_part_but_come_no_nearer():
    """With a margin that its begin does not keep: apart is free, together is refused."""
    nearer = together()
    wide = gaps(nearer)[0] + 0.01
    assert look(nearer, wide)[0] is not None
    assert look(nearer[::-1], wide)[0] is None


def test_a_single_posture_is_its_own_end():
    """Nothing moves: nothing is refused."""
    assert look([HOME_Q_RAD]) == (None, 2)
