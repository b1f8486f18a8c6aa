"""The eyes' fisheye lenses: where a crop's pixels look, and where that is in a picture drawn without distortion.

OpenCV's fisheye model: a ray at angle θ from the axis is seen at f·θ·(1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) from the centre.

* Head: the published example of one robot's eye, at the size of the crop (the stream's crops are the sensor's, halved).
* Wrist: nobody publishes one. Both its fields of view, 120 deg across and 76 deg down, are those of an equidistant lens
  (306 and 302 pixels per radian), so it is one of them.

What lies further than 68 deg from the axis is black: a plane picture that shows it would be mostly that.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["WIDEST_RAD", "Lens", "lens_of"]

Array = NDArray[np.float64]

WIDEST_RAD: Final = np.deg2rad(68.0)
"""Greatest angle from the axis that is drawn [rad]."""

_FURTHEST_RAD: Final = np.deg2rad(100.0)
_ROUNDS: Final = 12


class Lens:
    """A fisheye in front of a crop.

    Args:
        size: Width and height of the crop [pixels].
        focal_px: fx and fy at this size [pixels].
        centre_px: cx and cy at this size [pixels]; the first pixel's middle is 0.
        k: k1 to k4.

    Attributes:
        drawn: Width and height of the undistorted picture to draw [pixels].
        fovy_deg: Its field of view from top to bottom [deg].
        source: For each pixel of the crop where it is in that picture, as row * width + column, shape (height, width);
            -1 where nothing is drawn.
    """

    def __init__(
        self,
        size: tuple[int, int],
        focal_px: tuple[float, float],
        centre_px: tuple[float, float],
        k: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    ) -> None:
        width, height = size
        columns, rows = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
        x, y = (columns - centre_px[0]) / focal_px[0], (rows - centre_px[1]) / focal_px[1]
        distorted = np.hypot(x, y)
        theta = _undistorted(distorted, k)
        is_drawn = theta <= WIDEST_RAD
        stretch = np.where(distorted > 1e-9, np.tan(np.minimum(theta, WIDEST_RAD)) / np.maximum(distorted, 1e-9), 1.0)
        right, down = x * stretch, y * stretch  # on the plane at distance 1
        across, along = float(np.abs(right[is_drawn]).max()), float(np.abs(down[is_drawn]).max())
        scale = width / (2.0 * across)
        self.drawn = (width, max(1, round(2.0 * along * scale)))
        self.fovy_deg = float(np.rad2deg(2.0 * np.arctan(0.5 * self.drawn[1] / scale)))
        column = np.floor(right * scale + 0.5 * self.drawn[0]).astype(np.int64).clip(0, self.drawn[0] - 1)
        row = np.floor(down * scale + 0.5 * self.drawn[1]).astype(np.int64).clip(0, self.drawn[1] - 1)
        self.source = np.where(is_drawn, row * self.drawn[0] + column, -1)
        self.source.setflags(write=False)
        self._flat = np.maximum(self.source, 0)
        self._black = np.flatnonzero(self.source < 0)

    def see(self, plane: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return what the eye sees of an undistorted picture.

        Args:
            plane: Of the size `drawn`, shape (height, width, 3).
        """
        seen: NDArray[np.uint8] = np.take(plane.reshape(-1, 3), self._flat, axis=0)
        seen.reshape(-1, 3)[self._black] = 0
        return seen


def lens_of(camera: Mapping[str, Any], size: tuple[int, int]) -> Lens:
    """Return the lens of a camera of the body's numbers before a crop of a size.

    Args:
        camera: Its table.
        size: Width and height of the crop [pixels].
    """
    example = camera.get("example_fisheye")
    if example is None:
        focal_px = 0.5 * size[0] / np.deg2rad(0.5 * camera["field_of_view_deg"][0])
        return Lens(size, (focal_px, focal_px), (0.5 * (size[0] - 1), 0.5 * (size[1] - 1)))
    across, down = (crop / sensor for crop, sensor in zip(size, camera["sensor_px"], strict=True))
    # A pixel's middle is a whole number: halving a picture moves it by a quarter of a pixel.
    centre_px = ((example["cx_px"] + 0.5) * across - 0.5, (example["cy_px"] + 0.5) * down - 0.5)
    k1, k2, k3, k4 = example["k"]
    return Lens(size, (example["fx_px"] * across, example["fy_px"] * down), centre_px, (k1, k2, k3, k4))


def _undistorted(distorted: Array, k: tuple[float, float, float, float]) -> Array:
    """Return the angles that the lens shows at these, by Newton's method."""
    theta = np.minimum(distorted, _FURTHEST_RAD)
    for _ in range(_ROUNDS):
        square = theta * theta
        value = theta * (1.0 + square * (k[0] + square * (k[1] + square * (k[2] + square * k[3])))) - distorted
        slope = 1.0 + square * (3.0 * k[0] + square * (5.0 * k[1] + square * (7.0 * k[2] + square * 9.0 * k[3])))
        theta = np.clip(theta - value / np.maximum(slope, 0.1), 0.0, _FURTHEST_RAD)
    return theta
