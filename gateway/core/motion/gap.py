"""How far two setpoints of an arm are apart: joints by the worst of them, poses by distance and by angle."""

from __future__ import annotations

import math
from operator import sub
from typing import NamedTuple

from gateway.core.motion.poses.quaternion import angle_rad
from gateway.values import Space, Vector

__all__ = ["Gap", "gap"]


class Gap(NamedTuple):
    """A distance between two setpoints, or the bound of one.

    Attributes:
        rad: Largest distance of a joint, or the angle between two orientations [rad].
        m: Distance between two positions [m]; 0 for joints, whose bounds have 0 here as well.
    """

    rad: float
    m: float = 0.0

    def exceeds(self, bound: Gap) -> bool:
        """Whether it is beyond a bound in either."""
        return self.rad > bound.rad or self.m > bound.m

    def worst(self, other: Gap) -> Gap:
        """Return the greater of both, each on its own."""
        return Gap(max(self.rad, other.rad), max(self.m, other.m))

    def text(self, space: Space) -> str:
        """Return it in words, e.g. `0.031 rad` or `0.012 m and 0.031 rad`."""
        return f"{self.rad:.4g} rad" if space is Space.JOINT else f"{self.m:.4g} m and {self.rad:.4g} rad"


def gap(space: Space, a: Vector, b: Vector) -> Gap:
    """Return how far two setpoints of a space are apart."""
    if space is Space.JOINT:
        return Gap(max(map(abs, map(sub, a, b))))
    return Gap(angle_rad(a[3:], b[3:]), math.dist(a[:3], b[:3]))
