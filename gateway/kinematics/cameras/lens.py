"""Lenses: from a point in a camera's optical frame to a pixel and back, pinhole and OpenCV's fisheye model.

Optical frame: x right, y down, z ahead. Pixels: u right, v down, and the middle of the first pixel is (0, 0), as OpenCV
counts. The fisheye model (§5.5) is that of Kannala and Brandt, "A generic camera model and calibration method for
conventional, wide-angle, and fish-eye lenses", 2006, with OpenCV's four coefficients:
θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸), θ the angle to the optical axis.

A polynomial may turn back: beyond the angle at which θ_d stops growing two directions would share a pixel, so nothing is
seen there (`Fisheye.reach_rad`).
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import ArrayLike, NDArray

from gateway.values import ValueRefused, Vector, require_finite

__all__ = ["Fisheye", "Intrinsics", "Lens", "Pinhole", "Projection"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NEWTON_STEPS = 60
"""More than enough: halving the bracket alone gains a bit each step."""

ASPECT_TOLERANCE = 0.002
"""How much the shape of a scaled picture may differ [ratio]: a pixel in 500."""


class Projection(NamedTuple):
    """Where points are in a picture.

    Attributes:
        px: u, v, shape (..., 2) [px]; NaN where the model has no pixel for the direction.
        is_visible: Whether the point is in front of the lens and inside the picture, shape (...).
    """

    px: Array
    is_visible: Mask


class Intrinsics(Struct, frozen=True, kw_only=True):
    """Focal lengths, principal point and size of a picture.

    Attributes:
        fx_px: Focal length along u [px].
        fy_px: Focal length along v [px].
        cx_px: Principal point, u [px].
        cy_px: Principal point, v [px].
        width_px: Columns [px].
        height_px: Rows [px].
    """

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: int
    height_px: int

    def __post_init__(self) -> None:
        """Refuse what is no camera."""
        require_finite("intrinsics", (self.fx_px, self.fy_px, self.cx_px, self.cy_px), 4)
        if min(self.fx_px, self.fy_px) <= 0.0:
            raise ValueRefused(f"focal lengths are {self.fx_px:g}, {self.fy_px:g} px; both must be above 0")
        if min(self.width_px, self.height_px) < 1:
            raise ValueRefused(f"the picture is {self.width_px} × {self.height_px} px; at least 1 × 1 is needed")
        if not (0.0 <= self.cx_px < self.width_px and 0.0 <= self.cy_px < self.height_px):
            raise ValueRefused(
                f"the principal point ({self.cx_px:g}, {self.cy_px:g}) px is outside the picture of "
                f"{self.width_px} × {self.height_px} px: do size and intrinsics belong together?"
            )

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height [px]."""
        return self.width_px, self.height_px

    def scaled(self, width_px: int, height_px: int) -> Intrinsics:
        """Return the intrinsics of the same picture at another size.

        Raises:
            ValueRefused: The shape differs: that would be another part of the picture.
        """
        sx, sy = width_px / self.width_px, height_px / self.height_px
        if abs(sx / sy - 1.0) > ASPECT_TOLERANCE:
            raise ValueRefused(
                f"{self.width_px} × {self.height_px} px cannot be scaled to {width_px} × {height_px} px: another shape"
            )
        # A pixel's middle is at a whole number, its edge half a pixel before: edges scale, middles do not.
        return Intrinsics(
            fx_px=sx * self.fx_px,
            fy_px=sy * self.fy_px,
            cx_px=sx * (self.cx_px + 0.5) - 0.5,
            cy_px=sy * (self.cy_px + 0.5) - 0.5,
            width_px=width_px,
            height_px=height_px,
        )

    def pixels(self, plane: Array) -> Array:
        """Return pixels of points on the plane at distance 1, shape (..., 2)."""
        return np.asarray(plane * (self.fx_px, self.fy_px) + (self.cx_px, self.cy_px))

    def plane(self, px: ArrayLike) -> Array:
        """Return points on the plane at distance 1 of pixels, shape (..., 2)."""
        return np.asarray((np.asarray(px, dtype=np.float64) - (self.cx_px, self.cy_px)) / (self.fx_px, self.fy_px))

    def contains(self, px: Array) -> Mask:
        """Return which pixels lie inside the picture, edges included, shape (...); NaN does not."""
        u, v = px[..., 0], px[..., 1]
        return np.asarray((u >= -0.5) & (u <= self.width_px - 0.5) & (v >= -0.5) & (v <= self.height_px - 0.5))


class Lens(Protocol):
    """A camera model."""

    @property
    def intrinsics(self) -> Intrinsics:
        """Focal lengths, principal point, size."""

    def project(self, xyz_m: ArrayLike) -> Projection:
        """Return where points of the optical frame are in the picture, from shape (..., 3) [m]."""

    def rays(self, px: ArrayLike) -> Array:
        """Return unit directions in the optical frame of pixels of shape (..., 2), shape (..., 3); NaN where none is."""

    def scaled(self, width_px: int, height_px: int) -> Lens:
        """Return the lens for a picture of another size and the same shape [px]."""


def _points(xyz_m: ArrayLike) -> Array:
    points = np.asarray(xyz_m, dtype=np.float64)
    if points.ndim == 0 or points.shape[-1] != 3:
        raise ValueRefused(f"points have shape (..., 3), not {points.shape}")
    return points


class Pinhole(Struct, frozen=True):
    """A lens without distortion.

    Attributes:
        intrinsics: Focal lengths, principal point, size.
    """

    intrinsics: Intrinsics

    def project(self, xyz_m: ArrayLike) -> Projection:
        """Return where points are in the picture; those not in front (z <= 0) are nowhere."""
        points = _points(xyz_m)
        z = np.where(points[..., 2:] > 0.0, points[..., 2:], np.nan)
        px = self.intrinsics.pixels(points[..., :2] / z)
        return Projection(px, self.intrinsics.contains(px))

    def rays(self, px: ArrayLike) -> Array:
        """Return the unit directions of pixels."""
        plane = self.intrinsics.plane(px)
        rays = np.concatenate((plane, np.ones((*plane.shape[:-1], 1))), axis=-1)
        return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))

    def scaled(self, width_px: int, height_px: int) -> Pinhole:
        """Return the lens for a picture of another size."""
        return Pinhole(self.intrinsics.scaled(width_px, height_px))


class Fisheye(Struct, frozen=True):
    """OpenCV's fisheye model, without skew.

    Attributes:
        intrinsics: Focal lengths, principal point, size.
        k: k1, k2, k3, k4; shape (4,).
    """

    intrinsics: Intrinsics
    k: Vector = (0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Refuse other than four finite coefficients."""
        require_finite("k", self.k, 4)

    @property
    def reach_rad(self) -> float:
        """Largest angle to the optical axis that has a pixel of its own, at most π [rad]."""
        k1, k2, k3, k4 = self.k
        roots = np.roots([9.0 * k4, 7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0])  # of dθ_d/dθ, in θ²
        turns = [root.real for root in roots if abs(root.imag) < 1e-9 * abs(root) and root.real > 0.0]
        return min([math.pi, *(math.sqrt(turn) for turn in turns)])

    def _bent(self, theta: Array) -> Array:
        """Return θ_d of angles [rad]."""
        t = theta * theta
        k1, k2, k3, k4 = self.k
        return np.asarray(theta * (1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4)))))

    def _slope(self, theta: Array) -> Array:
        t = theta * theta
        k1, k2, k3, k4 = self.k
        return np.asarray(1.0 + t * (3.0 * k1 + t * (5.0 * k2 + t * (7.0 * k3 + t * 9.0 * k4))))

    def project(self, xyz_m: ArrayLike) -> Projection:
        """Return where points are in the picture; a lens of more than 180° sees some that are behind it, too."""
        points = _points(xyz_m)
        across = np.linalg.norm(points[..., :2], axis=-1)
        theta = np.arctan2(across, points[..., 2])
        is_seen = (theta <= self.reach_rad) & ((across > 0.0) | (points[..., 2] > 0.0))
        with np.errstate(invalid="ignore", divide="ignore"):
            towards = np.where(across[..., None] > 0.0, points[..., :2] / across[..., None], 0.0)
        bent = np.where(is_seen, self._bent(theta), np.nan)
        px = self.intrinsics.pixels(towards * bent[..., None])
        return Projection(px, self.intrinsics.contains(px))

    def rays(self, px: ArrayLike) -> Array:
        """Return the unit directions of pixels, by Newton's method inside a bracket; NaN beyond `reach_rad`."""
        plane = self.intrinsics.plane(px)
        bent = np.linalg.norm(plane, axis=-1)
        theta = self._straightened(bent)
        with np.errstate(invalid="ignore", divide="ignore"):
            towards = np.where(bent[..., None] > 0.0, plane / bent[..., None], 0.0)
        return np.concatenate((towards * np.sin(theta)[..., None], np.cos(theta)[..., None]), axis=-1)

    def _straightened(self, bent: Array) -> Array:
        """Return the angles of θ_d [rad]; NaN where there is none."""
        reach = self.reach_rad
        low, high = np.zeros_like(bent), np.full_like(bent, reach)
        theta = np.minimum(bent, reach)
        last_move = np.full_like(bent, reach)
        for _ in range(NEWTON_STEPS):
            error = self._bent(theta) - bent
            low, high = np.where(error < 0.0, theta, low), np.where(error >= 0.0, theta, high)
            with np.errstate(divide="ignore", invalid="ignore"):
                newton = theta - error / self._slope(theta)
            # A step that does not halve the one before may go on for ever between two points: halve the bracket instead.
            is_good = (newton > low) & (newton < high) & (np.abs(newton - theta) <= 0.5 * last_move)
            moved = np.where(error == 0.0, theta, np.where(is_good, newton, 0.5 * (low + high)))
            last_move = np.abs(moved - theta)
            theta = moved
            if np.nanmax(last_move, initial=0.0) <= 4e-16 * math.pi:
                break
        return np.where(bent <= self._bent(np.array(reach)), theta, np.nan)

    def scaled(self, width_px: int, height_px: int) -> Fisheye:
        """Return the lens for a picture of another size; angles stay what they are."""
        return replace(self, intrinsics=self.intrinsics.scaled(width_px, height_px))
