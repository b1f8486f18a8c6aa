"""Segments: where two straight pieces are nearest to each other, in plain floats.

Each is a point and the way to its other end. The nearest points are those of the two lines, drawn back to the pieces' ends
one after the other (Ericson, Real-Time Collision Detection, 5.1.9); parallel pieces have many, of which one is taken.
"""

from __future__ import annotations

__all__ = ["Segment", "nearest", "segment"]

Segment = tuple[float, float, float, float, float, float, float]
"""Begin x, y, z [m]; from there to the end x, y, z [m]; the square of the length [m²]."""

PARALLEL = 1e-12
"""Square of the sine below which two directions count as one."""


def segment(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> Segment:
    """Return the piece from a to b [m]."""
    x, y, z = bx - ax, by - ay, bz - az
    return ax, ay, az, x, y, z, x * x + y * y + z * z


def nearest(a: Segment, b: Segment) -> tuple[float, float, float]:
    """Return the nearest points of two pieces.

    Returns:
        Square of their distance [m²]; where along a and where along b they are, 0 to 1 of the length.
    """
    px, py, pz, ux, uy, uz, uu = a
    qx, qy, qz, vx, vy, vz, vv = b
    rx, ry, rz = px - qx, py - qy, pz - qz
    ur = ux * rx + uy * ry + uz * rz
    vr = vx * rx + vy * ry + vz * rz
    uv = ux * vx + uy * vy + uz * vz
    wide = uu * vv - uv * uv
    s = (uv * vr - ur * vv) / wide if wide > PARALLEL * uu * vv else 0.0
    s = 0.0 if s < 0.0 else 1.0 if s > 1.0 else s
    t = (uv * s + vr) / vv if vv > 0.0 else 0.0
    if t < 0.0 or t > 1.0 or vv == 0.0:
        t = 0.0 if t < 0.0 else 1.0 if t > 1.0 else t
        s = (uv * t - ur) / uu if uu > 0.0 else 0.0
        s = 0.0 if s < 0.0 else 1.0 if s > 1.0 else s
    rx += s * ux - t * vx
    ry += s * uy - t * vy
    rz += s * uz - t * vz
    return rx * rx + ry * ry + rz * rz, s, t
