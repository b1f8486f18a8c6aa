"""The section of one stereo camera in a calibration file: intrinsics, distortion, R | T, and the turns that level it (§5.5).

KL and KR are fx, fy, cx, cy [px] at the size that the section says, R | T lead from the left eye to the right one. The
manual does not say whether they take points or the eye itself there, so the file's conventions must
(`stereo_extrinsics`), and whichever it says, the right eye must come out on the right.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from gateway.kinematics.calibration_file.conventions import Conventions, numbers
from gateway.kinematics.cameras.eyes import Eye, eyes_of
from gateway.kinematics.cameras.lens import Fisheye, Intrinsics, Lens, Pinhole
from gateway.kinematics.cameras.remap import RemapTable, straightenings
from gateway.kinematics.cameras.stereo import Rectification, StereoPair, rectified_by, turned_level
from gateway.kinematics.frames import FixedEdge, Origin
from gateway.kinematics.transform import Transform, nearest_rigid
from gateway.values import ValueRefused

__all__ = ["CameraCalibration", "camera_of"]

Array = NDArray[np.float64]

MODELS: Final = ("opencv_fisheye", "pinhole")
NEEDED: Final = ("model", "width", "height", "KL", "KR", "R", "T")
OPTIONAL: Final = ("DL", "DR", "RRawL_Row", "RRawR_Row")
RIGID_TOLERANCE: Final = 1e-3


class CameraCalibration(Struct, frozen=True, kw_only=True):
    """One stereo camera of one robot.

    Attributes:
        name: `head`, `left_wrist` or `right_wrist`.
        pair: Both eyes, at the size at which they were calibrated.
        levels: Turns that level the left and the right eye, as the file brings them, each (3, 3); None when it does not.
        edge: The right eye in the left one's frame.
    """

    name: str
    pair: StereoPair
    levels: tuple[Array, Array] | None
    edge: FixedEdge

    @property
    def view_pair(self) -> StereoPair:
        """Both eyes, at the size of the stream's views (§5.2)."""
        left, right = eyes_of(self.name)
        return StereoPair(
            left=self.pair.left.scaled(*left.size_px),
            right=self.pair.right.scaled(*right.size_px),
            right_T_left=self.pair.right_T_left,
        )

    def rectification(self, field_of_view_rad: float) -> Rectification:
        """Return how the stream's views of this camera are levelled: by the file's own turns where it brings them.

        Args:
            field_of_view_rad: Across the width afterwards [rad].

        Raises:
            ValueRefused: No such field of view.
        """
        if self.levels is None:
            return turned_level(self.view_pair, field_of_view_rad)
        return rectified_by(self.view_pair, *self.levels, field_of_view_rad)

    def level_tables(self, field_of_view_rad: float) -> dict[str, RemapTable]:
        """Return, for both views of this camera, the table that straightens and levels it (`RemapTable.apply`).

        Args:
            field_of_view_rad: Across the width afterwards [rad].

        Raises:
            ValueRefused: No such field of view.
        """
        tables = straightenings(self.view_pair, self.rectification(field_of_view_rad))
        return {eye.view: table for eye, table in zip(eyes_of(self.name), tables, strict=True)}


def camera_of(name: str, row: Mapping[str, Any], conventions: Conventions) -> CameraCalibration:
    """Return what a section says.

    Raises:
        ValueRefused: A key is missing or unknown, a number cannot be meant, the eyes are in the wrong order. The message
            names the camera.
    """
    try:
        return _camera(name, row, conventions)
    except ValueRefused as error:
        raise ValueRefused(f"cameras.{name}: {error}") from None


def _camera(name: str, row: Mapping[str, Any], conventions: Conventions) -> CameraCalibration:
    for key in row:
        if key not in (*NEEDED, *OPTIONAL):
            raise ValueRefused(f"{key} is not known: there are {', '.join((*NEEDED, *OPTIONAL))}")
    for key in NEEDED:
        if key not in row:
            raise ValueRefused(f"{key} is missing")
    if not conventions.stereo_extrinsics:
        raise ValueRefused("conventions.stereo_extrinsics is missing: say right_T_left or left_T_right (manual A.1)")
    left, right = eyes_of(name)
    right_T_left = _extrinsics(row, conventions, left, right)
    pair = StereoPair(left=_lens(row, "L", left), right=_lens(row, "R", right), right_T_left=right_T_left)
    levels = None
    if "RRawL_Row" in row or "RRawR_Row" in row:
        if "RRawL_Row" not in row or "RRawR_Row" not in row:
            raise ValueRefused("RRawL_Row and RRawR_Row come together (§5.5)")
        levels = (numbers(row["RRawL_Row"], (3, 3)), numbers(row["RRawR_Row"], (3, 3)))  # rows, as their names say
        rectified_by(pair, *levels)
    edge = FixedEdge(
        transform=right_T_left.inverse,
        origin=Origin.STEREO_CALIBRATION,
        is_of_one_robot=True,
        note="R | T of the pair (§5.5)",
    )
    return CameraCalibration(name=name, pair=pair, levels=levels, edge=edge)


def _extrinsics(row: Mapping[str, Any], conventions: Conventions, left: Eye, right: Eye) -> Transform:
    matrix = np.eye(4)
    matrix[:3, :3] = conventions.square(row["R"], 3)
    matrix[:3, 3] = conventions.vector_m(row["T"])
    rigid, off = nearest_rigid(matrix)
    if off > RIGID_TOLERANCE:
        raise ValueRefused(f"R is {off:.1e} from orthonormal, up to {RIGID_TOLERANCE:.0e} is allowed")
    if conventions.stereo_extrinsics == "left_T_right":
        return Transform(left.frame, right.frame, rigid).inverse
    return Transform(right.frame, left.frame, rigid)


def _lens(row: Mapping[str, Any], letter: str, eye: Eye) -> Lens:
    width, height = row["width"], row["height"]
    if type(width) is not int or type(height) is not int:
        raise ValueRefused(f"width and height are whole numbers [px], not {width!r} and {height!r}")
    fx, fy, cx, cy = numbers(row[f"K{letter}"], (4,)).tolist()
    try:
        intrinsics = Intrinsics(fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy, width_px=width, height_px=height)
        intrinsics.scaled(*eye.size_px)
    except ValueRefused as error:
        raise ValueRefused(f"K{letter}: {error}") from None
    if row["model"] == "pinhole":
        if f"D{letter}" in row:
            raise ValueRefused(f"a pinhole has no distortion: D{letter} does not belong there")
        return Pinhole(intrinsics)
    if row["model"] != "opencv_fisheye":
        raise ValueRefused(f"model {row['model']!r} is not known: there are {', '.join(MODELS)} (§5.5)")
    if f"D{letter}" not in row:
        raise ValueRefused(f"D{letter} is missing: k1, k2, k3, k4 of OpenCV's fisheye model (§5.5)")
    return Fisheye(intrinsics, tuple(numbers(row[f"D{letter}"], (4,)).tolist()))
