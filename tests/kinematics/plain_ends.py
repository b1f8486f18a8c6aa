"""A second opinion on `hull_ends.py`: the same bounds pair by pair, joint by joint, in plain floats."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from operator import mul

from gateway.kinematics.collision import Point, Posture, at
from gateway.kinematics.separation.segments import nearest
from gateway.kinematics.separation.stopping import STAYS, Extent
from gateway.values import Side, Vector

__all__ = ["PlainEnds"]

Ways = Mapping[Side, Sequence[Extent]]
Move = tuple[float, float, float, float, int]
"""Where an end goes by one joint [m], its bend [m], and the joint's number, 0 to 6."""


class PlainEnds:
    """The ends of the parts on a way, one by one.

    Args:
        posture: The body before it.
        reach: Greatest levers of each part (`levers`).
        ways: Extents of the joints' ways, shape (7,) per side [rad].
    """

    def __init__(self, posture: Posture, reach: Sequence[Vector], ways: Ways) -> None:
        self._posture = posture
        self._reach = reach
        self._ways = ways
        self._moves: dict[int, list[Move]] = {}
        self._parts: dict[int, tuple[float, float]] = {}
        far = {side: [max(high, -low) for low, high in ways[side]] for side in Side}
        self._goes_m = [
            sum(map(mul, row, far[capsule.side])) if row and capsule.side is not None else 0.0
            for capsule, row in zip(posture.model.capsules, reach, strict=True)
        ]
        """How far each part can go at all [m]."""

    def within(self, gap_m: float) -> list[tuple[float, int]]:
        """Return gaps and numbers of the pairs that might be nearer than a gap somewhere on the way."""
        goes_m = self._goes_m
        segments, middles = self._posture.segments, self._posture.middles
        dist, sqrt = math.dist, math.sqrt
        found: list[tuple[float, int]] = []
        for number, (i, j, around_m, radii_m) in enumerate(self._posture.model.pairs):
            cut_m = gap_m + goes_m[i] + goes_m[j]
            if dist(middles[i], middles[j]) - around_m < cut_m:
                square, s, t = nearest(segments[i], segments[j])
                now_m = sqrt(square) - radii_m
                if now_m < cut_m:
                    found.append((now_m, number))
                    self._parts[number] = s, t
        return found

    def kept_m(self, gap_m: float, number: int) -> float:
        """Return the least gap on the way of a pair that `within` found, whichever joint goes first [m]."""
        i, j, _, _ = self._posture.model.pairs[number]
        s, t = self._parts[number]
        x, y, z = self._normal(number)
        kept_m = gap_m + self._least(i, s, x, y, z)
        return kept_m + self._least(j, t, -x, -y, -z) if self._goes_m[j] else kept_m

    def closing(self, number: int) -> set[tuple[Side, int]]:
        """Return the joints, 0 to 6, by which an end of a pair that `within` found comes nearer on the way."""
        model = self._posture.model
        i, j, _, _ = model.pairs[number]
        x, y, z = self._normal(number)
        return {
            (side, k)
            for index, (nx, ny, nz) in ((i, (x, y, z)), (j, (-x, -y, -z)))
            if (side := model.capsules[index].side) is not None and self._reach[index]
            for end in (0, 1)
            for wx, wy, wz, bend, k in self._moves_of(index, end)
            if bend > nx * wx + ny * wy + nz * wz
        }

    def _normal(self, number: int) -> Point:
        """Return the direction from a pair's second part to its first."""
        i, j, _, _ = self._posture.model.pairs[number]
        s, t = self._parts[number]
        px, py, pz, ux, uy, uz, _ = self._posture.segments[i]
        qx, qy, qz, vx, vy, vz, _ = self._posture.segments[j]
        return self._posture.normal(
            i, j, px + s * ux - qx - t * vx, py + s * uy - qy - t * vy, pz + s * uz - qz - t * vz
        )

    def _least(self, index: int, part: float, nx: float, ny: float, nz: float) -> float:
        """Return how far a part goes along a direction, at the least [m]: not above 0.

        Args:
            index: Of the part.
            part: Where along its line the nearest point is, 0 to 1.
            nx: Away from the other part, unit vector.
            ny: Likewise.
            nz: Likewise.
        """
        _, _, _, ux, uy, uz, _ = self._posture.segments[index]
        ahead = nx * ux + ny * uy + nz * uz  # how far its end lies behind its begin
        least, goes_m = 0.0, self._goes_m[index]
        for end, slack_m in ((0, -part * ahead), (1, (1.0 - part) * ahead)):
            if slack_m < goes_m + least:
                along_m = slack_m if slack_m > 0.0 else 0.0
                for wx, wy, wz, bend, _ in self._moves_of(index, end):
                    step = nx * wx + ny * wy + nz * wz - bend
                    if step < 0.0:
                        along_m += step
                if along_m < slack_m - goes_m:
                    along_m = slack_m - goes_m
                if along_m < least:
                    least = along_m
        return least

    def _moves_of(self, index: int, end: int) -> list[Move]:
        """Return where an end of a part goes by each joint that goes at all; by a joint that goes both ways twice."""
        found = self._moves.get(2 * index + end)
        if found is not None:
            return found
        found = self._moves[2 * index + end] = []
        posture = self._posture
        capsule = posture.model.capsules[index]
        if capsule.side is None:
            return found
        px, py, pz = at(posture.segments[index], float(end))
        lines, before = posture.lines[capsule.side], 0.0
        ways, reach = self._ways[capsule.side], self._reach[index]
        for k in range(capsule.after):
            way = ways[k]
            if way == STAYS:
                continue
            x, y, z, ax, ay, az = lines[6 * k : 6 * k + 6]
            x, y, z = px - x, py - y, pz - z
            x, y, z = ay * z - az * y, az * x - ax * z, ax * y - ay * x
            for goes in way:
                if goes != 0.0:
                    far = abs(goes)
                    found.append((x * goes, y * goes, z * goes, 0.5 * reach[k] * far * (far + before + before), k))
            before += max(way[1], -way[0])
        return found
