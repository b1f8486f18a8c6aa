"""Placement: where one frame is in another, in plain floats. For seven joints that is faster than any array library.

`parent_T_child` names a placement of the child in the parent; `parent_T_child.after(child_T_tip)` chains. Rotations are
three rows; quaternions are xyzw with unit norm, of which both signs are the same orientation.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from gateway.kinematics.description import Joint
from gateway.values import EePose, Vector

__all__ = ["Placement", "Rows", "origin", "quat_from_rows", "rows_from_quat", "rows_from_rpy", "turn_rad"]

Rows = tuple[Vector, Vector, Vector]


class Placement(NamedTuple):
    """A frame in its parent.

    Attributes:
        p_m: Origin, shape (3,) [m].
        rows: Rotation matrix, rows, shape (3, 3): child coordinates to the parent's.
    """

    p_m: Vector
    rows: Rows

    @staticmethod
    def of(pose: EePose) -> Placement:
        """Return the placement of a pose."""
        return Placement(pose.p_m, rows_from_quat(pose.quat_xyzw))

    @property
    def pose(self) -> EePose:
        """The same with a quaternion."""
        return EePose(p_m=self.p_m, quat_xyzw=quat_from_rows(self.rows))

    def point(self, v: Vector) -> Vector:
        """Return a point of the child in the parent, shape (3,) [m]."""
        x, y, z = v
        return tuple([p + a * x + b * y + c * z for p, (a, b, c) in zip(self.p_m, self.rows, strict=True)])

    def turned(self, v: Vector) -> Vector:
        """Return a direction of the child in the parent, shape (3,)."""
        x, y, z = v
        return tuple([a * x + b * y + c * z for a, b, c in self.rows])

    def after(self, inner: Placement) -> Placement:
        """Return `parent_T_tip` for `child_T_tip`."""
        columns = [self.turned(column) for column in zip(*inner.rows, strict=True)]
        x, y, z = zip(*columns, strict=True)
        return Placement(self.point(inner.p_m), (x, y, z))

    def inverse(self) -> Placement:
        """Return `child_T_parent`."""
        x, y, z = zip(*self.rows, strict=True)
        rows = (x, y, z)
        px, py, pz = self.p_m
        return Placement(tuple([-(a * px + b * py + c * pz) for a, b, c in rows]), rows)


def origin(joint: Joint) -> Placement:
    """Return the placement of a joint's frame in its parent's link, joint at zero."""
    return Placement(joint.xyz_m, rows_from_rpy(joint.rpy_rad))


def rows_from_rpy(rpy_rad: Vector) -> Rows:
    """Return the rotation matrix Rz(yaw) Ry(pitch) Rx(roll) of a URDF's angles, shape (3,) [rad]."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(angle), math.sin(angle)) for angle in rpy_rad)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def rows_from_quat(quat_xyzw: Vector) -> Rows:
    """Return the rotation matrix of a unit quaternion."""
    x, y, z, w = quat_xyzw
    xx, yy, zz = x * x, y * y, z * z
    xy, xz, yz, xw, yw, zw = x * y, x * z, y * z, x * w, y * w, z * w
    return (
        (1.0 - 2.0 * (yy + zz), 2.0 * (xy - zw), 2.0 * (xz + yw)),
        (2.0 * (xy + zw), 1.0 - 2.0 * (xx + zz), 2.0 * (yz - xw)),
        (2.0 * (xz - yw), 2.0 * (yz + xw), 1.0 - 2.0 * (xx + yy)),
    )


def quat_from_rows(rows: Rows) -> Vector:
    """Return the unit quaternion of a rotation matrix, from its largest component for accuracy; w is never negative."""
    (a, b, c), (d, e, f), (g, h, i) = rows
    squares = (1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i, 1.0 + a + e + i)
    largest = squares.index(max(squares))
    x, y, z, w = (
        (squares[0], b + d, g + c, h - f),
        (b + d, squares[1], f + h, c - g),
        (g + c, f + h, squares[2], d - b),
        (h - f, c - g, d - b, squares[3]),
    )[largest]
    scale = math.copysign(1.0 / math.sqrt(x * x + y * y + z * z + w * w), w)
    return x * scale, y * scale, z * scale, w * scale


def turn_rad(a: Rows, b: Rows) -> Vector:
    """Return the rotation vector, in the parent, that turns orientation `a` into `b` on the shorter way [rad]."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = a
    (dx, dy, dz), (ex, ey, ez), (fx, fy, fz) = b
    xx, yy, zz = dx * ax + dy * ay + dz * az, ex * bx + ey * by + ez * bz, fx * cx + fy * cy + fz * cz
    xy, yx = dx * bx + dy * by + dz * bz, ex * ax + ey * ay + ez * az
    xz, zx = dx * cx + dy * cy + dz * cz, fx * ax + fy * ay + fz * az
    yz, zy = ex * cx + ey * cy + ez * cz, fx * bx + fy * by + fz * bz
    trace = xx + yy + zz
    if trace > 0.0:  # up to some 120 degrees the part that is not symmetric tells everything
        x, y, z = 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)
        sine = math.sqrt(x * x + y * y + z * z)
        factor = 1.0 if sine < 1e-12 else math.atan2(sine, 0.5 * (trace - 1.0)) / sine
        return x * factor, y * factor, z * factor
    x, y, z, w = quat_from_rows(((xx, xy, xz), (yx, yy, yz), (zx, zy, zz)))
    length = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 * math.atan2(length, w) / length
    return x * factor, y * factor, z * factor
