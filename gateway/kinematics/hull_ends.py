"""Hull ends: how far the ends of the parts' lines go on a way of the joints, and what gap that leaves, at the least.

All bounds are rigorous for parts that are apart. An end that joints 1 to n move by d_1..d_n goes by the sum of its slopes
times d, and leaves that by at most the bend: half the sum of |d_i| |d_k| L_max(i,k), with L_k the most that it can ever be
away from axis k (Taylor; the second derivative by joints i <= k is a turn by i of a velocity by k). The bend is shared out
to the later joint of each product. A joint's share is convex in how far it goes, so that only the ends of its way count;
one that opens more than its share bends keeps the gap wherever it stands still.

In arrays: on a way of all joints at speed a hundred pairs may come near, and each costs more alone than all together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from operator import mul

import numpy as np
from numpy.typing import NDArray

from gateway.kinematics.capsules import Capsule
from gateway.kinematics.chain import Line
from gateway.kinematics.collision import WIDE_OPEN_M, CollisionModel, Posture
from gateway.kinematics.segments import PARALLEL as PARALLEL_PIECES
from gateway.kinematics.stopping import Extent
from gateway.values import ARM_DOF, Side, Vector

__all__ = ["HullEnds", "Kept", "Parts", "Reach", "levers"]

MEET_M = 1e-9
"""Axes that miss each other by less meet [m]."""
PARALLEL = 1e-12
"""Square of the sine below which two axes count as parallel."""
TOUCHING_M = 1e-9
"""Lines nearer than this have no direction between them [m]: `Posture.normal` gives one."""

LEAST_M2 = 1e-30
"""Square of the length of a piece that is a point [m²]."""

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Numbers = NDArray[np.intp]
Ways = Mapping[Side, Sequence[Extent]]

SIDES = tuple(Side)
ARM_OF = {side: number for number, side in enumerate(Side)}


class Parts:
    """What of a body's parts does not change with its posture, as arrays.

    Args:
        model: Parts and pairs; those that joints move come first.
    """

    def __init__(self, model: CollisionModel) -> None:
        capsules = model.capsules
        self.moving = sum(1 for capsule in capsules if capsule.after)
        """How many parts joints move."""
        self.arm = np.array([ARM_OF[c.side] if c.side is not None and c.after else 0 for c in capsules])
        """Which arm moves each part, 0 or 1; of no meaning where none does."""
        self.reach_m = np.array([row or (0.0,) * ARM_DOF for row in levers(model)])
        """Greatest levers of each part by its arm's joints, shape (parts, 7); 0 where a joint does not move it."""
        after = np.array([capsule.after for capsule in capsules[: self.moving]])
        self.moved = (np.arange(ARM_DOF) < after[:, None]).astype(float)[:, None]
        """Which joints move each moving part, 1 or 0, shape (moving, 1, 7)."""
        pairs = np.array(model.pairs)
        self.first, self.second = pairs[:, 0].astype(np.intp), pairs[:, 1].astype(np.intp)
        self.around_m, self.radii_m = pairs[:, 2].copy(), pairs[:, 3].copy()


class Reach:
    """What some ways of the joints mean for each part.

    Args:
        parts: Of the body.
        ways: Extents of the joints' ways, shape (7,) per side [rad].

    Attributes:
        low_rad: How far the joints that move each part go back, shape (parts, 7).
        high_rad: How far they go forth.
        low_bend_m: By how much turning may leave the tangent, back.
        high_bend_m: The same, forth.
        goes_m: How far each part can go at all, shape (parts,).
    """

    __slots__ = ("goes_m", "high_bend_m", "high_rad", "low_bend_m", "low_rad")

    def __init__(self, parts: Parts, ways: Ways) -> None:
        goes = np.array([ways[side] for side in Side])
        low, high = goes[..., 0], goes[..., 1]
        far = np.maximum(high, -low)
        before = np.cumsum(far, axis=1) - far
        before += before
        self.low_rad, self.high_rad = low[parts.arm], high[parts.arm]
        self.low_bend_m = (0.5 * low * (low - before))[parts.arm] * parts.reach_m
        self.high_bend_m = (0.5 * high * (high + before))[parts.arm] * parts.reach_m
        self.goes_m = np.einsum("ij,ij->i", parts.reach_m, far[parts.arm])


class HullEnds:
    """The ends of the parts that might come near on some ways.

    Args:
        posture: The body before it.
        parts: Of this body.
        reach: What the ways mean.
        gap_m: Only pairs that might be nearer than this somewhere on these ways are looked at [m].
        among: Numbers of the pairs to choose from; None for all.

    Attributes:
        numbers: Of these pairs (`Posture.told`).
        gap_m: Their gaps before it [m].
    """

    def __init__(
        self, posture: Posture, parts: Parts, reach: Reach, gap_m: float, among: Numbers | None = None
    ) -> None:
        pieces = np.array(posture.segments).T
        first, second, around_m, radii_m = parts.first, parts.second, parts.around_m, parts.radii_m
        if among is not None:
            first, second, around_m, radii_m = first[among], second[among], around_m[among], radii_m[among]
        middle = pieces[:3] + 0.5 * pieces[3:6]
        apart = middle[:, first] - middle[:, second]
        cut_m = reach.goes_m[first] + reach.goes_m[second] + gap_m
        outside_m = cut_m + around_m
        numbers = np.nonzero(np.einsum("ij,ij->j", apart, apart) < outside_m * outside_m)[0]
        i, j = first[numbers], second[numbers]
        s, t, between = _nearest(pieces[:, i], pieces[:, j])
        length = np.sqrt(np.einsum("ij,ij->j", between, between))
        gaps_m = length - radii_m[numbers]
        near = np.nonzero(gaps_m < cut_m[numbers])[0]
        self.numbers: Numbers = numbers[near] if among is None else among[numbers[near]]
        self.gap_m: Array = gaps_m[near]
        self._parts = parts
        # Each pair has two rows: one for each of its parts, with the way away from the other.
        self._part: Numbers = np.concatenate((i[near], j[near]))
        if len(near):
            i, j, length, normal = i[near], j[near], length[near], between[:, near]
            for row in np.nonzero(length < TOUCHING_M)[0]:
                normal[:, row], length[row] = posture.normal(int(i[row]), int(j[row]), 0.0, 0.0, 0.0), 1.0
            normal /= length
            away = np.empty((3, 2 * len(near)))
            away[:, : len(near)] = normal
            np.negative(normal, out=away[:, len(near) :])
            # How far a part's end lies behind its begin.
            ahead_m = np.einsum("ij,ij->j", away, pieces[3:6, self._part])
            behind_m = np.concatenate((s[near], t[near])) * ahead_m
            self._slack_m = np.empty((2 * len(near), 2))
            np.negative(behind_m, out=self._slack_m[:, 0])
            np.subtract(ahead_m, behind_m, out=self._slack_m[:, 1])
            self._slope = np.einsum("ij,jeki->jek", away, self._swings(posture, pieces)[self._part])

    def _swings(self, posture: Posture, pieces: Array) -> Array:
        """Return how both ends of each part move by each joint of its arm, shape (parts, 2, 7, 3) [m/rad]."""
        count, parts = self._parts.moving, self._parts
        lines = np.array([posture.lines[side] for side in Side]).reshape(len(Side), ARM_DOF, 6).transpose(2, 0, 1)
        own = lines[:, parts.arm[:count], None]  # (6, moving, 1, 7)
        ends = np.empty((3, count, 2, 1))
        ends[..., 0, 0] = pieces[:3, :count]
        np.add(pieces[:3, :count], pieces[3:6, :count], out=ends[..., 1, 0])
        x, y, z = ends - own[:3]
        ax, ay, az = own[3:] * parts.moved
        swings = np.zeros((pieces.shape[1], 2, ARM_DOF, 3))
        moving = swings[:count]
        moving[..., 0] = ay * z - az * y
        moving[..., 1] = az * x - ax * z
        moving[..., 2] = ax * y - ay * x
        return swings

    def on(self, reach: Reach) -> Kept:
        """Return what these pairs keep on ways inside those given first.

        Args:
            reach: What the ways mean.
        """
        part = self._part
        if not len(part):
            return Kept(self, self.gap_m, np.empty((0, ARM_DOF), dtype=bool))
        low = self._slope * reach.low_rad[part][:, None] - reach.low_bend_m[part][:, None]
        high = self._slope * reach.high_rad[part][:, None] - reach.high_bend_m[part][:, None]
        np.minimum(low, 0.0, out=low)
        np.minimum(high, 0.0, out=high)
        low += high
        along_m = np.maximum(self._slack_m, 0.0) + low.sum(axis=2)
        np.maximum(along_m, self._slack_m - reach.goes_m[part][:, None], out=along_m)
        least_m = np.minimum(along_m[:, 0], along_m[:, 1])
        np.minimum(least_m, 0.0, out=least_m)
        count = len(self.numbers)
        return Kept(self, self.gap_m + least_m[:count] + least_m[count:], (low < 0.0).any(axis=1))

    def joints(self, rows: Sequence[int], closes: Flags) -> set[tuple[Side, int]]:
        """Return the joints, 0 to 6, that are flagged for one of the parts of some pairs.

        Args:
            rows: Of these pairs in `numbers`.
            closes: Flags for each part, those of the first parts of all pairs before those of the second, shape (2n, 7).
        """
        count = len(self.numbers)
        return {
            (SIDES[self._parts.arm[self._part[part]]], int(k))
            for row in rows
            for part in (row, row + count)
            for k in np.nonzero(closes[part])[0]
        }


class Kept:
    """What some pairs keep on a way.

    Args:
        ends: Of their parts.
        gap_m: Least gap of each, whichever joint goes first [m].
        closes: Joints by which an end comes nearer, per part.
    """

    __slots__ = ("_closes", "_ends", "gap_m")

    def __init__(self, ends: HullEnds, gap_m: Array, closes: Flags) -> None:
        self._ends = ends
        self._closes = closes
        self.gap_m = gap_m

    def closing(self, rows: Sequence[int]) -> set[tuple[Side, int]]:
        """Return the joints, 0 to 6, by which some of these pairs come nearer; `rows` as in `HullEnds.numbers`."""
        return self._ends.joints(rows, self._closes)


def _nearest(a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Return where along both the nearest points of pieces are, 0 to 1, and the way between them (`segments.nearest`)."""
    r, u, v = a[:3] - b[:3], a[3:6], b[3:6]
    uu, vv = np.maximum(a[6], LEAST_M2), np.maximum(b[6], LEAST_M2)
    ur, vr, uv = np.einsum("ij,ij->j", u, r), np.einsum("ij,ij->j", v, r), np.einsum("ij,ij->j", u, v)
    both = uu * vv
    wide = both - uv * uv
    s = np.where(wide > PARALLEL_PIECES * both, uv * vr - ur * vv, 0.0) / np.maximum(wide, PARALLEL_PIECES * both)
    s = np.minimum(np.maximum(s, 0.0), 1.0)
    at = (uv * s + vr) / vv
    t = np.minimum(np.maximum(at, 0.0), 1.0)
    s = np.where(t == at, s, np.minimum(np.maximum((uv * t - ur) / uu, 0.0), 1.0))
    return s, t, r + s * u - t * v


def levers(model: CollisionModel) -> list[Vector]:
    """Return for each part the most that its ends can ever be away from the axes that move it [m]; empty if none does."""
    return [
        _levers(capsule, model.chains[capsule.side].lines) if capsule.side is not None and capsule.after else ()
        for capsule in model.capsules
    ]


def _levers(capsule: Capsule, lines: Sequence[Line]) -> Vector:
    ends = [capsule.from_m, capsule.to_m]
    ends += [tuple(c + WIDE_OPEN_M * d for c, d in zip(end, capsule.opens, strict=True)) for end in ends]
    moving = lines[: capsule.after]
    farthest = (max(row) for row in zip(*(_end_levers(end, moving) for end in ends), strict=True))
    return (*farthest, *(0.0,) * (len(lines) - capsule.after))


def _end_levers(end: Vector, lines: Sequence[Line]) -> list[float]:
    """Add up the way from an end inwards, from axis to axis: no posture makes it longer."""
    own = lines[-1]
    found = [math.dist(end, _foot(own, (end, own[1])))]
    centres = [_foot(a, b) for a, b in pairwise(lines)]
    middle = _foot(own, (centres[-1], own[1]))
    # Where the last two axes meet, the end stays as far from there as it is.
    apart = math.dist(centres[-1], middle)
    away = math.dist(centres[-1], end) if apart < MEET_M else apart + math.dist(middle, end)
    found.append(away)
    for outer, inner in pairwise(reversed(centres)):
        away += math.dist(outer, inner)
        found.append(away)
    return found[::-1]


def _foot(a: Line, b: Line) -> Vector:
    """Return the point of axis a that is nearest to axis b, or to its point where they are parallel."""
    (p, u), (q, v) = a, b
    way = [y - x for x, y in zip(p, q, strict=True)]
    uv = sum(map(mul, u, v))
    if 1.0 - uv * uv < PARALLEL:
        along_m = sum(map(mul, way, u))
        return tuple(x + along_m * c for x, c in zip(p, u, strict=True))
    along_m = (sum(map(mul, way, u)) - uv * sum(map(mul, way, v))) / (1.0 - uv * uv)
    return tuple(x + along_m * c for x, c in zip(p, u, strict=True))
