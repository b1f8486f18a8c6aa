"""Shape: what makes an arm solvable in closed form, found in its axes rather than believed.

This robot's arms, at zero, have axes along y x y | z | y x z of the shoulder frame. The first three meet in the shoulder,
the last three in the wrist, which is where the end effector's frame is; the elbow's axis stands 30 mm beside the line from
shoulder to wrist and at right angles to it. So shoulder and wrist are spherical joints, the elbow alone sets how far they
are apart, and the arm turns freely about the line through both: one angle is left over, the arm angle.

A single robot's calibrated arm has the shape of the described one, its joints' zeros, its frame and its end effector being
elsewhere. A description whose axes miss each other a little still has this shape nearly: then the closed form is where a
numerical search begins. `gap` says how nearly.
"""

from __future__ import annotations

import math

from msgspec import Struct

from gateway.kinematics.placement import Placement
from gateway.kinematics.solving.chain import ArmChain
from gateway.values import ARM_DOF, Vector

__all__ = ["EXACT", "NEAR", "ArmShape", "shape_of"]

AXES = (1, 0, 1, 2, 1, 0, 2)
"""Which coordinate axis of the shoulder frame joints 1 to 7 lie along, at zero."""

EXACT = 1e-9
"""Axes that miss by less than this meet [m, rad]: it is rounding of the numbers."""

NEAR = 0.05
"""Axes that miss by more than this are another arm [m, rad]: the closed form says nothing about it."""


class ArmShape(Struct, frozen=True, kw_only=True):
    """An arm as two spherical joints and an elbow.

    Attributes:
        signs: Sense of each joint about its coordinate axis, 1 or -1, shape (7,).
        shoulder_m: Where axes 1, 2, 3 meet, in the shoulder frame, shape (3,) [m].
        upper_m: From there to the elbow's axis, arm at zero: x, y [m].
        lower_m: From the elbow's axis to the wrist, arm at zero: x, y [m].
        tip: Placement of the end effector in a frame at the wrist that is parallel to the shoulder's, arm at zero.
        gap: By how much the arm's axes miss this shape at most [m, rad]; rounding when it is the arm's own.
        worst: What misses by that much, for people.
        zeros_rad: What joint angles of this shape have beyond those that are told and asked for, shape (7,) [rad].
        base: Placement of the shape's shoulder frame in that of the poses; None where they are one.
    """

    signs: Vector
    shoulder_m: Vector
    upper_m: Vector
    lower_m: Vector
    tip: Placement
    gap: float
    worst: str
    zeros_rad: Vector = (0.0,) * ARM_DOF
    base: Placement | None = None

    @property
    def is_exact(self) -> bool:
        """Whether the closed form is the arm's own."""
        return self.gap < EXACT

    @property
    def is_near(self) -> bool:
        """Whether the closed form is at least a place to begin."""
        return self.gap < NEAR


def shape_of(chain: ArmChain) -> ArmShape:
    """Return the shape that is nearest to an arm; its `gap` says whether it is the arm's own."""
    (s1, d1), (s2, d2), (s3, d3), (e, d4), (w5, d5), (w6, d6), (w7, d7) = chain.lines
    directions = (d1, d2, d3, d4, d5, d6, d7)
    shoulder = (s1[0], s2[1], s1[2])
    wrist = (w5[0], w6[1], w5[2])
    misses = {
        f"joint {joint} leans out of its coordinate axis [rad]": math.atan2(
            math.hypot(direction[axis - 1], direction[axis - 2]), abs(direction[axis])
        )
        for joint, (axis, direction) in enumerate(zip(AXES, directions, strict=True), start=1)
    }
    misses |= {
        "axes 1 and 3 are apart [m]": math.hypot(s1[0] - s3[0], s1[2] - s3[2]),
        "axes 1 and 2 are apart [m]": abs(s1[2] - s2[2]),
        "axes 5 and 6 are apart [m]": abs(w5[2] - w6[2]),
        "axes 5 and 7 are apart [m]": abs(w5[0] - w7[0]),
        "axes 6 and 7 are apart [m]": abs(w6[1] - w7[1]),
        "the wrist is beside the plane of shoulder and elbow [m]": abs(wrist[2] - shoulder[2]),
    }
    worst = max(misses, key=lambda what: misses[what])
    at = tuple([p - w for p, w in zip(chain.zero.p_m, wrist, strict=True)])
    return ArmShape(
        signs=tuple([math.copysign(1.0, direction[axis]) for axis, direction in zip(AXES, directions, strict=True)]),
        shoulder_m=shoulder,
        upper_m=(e[0] - shoulder[0], e[1] - shoulder[1]),
        lower_m=(wrist[0] - e[0], wrist[1] - e[1]),
        tip=Placement(at, chain.zero.rows),
        gap=misses[worst],
        worst=worst,
    )
