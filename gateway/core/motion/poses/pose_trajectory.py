"""Pose trajectory: the motion of an end effector through poses at given times, as `trajectory.py` has it for joints.

Position and the components of the quaternion run along one interpolating spline; the quaternion is brought back to unit
norm wherever it is asked for, and the signs of the poses are chosen so that it never goes the long way. What it asks
for is worked out with it, at each pose and half-way to the next: distance from the shoulder, linear and angular speed and
acceleration, as norms. Pure numbers: this module knows no limits, no side and no clock.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from msgspec import Struct

from gateway.core.motion.joints.trajectory import Trajectory, interpolate
from gateway.core.motion.poses.quaternion import aligned, unit
from gateway.values import Vector

__all__ = ["PoseTrajectory", "interpolate_poses", "with_signs"]


class PoseTrajectory(Struct, frozen=True, kw_only=True):
    """A motion through poses. Made by `interpolate_poses`.

    Attributes:
        spline: Position [m] and quaternion, not normalised, seven columns.
        points: The poses: x, y, z [m], qx, qy, qz, qw, unit norm, in the signs in which they are passed.
        reach_m: Per piece the greatest distance from the shoulder [m].
        v_mps: Per piece the highest linear speed [m/s].
        a_mps2: Per piece the highest linear acceleration [m/s²].
        w_radps: Per piece the highest angular speed [rad/s].
        dw_radps2: Per piece the highest angular acceleration [rad/s²].
    """

    spline: Trajectory
    points: tuple[Vector, ...]
    reach_m: Vector
    v_mps: Vector
    a_mps2: Vector
    w_radps: Vector
    dw_radps2: Vector

    @property
    def times_s(self) -> Vector:
        """When each pose is passed, rising from 0 [s]."""
        return self.spline.times_s

    @property
    def duration_s(self) -> float:
        """Time from the first to the last pose [s]."""
        return self.spline.duration_s

    def at(self, time_s: float) -> tuple[Vector, Vector, float]:
        """Return pose, linear velocity [m/s] and angular speed [rad/s] at a time; beyond an end, those of the end."""
        place, rates, _ = self.spline.at(time_s)
        norm = math.hypot(*place[3:])
        quat = tuple(c / norm for c in place[3:])
        return place[:3] + quat, rates[:3], _turning(place[3:], rates[3:], norm)


def interpolate_poses(poses: Sequence[Vector], times_s: Sequence[float]) -> PoseTrajectory:
    """Return the smooth motion through poses.

    Args:
        poses: At least two: x, y, z [m], qx, qy, qz, qw, finite, no quaternion near zero; any signs.
        times_s: When each is passed, finite and rising; the first becomes 0 [s].
    """
    rows = with_signs(poses)
    spline = interpolate(rows, times_s)
    at_poses = [_asked_for(*states) for states in _at_points(spline)]
    between = [_asked_for(*states) for states in _half_way(spline)]
    pieces = [tuple(map(max, *three)) for three in zip(at_poses, between, at_poses[1:], strict=False)]
    reach_m, v_mps, a_mps2, w_radps, dw_radps2 = zip(*pieces, strict=True)
    return PoseTrajectory(
        spline=spline,
        points=tuple(rows),
        reach_m=reach_m,
        v_mps=v_mps,
        a_mps2=a_mps2,
        w_radps=w_radps,
        dw_radps2=dw_radps2,
    )


def with_signs(poses: Sequence[Vector]) -> list[Vector]:
    """Return poses with quaternions of unit norm, each in the sign that is nearer to the one before."""
    rows: list[Vector] = []
    for pose in poses:
        quat = unit(tuple(pose[3:]))
        rows.append(tuple(pose[:3]) + (aligned(quat, rows[-1][3:]) if rows else quat))
    return rows


States = tuple[Vector, Vector, Vector]
"""Position and quaternion, their first and their second derivative, seven numbers each."""


def _at_points(spline: Trajectory) -> Iterator[States]:
    """Yield the states at the poses."""
    return zip(zip(*spline.q, strict=True), zip(*spline.v, strict=True), zip(*spline.a, strict=True), strict=True)


def _half_way(spline: Trajectory) -> Iterator[States]:
    """Yield the states half-way from each pose to the next; column by column, a large chunk has thousands of numbers."""
    halves = [0.5 * (end - begin) for begin, end in pairwise(spline.times_s)]
    places, rates, forces = [], [], []
    for columns in zip(spline.q, spline.v, spline.a, spline.j, strict=True):
        pieces = list(zip(halves, *columns, strict=False))
        places.append([q + t * (v + t * (0.5 * a + t * j / 6.0)) for t, q, v, a, j in pieces])
        rates.append([v + t * (a + 0.5 * t * j) for t, _, v, a, j in pieces])
        forces.append([a + t * j for t, _, _, a, j in pieces])
    return zip(zip(*places, strict=True), zip(*rates, strict=True), zip(*forces, strict=True), strict=True)


def _asked_for(place: Vector, v: Vector, a: Vector) -> Vector:
    """Return reach, linear speed and acceleration, angular speed and acceleration."""
    norm = math.hypot(*place[3:])
    w, dw = _turning(place[3:], v[3:], norm), _turning(place[3:], a[3:], norm)
    return math.hypot(*place[:3]), math.hypot(*v[:3]), math.hypot(*a[:3]), w, dw


def _turning(quat: Vector, rate: Vector, norm: float) -> float:
    """Return twice the part of a quaternion's rate that turns it, for norm 1: what lies along it only changes its length."""
    x, y, z, w = quat
    dx, dy, dz, dw = rate
    along = (x * dx + y * dy + z * dz + w * dw) / (norm * norm)
    return 2.0 * math.hypot(dx - along * x, dy - along * y, dz - along * z, dw - along * w) / norm
