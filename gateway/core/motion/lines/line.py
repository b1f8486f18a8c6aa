"""Line: where an end effector is on its straight way to a pose, as a function of the part of the way that is behind it.

The position moves along the straight line, the orientation about one fixed axis, the shorter way: the same way that an arm in
end-effector mode goes (`pose_path.py`). Poses are those of `left_ee` / `right_ee` in the arm's own shoulder frame. It knows
no joints and no time.
"""

from __future__ import annotations

import math

from msgspec import Struct

from gateway.core.motion.poses.quaternion import exp, multiply, turn, unit
from gateway.kinematics.placement import Placement, rows_from_quat
from gateway.values import EePose, Vector

__all__ = ["Line", "line_to"]


class Line(Struct, frozen=True, kw_only=True):
    """A straight way.

    Attributes:
        begin: Where it begins.
        moved_m: To where the position goes from there, shape (3,) [m].
        turned_rad: Rotation vector of the turn, about the axes of the shoulder frame, at most π long, shape (3,) [rad].
    """

    begin: EePose
    moved_m: Vector
    turned_rad: Vector

    @property
    def length_m(self) -> float:
        """Way of the position [m]."""
        return math.hypot(*self.moved_m)

    @property
    def angle_rad(self) -> float:
        """Angle of the turn [rad]."""
        return math.hypot(*self.turned_rad)

    def at(self, part: float) -> Placement:
        """Return where the end effector is in the shoulder frame.

        Args:
            part: Of the way, 0 to 1.
        """
        x, y, z = [p + part * way for p, way in zip(self.begin.p_m, self.moved_m, strict=True)]
        turned = exp(tuple([part * r for r in self.turned_rad]))
        return Placement((x, y, z), rows_from_quat(unit(multiply(turned, self.begin.quat_xyzw))))


def line_to(begin: EePose, end: EePose) -> Line:
    """Return the straight way from a pose to another one; both signs of a quaternion are the same orientation."""
    return Line(
        begin=begin,
        moved_m=tuple([b - a for a, b in zip(begin.p_m, end.p_m, strict=True)]),
        turned_rad=turn(begin.quat_xyzw, end.quat_xyzw),
    )
