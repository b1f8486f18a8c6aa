"""Quaternions and rotation vectors as bare tuples: orientations in xyzw, unit norm; rotation vectors are axis times angle.

A rotation vector r stands for the rotation by |r| about r in the frame in which poses are given, so that `exp(r)` from
the left turns an orientation: `multiply(exp(r), q)`. Both signs of a quaternion are the same orientation; `log` gives the
shorter way, `long_log` the way that the sign says.
"""

from __future__ import annotations

import math

from gateway.values import Vector

__all__ = ["aligned", "angle_rad", "conjugate", "dot", "exp", "log", "long_log", "multiply", "turn", "unit"]


def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product of two vectors of one length."""
    return sum(x * y for x, y in zip(a, b, strict=True))


def multiply(a: Vector, b: Vector) -> Vector:
    """Return the product of two quaternions: first turn by `b`, then by `a`."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def conjugate(q: Vector) -> Vector:
    """Return the inverse of a unit quaternion."""
    return -q[0], -q[1], -q[2], q[3]


def unit(q: Vector) -> Vector:
    """Return a quaternion, not zero, with norm 1."""
    norm = math.hypot(*q)
    return tuple(c / norm for c in q)


def aligned(q: Vector, like: Vector) -> Vector:
    """Return the sign of an orientation that is nearer to `like`."""
    return q if dot(q, like) >= 0.0 else tuple(-c for c in q)


def exp(r: Vector) -> Vector:
    """Return the rotation of a rotation vector [rad]."""
    angle = math.hypot(*r)
    factor = 0.5 - angle * angle / 48.0 if angle < 1e-4 else math.sin(0.5 * angle) / angle
    return r[0] * factor, r[1] * factor, r[2] * factor, math.cos(0.5 * angle)


def long_log(q: Vector) -> Vector:
    """Return the rotation vector of a unit quaternion [rad], longer than π where its w is negative."""
    length = math.hypot(*q[:3])
    factor = 2.0 / q[3] if length < 1e-12 and q[3] > 0.0 else 2.0 * math.atan2(length, q[3]) / max(length, 1e-300)
    return q[0] * factor, q[1] * factor, q[2] * factor


def log(q: Vector) -> Vector:
    """Return the rotation vector of the shorter way [rad], at most π long."""
    return long_log(q if q[3] >= 0.0 else tuple(-c for c in q))


def turn(a: Vector, b: Vector) -> Vector:
    """Return the rotation vector that leads from orientation `a` to `b` on the shorter way [rad]."""
    return log(multiply(b, conjugate(a)))


def angle_rad(a: Vector, b: Vector) -> float:
    """Return the angle between two orientations, 0 to π [rad]."""
    return math.hypot(*turn(a, b))
