"""Hull ends: how far the ends of the parts' lines go on a way of the joints, and what gap that leaves, at the least.

All bounds are rigorous for parts that are apart. An end that joints 1 to n move by d_1..d_n goes by the sum of its slopes
times d, and leaves that by at most the bend: half the sum of |d_i| |d_k| L_max(i,k), with L_k the most that it can ever be
away from axis k (Taylor; the second derivative by joints i <= k is a turn by i of a velocity by k). The bend is shared out
to the later joint of each product. A joint's share is convex in how far it goes, so that only the ends of its way count;
one that opens more than its share bends keeps the gap wherever it stands still.

In arrays: on a way of all joints at speed a hundred pairs may come near, and each costs more alone than all together. Several
postures, or several ways from one, cost little more than one: nearly all is the price of calling. That price is why joints of
both arms are reckoned for every part: one product with the axes' lines (a wrench on a screw) gives all slopes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gateway.kinematics.separation.posture_arrays import JOINTS, Parts, PostureArrays, crossed
from gateway.kinematics.separation.segments import PARALLEL as PARALLEL_PIECES
from gateway.kinematics.separation.stopping import Extent
from gateway.values import ARM_DOF, Side

__all__ = ["HullEnds", "Kept", "Reach"]

TOUCHING_M = 1e-9
"""Lines nearer than this have no direction between them: that of the parts' middles is taken [m]."""

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Numbers = NDArray[np.intp]
Ways = Mapping[Side, Sequence[Extent]]

SIDES = tuple(Side)
ZERO, ONE, HALF = np.zeros(()), np.ones(()), np.array(0.5)
MINUS_ONE = np.array(-1.0)
"""A factor: `np.negative` into a part of an array takes wrong numbers where those given are 64 bytes apart (NumPy 2.4)."""
BACK_AND_FORTH = np.array((-1.0, 1.0))[:, None]
TWICE_BEFORE = np.kron(np.eye(len(SIDES)), np.triu(np.full((ARM_DOF, ARM_DOF), 2.0), 1))
"""Adds up, twice, what joints of the same arm further in have."""
ALL_SHARES = np.ones(2 * JOINTS)
UP = np.array((0.0, 0.0, 1.0))


class Reach:
    """What some ways of the joints mean for what they move.

    Args:
        ways: Extents of the joints' ways, shape (7,) per side each [rad]: a row for each posture, or any number of rows for
            one posture.

    Attributes:
        goes_rad: How far all joints go back, then forth, shape (ways, 28).
        bends_rad2: By how much turning may leave the tangent, per metre of a lever, likewise.
        far_rad: How far they go at most, shape (ways, 14).
    """

    __slots__ = ("bends_rad2", "far_rad", "goes_rad")

    def __init__(self, ways: Sequence[Ways]) -> None:
        flat = [x for row in ways for side in SIDES for way in row[side] for x in way]
        goes = np.array(flat).reshape(len(ways), JOINTS, 2).transpose(0, 2, 1).copy()  # (ways, back or forth, joints)
        far = np.maximum(goes[:, 1], -goes[:, 0])
        # What goes on in the joints further in, of the same arm: twice, as half of a product counts.
        before = np.matmul(far, TWICE_BEFORE)
        bends = BACK_AND_FORTH * before[:, None]
        bends += goes
        bends *= goes
        bends *= HALF
        self.goes_rad = goes.reshape(len(ways), 2 * JOINTS)
        self.bends_rad2 = bends.reshape(len(ways), 2 * JOINTS)
        self.far_rad = far


class HullEnds:
    """The ends of the parts that might come near on some ways.

    Only pairs are looked at that might be nearer than `gap_m` somewhere on these ways, of those with the numbers
    `among`, None for all.

    Attributes:
        numbers: Of these pairs (`Posture.told`).
        gap_m: Their gaps before it, shape (postures, pairs) [m].
    """

    def __init__(
        self, arrays: PostureArrays, parts: Parts, reach: Reach, gap_m: float, among: Numbers | None = None
    ) -> None:
        pieces = arrays.pieces
        first, second, around_m, radii_m = parts.first, parts.second, parts.around_m, parts.radii_m
        if among is not None:
            first, second, around_m, radii_m = (row.take(among) for row in (first, second, around_m, radii_m))
        middle = pieces[:, 0, :3] + HALF * pieces[:, 1, :3]
        goes_m = np.maximum.reduce(np.dot(reach.far_rad, parts.reach_m.T), axis=0)
        cut_m = goes_m.take(first)
        cut_m += goes_m.take(second)
        cut_m += gap_m
        apart = middle.take(first, axis=2)
        apart -= middle.take(second, axis=2)
        apart *= apart
        outside_m = cut_m + around_m
        outside_m *= outside_m
        numbers = _chosen(np.add.reduce(apart, axis=1) < outside_m)
        i, j = first.take(numbers), second.take(numbers)
        a, b = pieces.take(i, axis=3), pieces.take(j, axis=3)
        s, t, between = _nearest(a, b, parts.square_m2.take(i), parts.square_m2.take(j))
        length = np.sqrt(np.add.reduce(between * between, axis=1))
        gaps_m = length - radii_m.take(numbers)
        near = _chosen(gaps_m < cut_m.take(numbers))
        numbers = numbers.take(near)
        self.numbers: Numbers = numbers if among is None else among.take(numbers)
        self.gap_m: Array = gaps_m.take(near, axis=1)
        if not len(near):
            return
        i, j, length, between = i.take(near), j.take(near), length.take(near, axis=1), between.take(near, axis=2)
        if np.minimum.reduce(length, axis=None) < TOUCHING_M:
            for posture, row in np.argwhere(length < TOUCHING_M):
                way = middle[posture, :, i[row]] - middle[posture, :, j[row]]
                away_m = np.sqrt(way @ way)
                between[posture, :, row], length[posture, row] = (UP, 1.0) if away_m < TOUCHING_M else (way, away_m)
        between /= length[:, None]
        # Each pair has a row for its first part; those whose second part moves, which come first, have another one for that.
        self._both = both = int(np.count_nonzero(j < parts.moving))
        part: Numbers = np.concatenate((i, j[:both]))
        count, rows = len(length), len(part)
        away = np.empty((count, 5, rows))
        away[:, :3, : len(near)] = between
        np.multiply(between[..., :both], MINUS_ONE, out=away[:, :3, len(near) :])
        away[:, 3:] = away[:, :2]
        own = pieces.take(part, axis=3)
        along = np.concatenate((s.take(near, axis=1), t.take(near[:both], axis=1)), axis=1)
        # How far a part's end lies behind its begin.
        ahead_m = np.add.reduce(away[:, :3] * own[:, 1, :3], axis=1)
        along *= ahead_m
        self._slack_m = np.empty((count, 2, rows))
        np.multiply(along, MINUS_ONE, out=self._slack_m[:, 0])
        np.subtract(ahead_m, along, out=self._slack_m[:, 1])
        turns = crossed(own, away[:, None])
        wrenches = np.empty((count, 6, 2, rows))
        wrenches[:, :3, 0] = turns[:, 0]
        np.add(turns[:, 0], turns[:, 1], out=wrenches[:, :3, 1])
        wrenches[:, 3:] = away[:, :3, None]
        slopes = np.matmul(
            wrenches.reshape(count, 6, 2 * rows).transpose(0, 2, 1),
            np.concatenate((arrays.lines, arrays.lines), axis=2),
        )
        levers_m = parts.reach_m.take(part, axis=0)
        self._slopes = slopes.reshape(count, 2, rows, 2 * JOINTS) * np.concatenate((levers_m > ZERO,) * 2, axis=1)
        self._levers_m = levers_m
        self._bends_m = np.concatenate((levers_m, levers_m), axis=1)

    def drop(self, rows: Flags) -> None:
        """Leave out pairs that nobody asks for any more.

        Args:
            rows: Which of `numbers`.
        """
        if not len(self.numbers):
            return
        kept = (~rows).nonzero()[0]
        moved = kept[kept < self._both]
        parts = np.concatenate((kept, len(self.numbers) + moved))
        self._both = len(moved)
        self.numbers, self.gap_m = self.numbers.take(kept), self.gap_m.take(kept, axis=1)
        self._slack_m = self._slack_m.take(parts, axis=2)
        self._slopes = self._slopes.take(parts, axis=2)
        self._levers_m, self._bends_m = self._levers_m.take(parts, axis=0), self._bends_m.take(parts, axis=0)

    def on(self, reach: Reach) -> Kept:
        """Return what these pairs keep on ways inside those given first."""
        if not len(self.numbers):
            return Kept(np.empty((len(reach.far_rad), 0)), np.empty((len(reach.far_rad), 2, 0, 2 * JOINTS)), 0)
        shares = self._slopes * reach.goes_rad[:, None, None]
        shares -= (self._bends_m * reach.bends_rad2[:, None])[:, None]
        np.minimum(shares, ZERO, out=shares)
        along_m = np.dot(shares, ALL_SHARES)
        along_m += np.maximum(self._slack_m, ZERO)
        goes_m = np.dot(reach.far_rad, self._levers_m.T)
        np.maximum(along_m, self._slack_m - goes_m[:, None], out=along_m)
        least_m = np.minimum(along_m[:, 0], along_m[:, 1])
        np.minimum(least_m, ZERO, out=least_m)
        count = len(self.numbers)
        gap_m = self.gap_m + least_m[:, :count]
        gap_m[:, : self._both] += least_m[:, count:]
        return Kept(gap_m, shares, self._both)


class Kept:
    """What some pairs keep on some ways.

    Args:
        gap_m: Least gap of each on each way, whichever joint goes first, shape (ways, pairs) [m].
        shares: Of each joint in how an end comes nearer, shape (ways, 2, rows, 28) [m]: a row for the first part of each pair,
            then one for the second part of those whose second part moves.
        both: How many these are; they are the first pairs.
    """

    __slots__ = ("_both", "_shares", "gap_m")

    def __init__(self, gap_m: Array, shares: Array, both: int) -> None:
        self._shares = shares
        self._both = both
        self.gap_m = gap_m

    def closing(self, rows: Numbers) -> Flags:
        """Return which joints of both arms bring each of some pairs nearer on the first way, shape (rows, 14).

        Args:
            rows: Of the pairs in `HullEnds.numbers`.
        """
        closes = (np.minimum.reduce(self._shares[0], axis=0) < ZERO).reshape(-1, 2, JOINTS)
        closes = np.logical_or.reduce(closes, axis=1)
        found: Flags = closes.take(rows, axis=0)
        moved = (rows < self._both).nonzero()[0]
        found[moved] |= closes.take(self.gap_m.shape[1] + rows.take(moved), axis=0)
        return found


def _chosen(flags: Flags) -> Numbers:
    """Return the columns of flags that hold in any of their rows."""
    found: Numbers = (flags[0] if len(flags) == 1 else np.logical_or.reduce(flags, axis=0)).nonzero()[0]
    return found


def _nearest(a: Array, b: Array, uu: Array, vv: Array) -> tuple[Array, Array, Array]:
    """Return where along both the nearest points of pieces are, 0 to 1, and the way between them (`segments.nearest`).

    Args:
        a: Begins of pieces and ways to their ends, components x, y, z, x, y, shape (postures, 2, 5, pieces) [m].
        b: The others, likewise.
        uu: Squares of the lengths of the first ones [m²].
        vv: Of the others [m²].
    """
    u, v = a[:, 1, :3], b[:, 1, :3]
    r = a[:, 0, :3] - b[:, 0, :3]
    ur, vr, uv = np.add.reduce(u * r, axis=1), np.add.reduce(v * r, axis=1), np.add.reduce(u * v, axis=1)
    both = uu * vv
    wide = both - uv * uv
    both *= PARALLEL_PIECES
    s = (uv * vr - ur * vv) * (wide > both)
    s /= np.maximum(wide, both)
    np.maximum(s, ZERO, out=s)
    np.minimum(s, ONE, out=s)
    at = uv * s
    at += vr
    at /= vv
    t = np.maximum(at, ZERO)
    np.minimum(t, ONE, out=t)
    again = uv * t
    again -= ur
    again /= uu
    np.maximum(again, ZERO, out=again)
    np.minimum(again, ONE, out=again)
    np.copyto(s, again, where=t != at)
    r += s[:, None] * u
    r -= t[:, None] * v
    return s, t, r
