"""Nearest points of straight pieces, against a numerical search that knows no geometry."""

from __future__ import annotations

import math
import random

import pytest

from gateway.kinematics.separation.segments import nearest, segment
from tests.thoroughness import either


def point(piece, part):
    """Return a point of a piece."""
    return [piece[axis] + part * piece[3 + axis] for axis in range(3)]


def searched(a, b):
    """Return the least distance by a search: golden section along both, one inside the other; the distance is convex."""
    golden = (math.sqrt(5.0) - 1.0) / 2.0

    def least(f):
        low, high = 0.0, 1.0
        for _ in range(45):
            width = golden * (high - low)
            if f(high - width) < f(low + width):
                high = low + width
            else:
                low = high - width
        return min(f(0.5 * (low + high)), f(0.0), f(1.0))

    return least(lambda s: least(lambda t: math.dist(point(a, s), point(b, t))))


def random_piece(rng, length_m):
    """Return a piece somewhere."""
    begin = [rng.uniform(-0.5, 0.5) for _ in range(3)]
    return segment(*begin, *(c + rng.uniform(-length_m, length_m) for c in begin))


@pytest.mark.parametrize("length_m", [0.5, 0.1, 1e-3])
def test_the_distance_is_the_least_of_a_numerical_search(length_m):
    """Crossing, beside each other, end to end, long and short: to a billionth of a metre."""
    rng = random.Random(str(length_m))
    for _ in range(either(15, 100)):
        a, b = random_piece(rng, 0.5), random_piece(rng, length_m)
        square, s, t = nearest(a, b)
        assert math.sqrt(square) == pytest.approx(searched(a, b), abs=1e-9)
        assert math.dist(point(a, s), point(b, t)) == pytest.approx(math.sqrt(square), abs=1e-12)
        assert 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0


@pytest.mark.parametrize(
    ("a", "b", "distance_m"),
    [
        (((0, 0, 0), (1, 0, 0)), ((0, 1, 0), (1, 1, 0)), 1.0),
        (((0, 0, 0), (1, 0, 0)), ((2, 1, 0), (5, 1, 0)), math.sqrt(2.0)),
        (((0, 0, 0), (1, 0, 0)), ((5, 1, 0), (0.5, 1, 0)), 1.0),
        (((0, 0, 0), (1, 0, 0)), ((0.5, -1, 0), (0.5, 1, 0)), 0.0),
        (((0, 0, 0), (1, 0, 0)), ((0.25, 3, 4), (0.25, 3, 4)), 5.0),
        (((0, 0, 0), (0, 0, 0)), ((3, 0, 4), (3, 0, 4)), 5.0),
        (((0, 0, 0), (0, 0, 0)), ((-1, 2, 0), (1, 2, 0)), 2.0),
        (((0, 0, 0), (1, 0, 0)), ((1, 0, 0), (2, 0, 0)), 0.0),
    ],
)
def test_parallel_crossing_and_pointlike_pieces(a, b, distance_m):
    """The cases that a formula for lines alone gets wrong, in both orders."""
    one, two = segment(*a[0], *a[1]), segment(*b[0], *b[1])
    assert math.sqrt(nearest(one, two)[0]) == pytest.approx(distance_m, abs=1e-12)
    assert math.sqrt(nearest(two, one)[0]) == pytest.approx(distance_m, abs=1e-12)
