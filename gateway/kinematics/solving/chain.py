"""Chain: forward kinematics and Jacobian of one arm, from its shoulder frame to its end effector, for any description.

The joints are kept as lines (a point and an axis) in the shoulder frame with the arm at zero; the placement of the tip is
the product of the turns about them. Plain floats: seven joints take some microseconds, an array library ten times that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gateway.kinematics.description import Description, Joint, arm_joint, ee_frame
from gateway.kinematics.placement import Placement, Rows, origin
from gateway.robot.topics import shoulder_frame
from gateway.values import Side, Vector

__all__ = ["ArmChain", "Line", "Motion", "at_zero", "in_base"]

Array = NDArray[np.float64]

IDENTITY = Placement((0.0, 0.0, 0.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))

SNAP = 1e-14
"""Rounding of products of right angles: a component nearer than this to a whole number is that number."""

Line = tuple[Vector, Vector]
"""A joint's axis: a point on it [m] and its direction, unit vector."""


Motion = tuple[float, ...]
"""How a link has moved from where it is with the arm at zero: where the shoulder's origin would be carried [m], then the
rotation's rows, flat, shape (12,)."""


class ArmChain:
    """An arm between `*_shoulder_base` and `*_ee`.

    Attributes:
        lines: Axes of joints 1 to 7 with the arm at zero, in the shoulder frame.
        zero: Placement of the end effector in the shoulder frame with the arm at zero.
    """

    def __init__(self, description: Description, side: Side) -> None:
        shoulder = _fixed(description.above(shoulder_frame(side)))
        base_T_link = _fixed(description.above(description.joints[arm_joint(side, 1)].parent))
        at = shoulder.inverse().after(base_T_link)
        arm = {joint.name for joint in description.arm(side)}
        lines: list[Line] = []
        for joint in description.above(ee_frame(side)):
            if joint.name in arm or lines:
                at = at.after(origin(joint))
                if joint.name in arm:
                    lines.append((_snapped(at.p_m), _snapped(at.turned(joint.axis))))
        self.side = side
        self.lines: tuple[Line, ...] = tuple(lines)
        x, y, z = (_snapped(row) for row in at.rows)
        self.zero = Placement(_snapped(at.p_m), (x, y, z))
        self._steps = [(*point, *axis) for point, axis in lines]

    def forward(self, q_rad: Sequence[float]) -> Placement:
        """Return the end effector in the shoulder frame.

        Args:
            q_rad: Joint angles, shape (7,) [rad], order of §4.0.3; not judged by limits.
        """
        return self._walk(q_rad, None)

    def jacobian(self, q_rad: Sequence[float]) -> Array:
        """Return how the end effector moves by joint velocities, in the shoulder frame.

        Args:
            q_rad: Joint angles, shape (7,) [rad].

        Returns:
            Shape (6, 7): velocity of the end effector's origin [m/rad], then angular velocity [rad/rad].
        """
        lines: list[float] = []
        px, py, pz = self._walk(q_rad, lines).p_m
        columns: list[list[float]] = []
        for index in range(0, len(lines), 6):
            x, y, z, ax, ay, az = lines[index : index + 6]
            x, y, z = px - x, py - y, pz - z
            columns.append([ay * z - az * y, az * x - ax * z, ax * y - ay * x, ax, ay, az])
        return np.array(columns).T

    def walk(self, q_rad: Sequence[float]) -> tuple[list[float], list[Motion]]:
        """Return where the arm's lines are and how its links have moved, in the shoulder frame.

        Args:
            q_rad: Joint angles, shape (7,) [rad]; not judged by limits.

        Returns:
            For each joint its point [m] and axis, flat, shape (42,); for each joint the motion of what it moves.
        """
        lines: list[float] = []
        motions: list[Motion] = []
        self._walk(q_rad, lines, motions)
        return lines, motions

    def _walk(
        self, q_rad: Sequence[float], lines: list[float] | None, motions: list[Motion] | None = None
    ) -> Placement:
        """Turn joint by joint; add each one's point and axis, where they are now, to `lines`."""
        xx, xy, xz, yx, yy, yz, zx, zy, zz = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
        px = py = pz = 0.0  # of the point that is at the shoulder's origin with the arm at zero
        for (rx, ry, rz, ax, ay, az), angle in zip(self._steps, q_rad, strict=True):
            c, s = math.cos(angle), math.sin(angle)
            # Where the axis is now; the point on it stays, everything beyond turns.
            wx, wy, wz = (
                px + xx * rx + xy * ry + xz * rz,
                py + yx * rx + yy * ry + yz * rz,
                pz + zx * rx + zy * ry + zz * rz,
            )
            if lines is not None:
                lines += (wx, wy, wz)
                lines += (xx * ax + xy * ay + xz * az, yx * ax + yy * ay + yz * az, zx * ax + zy * ay + zz * az)
            if ax == 0.0 and az == 0.0:
                s *= ay
                xx, xz = c * xx - s * xz, c * xz + s * xx
                yx, yz = c * yx - s * yz, c * yz + s * yx
                zx, zz = c * zx - s * zz, c * zz + s * zx
            elif ay == 0.0 and az == 0.0:
                s *= ax
                xy, xz = c * xy + s * xz, c * xz - s * xy
                yy, yz = c * yy + s * yz, c * yz - s * yy
                zy, zz = c * zy + s * zz, c * zz - s * zy
            elif ax == 0.0 and ay == 0.0:
                s *= az
                xx, xy = c * xx + s * xy, c * xy - s * xx
                yx, yy = c * yx + s * yy, c * yy - s * yx
                zx, zy = c * zx + s * zy, c * zy - s * zx
            else:
                (a, b, d), (e, f, g), (h, i, j) = _turn(ax, ay, az, c, s)
                xx, xy, xz = xx * a + xy * e + xz * h, xx * b + xy * f + xz * i, xx * d + xy * g + xz * j
                yx, yy, yz = yx * a + yy * e + yz * h, yx * b + yy * f + yz * i, yx * d + yy * g + yz * j
                zx, zy, zz = zx * a + zy * e + zz * h, zx * b + zy * f + zz * i, zx * d + zy * g + zz * j
            px, py, pz = (
                wx - (xx * rx + xy * ry + xz * rz),
                wy - (yx * rx + yy * ry + yz * rz),
                wz - (zx * rx + zy * ry + zz * rz),
            )
            if motions is not None:
                motions.append((px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz))
        (x, y, z), ((a, b, d), (e, f, g), (h, i, j)) = self.zero
        return Placement(
            (px + xx * x + xy * y + xz * z, py + yx * x + yy * y + yz * z, pz + zx * x + zy * y + zz * z),
            (
                (xx * a + xy * e + xz * h, xx * b + xy * f + xz * i, xx * d + xy * g + xz * j),
                (yx * a + yy * e + yz * h, yx * b + yy * f + yz * i, yx * d + yy * g + yz * j),
                (zx * a + zy * e + zz * h, zx * b + zy * f + zz * i, zx * d + zy * g + zz * j),
            ),
        )


def at_zero(description: Description, link: str, within: str) -> Placement | None:
    """Return a link's placement in another one with all joints at zero; None where one of them is not there."""
    links = {joint.child for joint in description.joints.values()}
    if not {link, within} <= links:
        return None
    return _fixed(description.above(within)).inverse().after(_fixed(description.above(link)))


def in_base(description: Description, link: str) -> Placement:
    """Return a link's placement in `base_link` with all joints at zero.

    Raises:
        KeyError: There is no such link.
    """
    return _fixed(description.above(link))


def _fixed(joints: Sequence[Joint]) -> Placement:
    """Return the placement at the end of some joints that stand at zero."""
    at = IDENTITY
    for joint in joints:
        at = at.after(origin(joint))
    return at


def _snapped(v: Vector) -> Vector:
    return tuple([float(round(c)) + 0.0 if abs(c - round(c)) < SNAP else c for c in v])


def _turn(x: float, y: float, z: float, c: float, s: float) -> Rows:
    """Return the rotation about a unit axis whose cosine and sine are given (Rodrigues)."""
    k = 1.0 - c
    return (
        (c + k * x * x, k * x * y - s * z, k * x * z + s * y),
        (k * x * y + s * z, c + k * y * y, k * y * z - s * x),
        (k * x * z - s * y, k * y * z + s * x, c + k * z * z),
    )
