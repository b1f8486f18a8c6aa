"""Levers: how far the ends of an arm's parts can ever be away from the axes that move them, in any posture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from operator import mul

from gateway.kinematics.capsules import Capsule
from gateway.kinematics.collision import WIDE_OPEN_M, CollisionModel
from gateway.kinematics.solving.chain import Line
from gateway.values import Vector

__all__ = ["levers"]

MEET_M = 1e-9
"""Axes that miss each other by less meet [m]."""
PARALLEL = 1e-12
"""Square of the sine below which two axes count as parallel."""


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
