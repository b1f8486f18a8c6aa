"""Trajectory: a motion through points at given times, of any number of joints, as a function of its own time.

Between the points runs the interpolating cubic spline: position, velocity and acceleration are continuous, the jerk is
constant from point to point. Nobody says how fast it enters and leaves, so the first and the last piece are parabolas
(constant acceleration): the least that can be read into the points. How an arm gets onto the trajectory and off it is
the business of `tracker.py`.

What the motion does *between* the points is worked out with it, piece by piece: the extremes of its positions and
velocities. (Those of its acceleration lie at the points.) Pure numbers: this module knows no limits of a robot, no side
and no clock.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from itertools import accumulate, pairwise

from msgspec import Struct

from gateway.values import Vector

__all__ = ["Trajectory", "interpolate", "smooth"]

Columns = tuple[Vector, ...]
"""Per joint a row of numbers: one for each point, or one for each piece between two points."""


class Trajectory(Struct, frozen=True, kw_only=True):
    """A motion through points. Made by `interpolate`.

    Attributes:
        times_s: When each point is passed, rising from 0 [s].
        points: The points, a tuple of joints each [rad, m].
        q: Per joint and point, the position [rad, m].
        v: Per joint and point, the velocity.
        a: Per joint and point, the acceleration.
        j: Per joint and piece, the jerk.
        low: Per joint and piece, the lowest position.
        high: Per joint and piece, the highest position.
        speed: Per joint and piece, the highest speed.
        peaks: Per joint, of all pieces: lowest and highest position, highest speed, acceleration and jerk.
    """

    times_s: Vector
    points: tuple[Vector, ...]
    q: Columns
    v: Columns
    a: Columns
    j: Columns
    low: Columns
    high: Columns
    speed: Columns
    peaks: Columns

    @property
    def duration_s(self) -> float:
        """Time from the first to the last point [s]."""
        return self.times_s[-1]

    def at(self, time_s: float) -> tuple[Vector, Vector, Vector]:
        """Return positions, velocities and accelerations at a time; beyond an end, those of the end."""
        time_s = min(max(time_s, 0.0), self.duration_s)
        n = min(bisect_right(self.times_s, time_s) - 1, len(self.times_s) - 2)
        t = time_s - self.times_s[n]
        positions, velocities, accelerations = [], [], []
        for q, v, a, j in zip(self.q, self.v, self.a, self.j, strict=True):
            positions.append(q[n] + t * (v[n] + t * (0.5 * a[n] + t * j[n] / 6.0)))
            velocities.append(v[n] + t * (a[n] + 0.5 * t * j[n]))
            accelerations.append(a[n] + t * j[n])
        return tuple(positions), tuple(velocities), tuple(accelerations)


def interpolate(points: Sequence[Vector], times_s: Sequence[float]) -> Trajectory:
    """Return the smooth motion through points.

    Args:
        points: At least two, each with the same number of finite joints of reasonable size.
        times_s: When each is passed, finite and rising; the first becomes 0 [s].
    """
    times = tuple([t - times_s[0] for t in times_s])
    spans = [after - before for before, after in pairwise(times)]
    pivots, ratios = _factors(spans)
    rows: list[list[Vector]] = []
    for q in zip(*points, strict=True):
        slopes = [(after - before) / h for before, after, h in zip(q, q[1:], spans, strict=False)]
        a = _bends(slopes, spans, pivots, ratios)
        v = [s - h * (2.0 * m + n) / 6.0 for s, h, m, n in zip(slopes, spans, a, a[1:], strict=False)]
        v.append(slopes[-1] + spans[-1] * (a[-2] + 2.0 * a[-1]) / 6.0)
        j = [(n - m) / h for m, n, h in zip(a, a[1:], spans, strict=False)]
        columns = (q, q[1:], v, v[1:], a, a[1:], j, spans)
        extremes = [_extremes(*piece) for piece in zip(*columns, strict=False)]
        low, high, speed = zip(*extremes, strict=True)
        peaks = (min(low), max(high), max(speed), max(map(abs, a)), max(map(abs, j)))
        rows.append([tuple(row) for row in (q, v, a, j, low, high, speed, peaks)])
    columns_of = [tuple(column) for column in zip(*rows, strict=True)]
    fields = zip(("q", "v", "a", "j", "low", "high", "speed", "peaks"), columns_of, strict=True)
    return Trajectory(times_s=times, points=tuple(map(tuple, points)), **dict(fields))


def _extremes(
    q: float, q_end: float, v: float, v_end: float, a: float, a_end: float, j: float, span_s: float
) -> tuple[float, float, float]:
    """Return the lowest and the highest position of a piece, and its highest speed."""
    speed = max(abs(v), abs(v_end))
    low, high = (q, q_end) if q <= q_end else (q_end, q)
    bends_back = a * a_end < 0.0
    if bends_back:
        speed = max(speed, abs(v - 0.5 * a * a / j))
    if bends_back or v * v_end < 0.0:
        for t in _turns(v, a, j):
            if 0.0 < t < span_s:
                turn = q + t * (v + t * (0.5 * a + t * j / 6.0))
                low, high = min(low, turn), max(high, turn)
    return low, high, speed


def _turns(v: float, a: float, j: float) -> Iterator[float]:
    """Yield the times at which the velocity v + a·t + j·t²/2 is 0; not for v and a both 0."""
    square = a * a - 2.0 * v * j
    if square >= 0.0:
        both = -(a + math.copysign(math.sqrt(square), a))  # never the difference of near equals
        yield 2.0 * v / both
        if j:
            yield both / j


def _factors(spans: Sequence[float]) -> tuple[list[float], list[float]]:
    """Return what the elimination of the spline's equations needs, the same for all joints: 1/pivot and ratio per row."""
    pivots: list[float] = []
    ratios: list[float] = []
    ratio = 0.0
    for row, (before_s, after_s) in enumerate(pairwise(spans)):
        diagonal = 2.0 * (before_s + after_s) - before_s * ratio
        if row == 0:
            diagonal += before_s  # the first piece is a parabola: its two accelerations are one unknown
        if row == len(spans) - 2:
            diagonal += after_s
        pivots.append(1.0 / diagonal)
        ratio = after_s / diagonal
        ratios.append(ratio)
    return pivots, ratios


def _bends(slopes: list[float], spans: list[float], pivots: list[float], ratios: list[float]) -> list[float]:
    """Return the accelerations of one joint at the points."""
    if not pivots:
        return [0.0, 0.0]
    inner: list[float] = []
    bend = 0.0
    for before, after, span_s, pivot in zip(slopes, slopes[1:], spans, pivots, strict=False):
        bend = (6.0 * (after - before) - span_s * bend) * pivot
        inner.append(bend)
    for row in range(len(inner) - 2, -1, -1):
        inner[row] -= ratios[row] * inner[row + 1]
    return [inner[0], *inner, inner[-1]]


def smooth(points: Sequence[Vector], reach: int) -> list[Vector]:
    """Return points without their jitter: twice the mean over each point and its neighbours. The ends stay where they are.

    Args:
        points: Evenly spaced in time.
        reach: How many neighbours count on each side, less than there are points.
    """
    columns = [_mean(_mean(list(column), reach), reach) for column in zip(*points, strict=True)]
    return list(zip(*columns, strict=True))


def _mean(values: list[float], reach: int) -> list[float]:
    """Return the running mean; beyond the ends the values go on as their mirror image through the end."""
    before = [2.0 * values[0] - value for value in values[reach:0:-1]]
    after = [2.0 * values[-1] - value for value in values[-2 : -reach - 2 : -1]]
    sums = list(accumulate([*before, *values, *after], initial=0.0))
    width = 2 * reach + 1
    means = [(end - start) / width for start, end in zip(sums, sums[width:], strict=False)]
    return [values[0], *means[1:-1], values[-1]]
