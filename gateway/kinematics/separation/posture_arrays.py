"""PostureArrays: where the lines of the body's parts and the axes of its joints are, in arrays, for several postures at once.

The same as `CollisionModel.posture` in plain floats, for those who look at all parts tick by tick: a call of an array library
costs the same for one posture and for a few. A joint's turn about its line is still + cos(q) cosine + sin(q) sine, three
constant matrices; the product of the turns from the shoulder outwards carries a link from where it is with the arm at zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gateway.kinematics.collision import WIDE_OPEN_M, CollisionModel
from gateway.kinematics.separation.levers import levers
from gateway.values import ARM_DOF, Side, Vector

__all__ = ["JOINTS", "Parts", "PostureArrays", "crossed"]

Array = NDArray[np.float64]

SIDES = tuple(Side)
ARM_OF = {side: number for number, side in enumerate(Side)}
JOINTS = len(SIDES) * ARM_DOF
"""Joints of both arms: 0 to 6 of the left one, 7 to 13 of the right one."""
LEAST_M2 = 1e-30
"""Square of the length of a line that is a point [m²]."""
TWICE = np.array([0, 1, 2, 0, 1])
"""Components x, y, z, x, y: two neighbouring threes of them give a cross product."""


class Parts:
    """What of a body's parts does not change with its posture, as arrays.

    Args:
        model: Parts and pairs; those that joints move come first.

    Attributes:
        count: How many parts there are.
        moving: How many of them joints move.
        reach_m: Greatest levers of each part by the joints, shape (parts, 14); 0 where a joint does not move it [m].
        square_m2: Squares of the lengths of the parts' lines, shape (parts,) [m²].
        first: Numbers of the first parts of all pairs.
        second: Numbers of the second ones.
        around_m: Radii of spheres around both parts of each pair, added up [m].
        radii_m: Radii of both parts of each pair, added up [m].
    """

    def __init__(self, model: CollisionModel) -> None:
        capsules = model.capsules
        moving = [(capsule, capsule.side) for capsule in capsules if capsule.side is not None and capsule.after]
        self.count, self.moving = len(capsules), len(moving)
        self.reach_m = np.zeros((self.count, JOINTS))
        for row, capsule, lever_m in zip(self.reach_m, capsules, levers(model), strict=True):
            if capsule.side is not None and lever_m:
                begin = ARM_OF[capsule.side] * ARM_DOF
                row[begin : begin + ARM_DOF] = lever_m
        pairs = np.array(model.pairs)
        self.first, self.second = pairs[:, 0].astype(np.intp), pairs[:, 1].astype(np.intp)
        self.around_m, self.radii_m = pairs[:, 2].copy(), pairs[:, 3].copy()
        at_zero = np.array(model.posture(dict.fromkeys(Side, (0.0,) * ARM_DOF)).segments)
        self.square_m2 = np.maximum(at_zero[:, 6], LEAST_M2)
        self._pieces = at_zero[:, :6].T.reshape(2, 3, self.count).take(TWICE, axis=1)
        lines = [line for side in Side for line in model.chains[side].lines]
        turns = [_turn(*line) for line in lines]
        for arm, side in enumerate(Side):
            shoulder = np.eye(4)
            shoulder[:3, 3] = model.shoulders[side]
            turns[arm * ARM_DOF] = tuple(shoulder @ part for part in turns[arm * ARM_DOF])
        still, cosine, sine = (np.array(row) for row in zip(*turns, strict=True))
        self._still, self._cosine, self._sine = (
            row.reshape(len(SIDES), ARM_DOF, 1, 4, 4).transpose(1, 0, 2, 3, 4).copy() for row in (still, cosine, sine)
        )
        carried = [(k % ARM_DOF, k // ARM_DOF) for k in range(JOINTS)]
        carried += [(capsule.after - 1, ARM_OF[side]) for capsule, side in moving]
        self._turn = np.array([len(SIDES) * joint + arm for joint, arm in carried])
        self._columns = np.zeros((JOINTS + self.moving, 4, 2))
        for number, (point, axis) in enumerate(lines):
            self._columns[number, :, 0], self._columns[number, :, 1] = (*point, 1.0), (*axis, 0.0)
        for number, (capsule, _) in enumerate(moving, start=JOINTS):
            ends = [
                [c + WIDE_OPEN_M * d for c, d in zip(end, capsule.opens, strict=True)]
                for end in (capsule.from_m, capsule.to_m)
            ]
            way = [b - a for a, b in zip(*ends, strict=True)]
            self._columns[number, :, 0], self._columns[number, :, 1] = (*ends[0], 1.0), (*way, 0.0)

    def stand(self, postures: Sequence[Mapping[Side, Vector]]) -> PostureArrays:
        """Return the body with its joints at some angles, lift at its top, grippers wide open.

        Args:
            postures: Joint angles of both arms, shape (7,) each [rad].
        """
        angles = np.array([[q_rad[side] for side in SIDES] for q_rad in postures]).T[..., None, None]
        turns = np.cos(angles) * self._cosine
        turns += self._still
        turns += np.sin(angles) * self._sine  # (7, 2, postures, 4, 4)
        for k in range(1, ARM_DOF):
            turns[k] = np.matmul(turns[k - 1], turns[k])
        count = len(postures)
        # (joints and moving parts, postures, 4, 2): a point and a way of each
        found = np.matmul(turns.reshape(JOINTS, count, 4, 4).take(self._turn, axis=0), self._columns[:, None])
        # ... as (postures, point or way, xyzxy, joints and moving parts)
        found = found.transpose(1, 3, 2, 0).take(TWICE, axis=2)
        pieces = np.empty((count, 2, 5, self.count))
        pieces[:] = self._pieces
        pieces[..., : self.moving] = found[..., JOINTS:]
        lines = np.empty((count, 6, JOINTS))
        lines[:, :3] = found[:, 1, :3, :JOINTS]
        lines[:, 3:] = crossed(found[:, 0, :, :JOINTS], found[:, 1, :, :JOINTS])
        return PostureArrays(pieces, lines)


class PostureArrays:
    """The body in some postures.

    Args:
        pieces: Of each part's line where it begins and the way to its end in `chest` [m], with components x, y, z, x, y,
            shape (postures, 2, 5, parts).
        lines: Of each joint the direction of its axis, and its moment about the origin [m], shape (postures, 6, 14).
    """

    __slots__ = ("lines", "pieces")

    def __init__(self, pieces: Array, lines: Array) -> None:
        self.pieces = pieces
        self.lines = lines


def crossed(a: Array, b: Array) -> Array:
    """Return cross products; components x, y, z, x, y on the last axis but one of both, x, y, z in what is returned."""
    return a[..., 1:4, :] * b[..., 2:5, :] - a[..., 2:5, :] * b[..., 1:4, :]


def _turn(point: Vector, axis: Vector) -> tuple[Array, ...]:
    """Return what of the turn about a line stays, goes with the cosine and with the sine of its angle, shape (4, 4) each."""
    along = np.outer(axis, axis)
    x, y, z = axis
    aside = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    found = []
    for turned in (along, np.eye(3) - along, aside):
        part = np.zeros((4, 4))
        part[:3, :3], part[:3, 3] = turned, -turned @ np.array(point)
        found.append(part)
    found[0][:3, 3] += point
    found[0][3, 3] = 1.0
    return tuple(found)
