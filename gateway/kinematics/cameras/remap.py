"""Remap: tables that say for every pixel of a new picture where in the old one it comes from, and applying them.

Built once per lens with numpy, applied to every frame: with OpenCV's `remap` where that is installed, else in numpy, with
the same result but for rounding. A pixel of which any part comes from outside the old picture is black in both.
"""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gateway.kinematics.cameras.lens import Lens, Pinhole
from gateway.kinematics.cameras.stereo import Rectification, StereoPair
from gateway.values import ValueRefused

__all__ = ["RemapTable", "straightening", "straightenings"]

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

WEIGHT_BITS = 7
"""Weights are whole parts of 128: four of them times 255, with rounding, stay below 2^16."""


def opencv() -> ModuleType | None:
    """Return OpenCV, or None where it is not installed: only video needs it, and numpy does the same in more time."""
    try:
        return importlib.import_module("cv2")
    except ImportError:
        return None


class RemapTable:
    """Where the pixels of a new picture come from.

    Args:
        source_px: u, v in the old picture for each pixel of the new one, shape (rows, columns, 2) [px]; NaN for nowhere.
        width_px: Columns of the old picture [px].
        height_px: Rows of the old picture [px].

    Attributes:
        u_px: Columns in the old picture, shape (rows, columns), float32; −1 for nowhere.
        v_px: Rows in the old picture, likewise.
        is_inside: Which pixels come from inside the old picture, shape (rows, columns).
    """

    def __init__(self, source_px: Array, width_px: int, height_px: int) -> None:
        u, v = source_px[..., 0], source_px[..., 1]
        with np.errstate(invalid="ignore"):
            self.is_inside = (u >= 0.0) & (u <= width_px - 1) & (v >= 0.0) & (v <= height_px - 1)
        self.u_px = np.where(self.is_inside, u, -1.0).astype(np.float32)
        self.v_px = np.where(self.is_inside, v, -1.0).astype(np.float32)
        self._old = (height_px, width_px)
        self._outside = ~self.is_inside
        u, v = np.where(self.is_inside, u, 0.0), np.where(self.is_inside, v, 0.0)
        left = np.minimum(np.floor(u).astype(np.intp), max(width_px - 2, 0))
        top = np.minimum(np.floor(v).astype(np.intp), max(height_px - 2, 0))
        right, below = np.minimum(left + 1, width_px - 1), np.minimum(top + 1, height_px - 1)
        self._corners = tuple((row * width_px + column).ravel() for row in (top, below) for column in (left, right))
        self._weights = _weights((u - left).ravel(), (v - top).ravel())
        self._cv2 = opencv()

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the new picture."""
        rows, columns = self.is_inside.shape
        return rows, columns

    def apply(self, picture: Picture) -> Picture:
        """Return the new picture, bilinear, black where nothing comes from.

        Args:
            picture: Old one, shape (rows, columns) or (rows, columns, channels).

        Raises:
            ValueRefused: Another size than the table was made for.
        """
        if picture.shape[:2] != self._old:
            raise ValueRefused(f"the table is for a picture of {self._old} rows and columns, not {picture.shape[:2]}")
        return self._by_opencv(picture, self._cv2) if self._cv2 is not None else self.by_numpy(picture)

    def _by_opencv(self, picture: Picture, cv2: Any) -> Picture:  # noqa: ANN401  a module without types
        new: Picture = cv2.remap(picture, self.u_px, self.v_px, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        new[self._outside] = 0
        return new

    def by_numpy(self, picture: Picture) -> Picture:
        """Return the same as `apply` without OpenCV."""
        channels = picture.shape[2:]
        old = np.ascontiguousarray(picture).reshape(self._old[0] * self._old[1], *channels)
        mixed = np.full((self.is_inside.size, *channels), 1 << (WEIGHT_BITS - 1), dtype=np.uint16)
        for corner, weight in zip(self._corners, self._weights, strict=True):
            part = old.take(corner, axis=0).astype(np.uint16)
            part *= weight.reshape(-1, *(1 for _ in channels))
            mixed += part
        mixed >>= WEIGHT_BITS
        new: Picture = mixed.astype(np.uint8).reshape(*self.shape, *channels)
        new[self._outside] = 0
        return new


def _weights(right: Array, below: Array) -> tuple[NDArray[np.uint16], ...]:
    """Return the weights of the four corners; they are whole and sum to 2^WEIGHT_BITS in every pixel."""
    one = 1 << WEIGHT_BITS
    exact = np.stack(((1 - right) * (1 - below), right * (1 - below), (1 - right) * below, right * below)) * one
    whole = np.floor(exact + 0.5)
    whole[np.argmax(exact, axis=0), np.arange(exact.shape[1])] += one - whole.sum(axis=0)
    return tuple(whole.astype(np.uint16))


def straightening(lens: Lens, new: Pinhole, level_R_camera: Array | None = None) -> RemapTable:
    """Return the table that turns a lens's picture into that of a pinhole (undistortion).

    Args:
        lens: Of the old picture.
        new: Of the new picture.
        level_R_camera: Directions of the old lens's optical frame to those of the new one's, shape (3, 3); None for none.
    """
    intrinsics = new.intrinsics
    v, u = np.indices((intrinsics.height_px, intrinsics.width_px), dtype=np.float64)
    rays = new.rays(np.stack((u, v), axis=-1))
    if level_R_camera is not None:
        rays = rays @ level_R_camera  # row vectors: the inverse turn
    return RemapTable(lens.project(rays).px, *lens.intrinsics.size_px)


def straightenings(pair: StereoPair, rectification: Rectification) -> tuple[RemapTable, RemapTable]:
    """Return the tables that rectify a pair, left and right."""
    return (
        straightening(pair.left, rectification.pinhole, rectification.level_R_left),
        straightening(pair.right, rectification.pinhole, rectification.level_R_right),
    )
