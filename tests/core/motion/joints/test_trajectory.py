"""The motion through points: it passes them, is smooth between them, and its peaks are what it really does."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.motion.joints.trajectory import interpolate, smooth

SINE = [(math.sin(0.2 * n), math.cos(0.3 * n)) for n in range(30)]
TIMES = [0.1 * n for n in range(30)]


def densely(trajectory, joint, count=4000):
    """Positions, velocities and accelerations of a joint at many instants."""
    return [tuple(row[joint] for row in trajectory.at(trajectory.duration_s * n / count)) for n in range(count + 1)]


def test_the_motion_passes_every_point_in_time():
    """Also with times that do not begin at 0: the first point is passed at 0."""
    trajectory = interpolate(SINE, [5.0 + t for t in TIMES])
    assert trajectory.times_s[0] == 0.0 and trajectory.duration_s == pytest.approx(2.9)
    assert trajectory.points == tuple(SINE)
    for point, time_s in zip(SINE, trajectory.times_s, strict=True):
        assert trajectory.at(time_s)[0] == pytest.approx(point, abs=1e-12)


def test_velocity_and_acceleration_are_continuous_and_are_the_derivatives():
    """Finite differences over a hair, at points and between them, with uneven times."""
    times = [0.0, 0.1, 0.25, 0.3, 0.6, 0.7]
    trajectory = interpolate(SINE[:6], times)
    hair = 1e-6
    for time_s in (0.05, 0.1, 0.25, 0.29, 0.3, 0.45, 0.6, 0.65):
        before, now, after = (trajectory.at(time_s + d) for d in (-hair, 0.0, hair))
        for n in range(2):
            assert (after[0][n] - before[0][n]) / (2 * hair) == pytest.approx(now[1][n], abs=1e-5)
            assert (after[1][n] - before[1][n]) / (2 * hair) == pytest.approx(now[2][n], abs=1e-3)


def test_beyond_its_ends_it_is_where_it_ends():
    """The state of the end, velocity included: who follows it decides what comes next."""
    trajectory = interpolate(SINE, TIMES)
    assert trajectory.at(-1.0) == trajectory.at(0.0)
    assert trajectory.at(99.0) == trajectory.at(trajectory.duration_s)
    assert trajectory.at(99.0)[0] == pytest.approx(SINE[-1])


@pytest.mark.parametrize("count", [2, 3, 4, 9])
def test_the_first_and_the_last_piece_are_parabolas(count):
    """The least that can be read into the points; two points are a straight line, three a parabola."""
    trajectory = interpolate(SINE[:count], TIMES[:count])
    for n in range(2):
        assert trajectory.j[n][0] == pytest.approx(0.0, abs=1e-9) and trajectory.j[n][-1] == pytest.approx(
            0.0, abs=1e-9
        )
    if count == 2:
        assert trajectory.a == ((0.0, 0.0), (0.0, 0.0))


@pytest.mark.parametrize("jitter", [0.0, 0.01])
def test_peaks_are_the_extremes_of_the_motion_between_the_points(jitter):
    """What is told of a piece encloses it, and is reached."""
    rng = random.Random(1)
    trajectory = interpolate([tuple(q + rng.gauss(0.0, jitter) for q in point) for point in SINE], TIMES)
    for n in range(2):
        dense = densely(trajectory, n)
        seen = (min(q for q, _, _ in dense), max(q for q, _, _ in dense), max(abs(v) for _, v, _ in dense))
        told = (min(trajectory.low[n]), max(trajectory.high[n]), max(trajectory.speed[n]))
        assert told[0] <= seen[0] + 1e-12 and told[1] >= seen[1] - 1e-12 and told[2] >= seen[2] - 1e-12
        assert told == pytest.approx(seen, abs=1e-4)
        assert max(map(abs, trajectory.a[n])) == pytest.approx(max(abs(a) for _, _, a in dense), abs=0.05)


def test_a_turn_inside_a_piece_is_seen():
    """Equal points after a fast approach: the motion overshoots them and comes back."""
    trajectory = interpolate([(0.0,), (0.5,), (1.0,), (1.0,), (1.0,)], [0.0, 0.1, 0.2, 0.3, 0.4])
    assert max(trajectory.q[0]) == 1.0 and max(trajectory.high[0]) > 1.01
    assert trajectory.high[0].index(max(trajectory.high[0])) == 2
    still = interpolate([(0.3,)] * 4, [0.0, 0.1, 0.2, 0.3])
    assert (set(still.low[0]), set(still.high[0]), set(still.speed[0])) == ({0.3}, {0.3}, {0.0})


coordinates = st.floats(-3.0, 3.0, allow_nan=False).map(lambda x: round(x, 6))


@given(st.lists(st.tuples(coordinates, st.floats(0.001, 2.0)), min_size=2, max_size=12))
def test_any_points_give_finite_peaks_that_enclose_the_motion(rows):
    """Hypothesis over points and uneven times."""
    times = [sum(step for _, step in rows[: n + 1]) for n in range(len(rows))]
    trajectory = interpolate([(q,) for q, _ in rows], times)
    lowest, highest, fastest = min(trajectory.low[0]), max(trajectory.high[0]), max(trajectory.speed[0])
    slack = 1e-9 * (1.0 + fastest + abs(lowest) + abs(highest))
    for q, v, a in densely(trajectory, 0, 200):
        assert math.isfinite(q) and math.isfinite(v) and math.isfinite(a)
        assert lowest - slack <= q <= highest + slack and abs(v) <= fastest * (1 + 1e-6) + slack


def test_smoothing_takes_jitter_away_and_keeps_the_ends():
    """What alternates from point to point shrinks with the square of the neighbours; straight lines stay."""
    jitter = [(0.001 * (-1) ** n, 0.1 * n) for n in range(40)]
    smoothed = smooth(jitter, 3)
    assert len(smoothed) == 40 and smoothed[0] == jitter[0] and smoothed[-1] == jitter[-1]
    inner = [point[0] for point in smoothed[6:-6]]
    assert max(map(abs, inner)) <= 0.001 / 49 + 1e-12
    assert [point[1] for point in smoothed] == pytest.approx([point[1] for point in jitter])
    steps = [b[1] - a[1] for a, b in pairwise(smoothed)]
    assert steps == pytest.approx([0.1] * 39)
