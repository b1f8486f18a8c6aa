"""Stereo: two lenses side by side, turned by calculation until their rows agree (rectification).

After rectification both eyes look the same way, at right angles to their baseline, through the same pinhole: a point is
in the same row of both pictures, and its distance is f · b / (u_left − u_right).

Which way the eyes are turned is the method of Bouguet (each by half of what is between them, then both until the baseline
is the row), as OpenCV's `fisheye.stereoRectify` has it. A calibration that brings its own turns (§5.5: RRawL_Row,
RRawR_Row) is taken at its word after they were checked to do just that.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from gateway.kinematics.cameras.lens import Intrinsics, Lens, Pinhole
from gateway.kinematics.transform import Transform
from gateway.values import ValueRefused

__all__ = ["Rectification", "StereoPair", "level_pinhole", "rectified_by", "turned_level"]

Array = NDArray[np.float64]

LEVEL_TOLERANCE_RAD = 0.01
"""How far turns that a file brings may be from level and parallel [rad]: ours, some pixels of the crop."""


class StereoPair(Struct, frozen=True, kw_only=True):
    """Two eyes.

    Attributes:
        left: Lens of the left eye.
        right: Lens of the right eye.
        right_T_left: The left eye's optical frame in the right one's, named with the frames of the tree.

    Raises:
        ValueRefused: The right eye is not to the right of the left one: swapped eyes, or the transform is the other way.
    """

    left: Lens
    right: Lens
    right_T_left: Transform

    def __post_init__(self) -> None:
        """Refuse eyes in the wrong order."""
        x, y, z = self.right_T_left.inverse.p_m.tolist()
        if x <= 0.0 or math.hypot(y, z) > x:
            raise ValueRefused(
                f"the right eye is at ({1e3 * x:.1f}, {1e3 * y:.1f}, {1e3 * z:.1f}) mm in the left eye's frame (x right, "
                "y down, z ahead), which is not to its right: eyes swapped, or R | T given the other way (§5.5)"
            )

    @property
    def baseline_m(self) -> float:
        """Distance of the eyes [m]."""
        return float(np.linalg.norm(self.right_T_left.p_m))


class Rectification(Struct, frozen=True, kw_only=True):
    """How a pair's pictures are turned.

    Attributes:
        level_R_left: Directions of the left eye's optical frame to those of the level frame, shape (3, 3).
        level_R_right: The same of the right eye.
        pinhole: Lens of both pictures afterwards.
        baseline_m: Distance of the eyes [m].
    """

    level_R_left: Array
    level_R_right: Array
    pinhole: Pinhole
    baseline_m: float

    def depth_m(self, disparity_px: Array | float) -> Array:
        """Return the distance along the optical axis [m] of u_left − u_right [px]; infinity where that is not above 0."""
        disparity = np.asarray(disparity_px, dtype=np.float64)
        with np.errstate(divide="ignore"):
            depth = self.pinhole.intrinsics.fx_px * self.baseline_m / disparity
        return np.where(disparity > 0.0, depth, np.inf)


def level_pinhole(width_px: int, height_px: int, field_of_view_rad: float) -> Pinhole:
    """Return a pinhole in the middle of a picture.

    Args:
        width_px: Columns [px].
        height_px: Rows [px].
        field_of_view_rad: Across the width [rad], below π: the wider, the less is left of the middle.

    Raises:
        ValueRefused: No such field of view.
    """
    if not 0.0 < field_of_view_rad < math.pi:
        raise ValueRefused(f"a pinhole sees more than 0 and less than π rad, not {field_of_view_rad:g}")
    f_px = 0.5 * width_px / math.tan(0.5 * field_of_view_rad)
    return Pinhole(
        Intrinsics(
            fx_px=f_px,
            fy_px=f_px,
            cx_px=0.5 * (width_px - 1),
            cy_px=0.5 * (height_px - 1),
            width_px=width_px,
            height_px=height_px,
        )
    )


def turned_level(pair: StereoPair, field_of_view_rad: float = math.radians(90.0)) -> Rectification:
    """Return the rectification of a pair.

    Args:
        pair: Both eyes.
        field_of_view_rad: Across the width of the pictures afterwards [rad]; their size is that of the left eye.

    Raises:
        ValueRefused: No such field of view.
    """
    half = _half(pair.right_T_left.rotation)  # takes the left eye half of the way to the right one
    towards = half.T @ pair.right_T_left.p_m  # from the right eye to the left one, in between
    row = -towards / np.linalg.norm(towards)
    level = _shortest_turn(row, np.array([1.0, 0.0, 0.0]))
    return Rectification(
        level_R_left=level @ half,
        level_R_right=level @ half.T,
        pinhole=level_pinhole(*pair.left.intrinsics.size_px, field_of_view_rad),
        baseline_m=pair.baseline_m,
    )


def rectified_by(
    pair: StereoPair, level_R_left: Array, level_R_right: Array, field_of_view_rad: float = math.radians(90.0)
) -> Rectification:
    """Return the rectification with turns that a calibration brings (§5.5), after checking that they rectify.

    Args:
        pair: Both eyes.
        level_R_left: RRawL_Row as rows, shape (3, 3).
        level_R_right: RRawR_Row as rows, shape (3, 3).
        field_of_view_rad: Across the width of the pictures afterwards [rad].

    Raises:
        ValueRefused: After these turns the eyes are not parallel, or the baseline is not the row: for instance because
            they are given the other way round.
    """
    for name, turn in (("RRawL_Row", level_R_left), ("RRawR_Row", level_R_right)):
        if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-3 or np.linalg.det(turn) <= 0.0:
            raise ValueRefused(f"{name} is no rotation (§5.5)")
    apart = level_R_right @ pair.right_T_left.rotation @ level_R_left.T
    row = -(level_R_right @ pair.right_T_left.p_m) / pair.baseline_m
    worst = max(_angle_rad(apart), math.acos(min(1.0, float(row[0]))))
    if worst > LEVEL_TOLERANCE_RAD:
        raise ValueRefused(
            f"after RRawL_Row and RRawR_Row the eyes are {math.degrees(worst):.2f}° from parallel and level, up to "
            f"{math.degrees(LEVEL_TOLERANCE_RAD):.2f}° is allowed: rows and columns swapped, or of another pair? (§5.5)"
        )
    return Rectification(
        level_R_left=level_R_left,
        level_R_right=level_R_right,
        pinhole=level_pinhole(*pair.left.intrinsics.size_px, field_of_view_rad),
        baseline_m=pair.baseline_m,
    )


def _angle_rad(rotation: Array) -> float:
    axis = [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    return math.atan2(0.5 * float(np.linalg.norm(axis)), 0.5 * (float(np.trace(rotation)) - 1.0))


def _half(rotation: Array) -> Array:
    """Return the rotation about the same axis by half the angle; below π, as two eyes of a head are."""
    root = rotation + np.eye(3)  # maps every vector to twice its mean with the turned one: axis kept, angle halved
    u, _, vt = np.linalg.svd(root)
    return np.asarray(u @ vt)


def _shortest_turn(start: Array, end: Array) -> Array:
    """Return the rotation that takes one unit vector to another without rolling; they must not be opposite."""
    cross, cosine = np.cross(start, end), float(start @ end)
    skew = np.array([[0.0, -cross[2], cross[1]], [cross[2], 0.0, -cross[0]], [-cross[1], cross[0], 0.0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / (1.0 + cosine))
