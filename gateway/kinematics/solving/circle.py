"""Circle: all joint angles that hold an end effector in one place, as a function of the arm angle.

With shoulder, elbow and wrist as in `shape.py`, a pose fixes where the wrist is and with that the elbow joint; the arm can
still turn about the line from shoulder to wrist. The arm angle says how far: at 0 the elbow hangs below that line, a
positive angle lifts it outward, away from the other arm. "Below" is straight down for a wrist straight ahead, and is
carried along with the wrist by the shortest turn; so the angle is smooth everywhere but for a wrist straight behind.

Every entry of the rotation matrices of shoulder and wrist is a constant plus a cosine plus a sine of the arm angle, and
the joint angles are the Euler angles of these matrices (as Shimizu et al., IEEE Transactions on Robotics 24(5), 2008, and
Kreutz-Delgado et al., 1992, work it out for an arm without offsets). Where a joint meets a limit is therefore a root of
a + b cos + c sin: `sectors.py`.

Angles here are those about the coordinate axes of `shape.py`, named a1 to a7; a joint angle is one of them times a sign.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from gateway.kinematics.placement import Placement
from gateway.kinematics.solving.shape import ArmShape
from gateway.values import Side, Vector

__all__ = ["Circle", "Elbow", "Wave", "arm_angle_rad", "elbows", "wrist_of"]

Wave = tuple[float, float, float]
"""a + b cos ψ + c sin ψ of the arm angle ψ."""

ALIGNED = 1e-10
"""Square of the sine of a2 below which axes 1 and 3 count as nearly one: a3 then follows from a1, so that the sum is exact.
The same for the cosine of a6 and axes 5 and 7."""
ONE_AXIS = 1e-20
"""... and below which they are one: a1 can be chosen."""


class Elbow(NamedTuple):
    """One of the two ways to bend the elbow for a distance from shoulder to wrist.

    Attributes:
        a4: Angle of the elbow.
        sense: 1 or -1, on which side of the line from shoulder to wrist the elbow is, in the arm's own plane.
        ux: Line to the wrist in the upper arm's frame, unit vector, x.
        uy: The same, y.
        gx: Cosine of the angle from the line to the forearm's x axis, in the arm's plane.
        gy: Its sine.
    """

    a4: float
    sense: float
    ux: float
    uy: float
    gx: float
    gy: float


def wrist_of(shape: ArmShape, target: Placement) -> tuple[Vector, tuple[Vector, Vector, Vector]]:
    """Return the vector from shoulder to wrist [m], shape (3,), and the columns of the wrist's orientation."""
    (px, py, pz), (rx, ry, rz) = target if shape.base is None else shape.base.inverse().after(target)
    (tx, ty, tz), tip = shape.tip
    # Columns of target.rows times the transpose of tip.rows: row i of the tip is where its axis i ends.
    x, y, z = [(rx[0] * a + rx[1] * b + rx[2] * c, ry[0] * a + ry[1] * b + ry[2] * c, rz[0] * a + rz[1] * b + rz[2] * c)
               for a, b, c in tip]  # fmt: skip
    sx, sy, sz = shape.shoulder_m
    if tx or ty or tz:
        px -= x[0] * tx + y[0] * ty + z[0] * tz
        py -= x[1] * tx + y[1] * ty + z[1] * tz
        pz -= x[2] * tx + y[2] * ty + z[2] * tz
    return (px - sx, py - sy, pz - sz), (x, y, z)


def elbows(shape: ArmShape, distance_m: float) -> tuple[Elbow, ...]:
    """Return both ways to bend the elbow so that the wrist is so far from the shoulder; none if no angle does it."""
    (ux, uy), (fx, fy) = shape.upper_m, shape.lower_m
    along, across = ux * fx + uy * fy, uy * fx - ux * fy
    cosine = (distance_m * distance_m - ux * ux - uy * uy - fx * fx - fy * fy) / (2.0 * math.hypot(along, across))
    if not -1.0 <= cosine <= 1.0 or distance_m <= 0.0:
        return ()
    middle, spread = math.atan2(across, along), math.acos(cosine)
    return _elbow(shape, distance_m, middle + spread), _elbow(shape, distance_m, middle - spread)


def _elbow(shape: ArmShape, distance_m: float, angle: float) -> Elbow:
    (ux, uy), (fx, fy) = shape.upper_m, shape.lower_m
    c, s = math.cos(angle), math.sin(angle)
    x, y = (ux + c * fx - s * fy) / distance_m, (uy + s * fx + c * fy) / distance_m
    sense = 1.0 if uy * x - ux * y >= 0.0 else -1.0
    return Elbow(math.remainder(angle, math.tau), sense, x, y, c * x + s * y, s * x - c * y)


def arm_angle_rad(shape: ArmShape, side: Side, a: Vector) -> float:
    """Return the arm angle of a configuration [rad], in (-π, π]."""
    c1, s1, c2, s2, c3, s3 = (
        math.cos(a[0]), math.sin(a[0]), math.cos(a[1]), math.sin(a[1]), math.cos(a[2]), math.sin(a[2]),
    )  # fmt: skip
    c4, s4 = math.cos(a[3]), math.sin(a[3])
    (ux, uy), (fx, fy) = shape.upper_m, shape.lower_m
    vx, vy = ux + c4 * fx - s4 * fy, uy + s4 * fx + c4 * fy
    # Columns x and y of Ry(a1) Rx(a2) Ry(a3).
    xx, xy, xz = c1 * c3 - s1 * c2 * s3, s2 * s3, -s1 * c3 - c1 * c2 * s3
    yx, yy, yz = s1 * s2, c2, c1 * s2
    length = math.hypot(vx, vy)
    wx, wy, wz = (vx * xx + vy * yx) / length, (vx * xy + vy * yy) / length, (vx * xz + vy * yz) / length
    # Towards the elbow, at right angles to the line.
    sense = length if uy * vx - ux * vy >= 0.0 else -length
    mx, my, mz = (vx * yx - vy * xx) / sense, (vx * yy - vy * xy) / sense, (vx * yz - vy * xz) / sense
    lean = _lean(wx, wy, wz)
    out, up = my - wy * mx / lean, mz - wz * mx / lean
    return math.atan2(out if side is Side.LEFT else -out, -up)


def _lean(x: float, y: float, z: float) -> float:
    """Return 1 + x of a unit vector, exact for x near -1, never 0."""
    return max(1.0 + x if x > 0.0 else (y * y + z * z) / (1.0 - x), 1e-300)


class Circle:
    """The joint angles of one pose and one way to bend the elbow, by arm angle.

    Args:
        shape: Of the arm, `is_near` at least; poses are reached as if the shape were exact.
        side: Which arm: outward is left of the left one and right of the right one.
        line_m: From shoulder to wrist, shape (3,) [m]; not zero.
        wrist: Columns of the wrist's orientation.
        elbow: How the elbow is bent; fits to the length of the line.

    Attributes:
        elbow: The same.
        free_a1: Angle of joint 1 where axes 1 and 3 are one, so that only the sum of both angles is known [rad].
        waves: r01, r21, r11, r10, r12 of the shoulder's rotation matrix, then m02, m22, m12, m10, m11 of the wrist's.
    """

    __slots__ = ("_columns", "_direction", "_normal", "_outward", "elbow", "free_a1", "waves")

    def __init__(
        self, shape: ArmShape, side: Side, line_m: Vector, wrist: tuple[Vector, Vector, Vector], elbow: Elbow
    ) -> None:
        wx, wy, wz = line_m
        length = math.sqrt(wx * wx + wy * wy + wz * wz)
        wx, wy, wz = wx / length, wy / length, wz / length
        lean = _lean(wx, wy, wz)
        ux, uy, gx, gy = elbow.ux, elbow.uy, elbow.gx, elbow.gy
        # "Outward" and "up", carried along with the wrist by the shortest turn from straight ahead.
        oy, oz = 1.0 - wy * wy / lean, -wy * wz / lean
        vz = 1.0 - wz * wz / lean
        ox, vx, vy = -wy, -wz, oz
        if wx < 0.0 and lean < 1e-299:
            oy, oz, vz, vy = -1.0, 0.0, 1.0, 0.0
        # Towards the elbow: -up cos + outward sin. The plane's normal is the line times that.
        sense = elbow.sense
        outward = sense if side is Side.LEFT else -sense
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = wrist
        # Components of the wrist's columns along the line, outward, up.
        aw, bw, cw = ax * wx + ay * wy + az * wz, bx * wx + by * wy + bz * wz, cx * wx + cy * wy + cz * wz
        ao, bo, co = ax * ox + ay * oy + az * oz, bx * ox + by * oy + bz * oz, cx * ox + cy * oy + cz * oz
        av, bv, cv = ax * vx + ay * vy + az * vz, bx * vx + by * vy + bz * vz, cx * vx + cy * vy + cz * vz
        xc, xs, yc, ys, gc, gs = ux * sense, ux * outward, uy * sense, uy * outward, gx * sense, gx * outward
        hc, hs = gy * sense, gy * outward
        self.elbow = elbow
        self.free_a1 = 0.0
        self.waves: tuple[Wave, ...] = (
            (uy * wx, -xc * vx, xs * ox),
            (uy * wz, -xc * vz, xs * oz),
            (uy * wy, -xc * vy, xs * oy),
            (ux * wy, yc * vy, -ys * oy),
            (0.0, sense * oy, outward * vy),
            (gx * cw, -hc * cv, hs * co),
            (0.0, sense * co, outward * cv),
            (-gy * cw, -gc * cv, gs * co),
            (-gy * aw, -gc * av, gs * ao),
            (-gy * bw, -gc * bv, gs * bo),
        )
        self._direction = (wx, wy, wz)
        self._columns = (aw, bw, sense * ao, outward * ao, sense * av, outward * av,
                         sense * bo, outward * bo, sense * bv, outward * bv)  # fmt: skip
        self._normal = (sense * ox, outward * vx, sense * oz, outward * vz)
        self._outward = 1.0 if side is Side.LEFT else -1.0

    def at(self, arm_angle_rad: float, shoulder: float, wrist: float) -> tuple[Vector, Vector]:
        """Return the angles a1 to a7 at an arm angle, and how fast each changes with it.

        Args:
            arm_angle_rad: Any [rad].
            shoulder: Sign of the sine of a2: which of two ways the shoulder does it.
            wrist: Sign of the cosine of a6: which of two ways the wrist does it.

        Returns:
            Angles in (-π, π], shape (7,) [rad], and their rates, shape (7,) [rad/rad].
        """
        c, s = math.cos(arm_angle_rad), math.sin(arm_angle_rad)
        r01, r21, r11, r10, r12, m02, m22, m12, m10, m11 = [a + b * c + d * s for a, b, d in self.waves]
        wx, wy, wz = self._direction
        a4, _, _, _, gx, gy = self.elbow
        o = self._outward
        square = r01 * r01 + r21 * r21
        sine = math.sqrt(square)
        # The shoulder turns about the line; the wrist, seen from the forearm, the other way.
        spin = o * (r01 * wx + r21 * wz) / max(square, 1e-30)
        wide = m02 * m02 + m22 * m22
        cosine = math.sqrt(wide)
        back = -o * gx * m02 / max(wide, 1e-30)
        a1 = math.atan2(shoulder * r01, shoulder * r21)
        if square > ALIGNED:
            a3 = math.atan2(shoulder * r10, -shoulder * r12)
        else:  # whatever a1 is, a3 makes the sum right
            a1 = a1 if square > ONE_AXIS else self.free_a1
            nx, mx, nz, mz = self._normal
            x, z, c1, s1 = nx * c + mx * s, nz * c + mz * s, math.cos(a1), math.sin(a1)
            a3 = math.atan2(c1 * x - s1 * z, math.copysign(1.0, r11) * (s1 * x + c1 * z))
        a5 = math.atan2(wrist * m02, wrist * m22)
        a7 = math.atan2(wrist * m10, wrist * m11) if wide > ALIGNED else self._a7(c, s, a5)
        return (
            a1,
            math.atan2(shoulder * sine, r11),
            a3,
            a4,
            a5,
            math.atan2(-m12, wrist * cosine),
            a7,
        ), (
            o * wy - spin * r11,
            shoulder * o * (r21 * wx - r01 * wz) / max(sine, 1e-15),
            spin,
            0.0,
            o * gy - back * m12,
            -wrist * o * gx * m22 / max(cosine, 1e-15),
            back,
        )

    def _a7(self, c: float, s: float, a5: float) -> float:
        """Return a7 where axes 5 and 7 are nearly one: whatever a5 is, the sum comes out right."""
        aw, bw, aoc, aos, avc, avs, boc, bos, bvc, bvs = self._columns
        _, _, _, _, gx, gy = self.elbow
        c5, s5 = math.cos(a5), math.sin(a5)
        m00, m01 = gx * aw + gy * (aos * s - avc * c), gx * bw + gy * (bos * s - bvc * c)
        m20, m21 = aoc * c + avs * s, boc * c + bvs * s
        return math.atan2(s5 * m21 - c5 * m01, c5 * m00 - s5 * m20)
