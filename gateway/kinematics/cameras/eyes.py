"""Eyes: the six views of the video (§5.2), each with its optical frame and the stereo camera that it belongs to.

The stream's views are the eyes' pictures halved. `head_camera` of the manual is the whole composite, no eye.
"""

from __future__ import annotations

import math
from typing import Final

from msgspec import Struct

from gateway.kinematics.cameras.lens import Fisheye, Intrinsics
from gateway.kinematics.description import Camera
from gateway.kinematics.frames import wrist_frame
from gateway.kinematics.nominal_frames import right_wrist_eye_frame
from gateway.values import Side

__all__ = ["CAMERAS", "EYES", "Eye", "eyes_of", "nominal_lens"]

HALVED: Final = 2
"""A view is its eye's picture in half the size."""


class Eye(Struct, frozen=True, kw_only=True):
    """One eye.

    Attributes:
        view: Name of its view (§5.2).
        camera: `head`, `left_wrist` or `right_wrist`.
        side: Which eye of the camera.
        frame: Its optical frame in the tree.
        box_px: Where the view is in the composite of 1280 × 2720: x0, y0, x1, y1, the last two exclusive (§6.9).
    """

    view: str
    camera: str
    side: Side
    frame: str
    box_px: tuple[int, int, int, int]

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the view [px]."""
        x0, y0, x1, y1 = self.box_px
        return x1 - x0, y1 - y0


def _eye(camera: str, side: Side, frame: str, box_px: tuple[int, int, int, int]) -> Eye:
    return Eye(view=f"{camera}_{side}_eye", camera=camera, side=side, frame=frame, box_px=box_px)


def _wrist(hand: Side, eye: Side, box_px: tuple[int, int, int, int]) -> Eye:
    return _eye(f"{hand}_wrist", eye, wrist_frame(hand) if eye is Side.LEFT else right_wrist_eye_frame(hand), box_px)


EYES: Final = {
    eye.view: eye
    for eye in (
        _eye("head", Side.RIGHT, "head_right_camera", (160, 0, 1120, 960)),
        _eye("head", Side.LEFT, "head_left_camera", (160, 960, 1120, 1920)),
        _wrist(Side.RIGHT, Side.LEFT, (0, 1920, 640, 2320)),
        _wrist(Side.RIGHT, Side.RIGHT, (640, 1920, 1280, 2320)),
        _wrist(Side.LEFT, Side.LEFT, (0, 2320, 640, 2720)),
        _wrist(Side.LEFT, Side.RIGHT, (640, 2320, 1280, 2720)),
    )
}
"""The six eyes by view, in the order of the composite."""

CAMERAS: Final = tuple(dict.fromkeys(eye.camera for eye in EYES.values()))
"""The three stereo cameras."""


def eyes_of(camera: str) -> tuple[Eye, Eye]:
    """Return left and right eye of a stereo camera.

    Raises:
        KeyError: There is no such camera.
    """
    try:
        return EYES[f"{camera}_left_eye"], EYES[f"{camera}_right_eye"]
    except KeyError:
        raise KeyError(f"no camera {camera!r}: there are {', '.join(CAMERAS)}") from None


def nominal_lens(camera: Camera) -> Fisheye:
    """Return a stand-in for the lens of one eye at the size of the view: equal angles per pixel over the field of view.

    The published fields of view give some 4 % less focal length than the one calibration that is known.
    """
    width, height = camera.sensor_px
    across, down = (math.radians(angle) for angle in camera.field_of_view_deg)
    full = Intrinsics(
        fx_px=width / across,
        fy_px=height / down,
        cx_px=0.5 * (width - 1),
        cy_px=0.5 * (height - 1),
        width_px=width,
        height_px=height,
    )
    return Fisheye(full).scaled(width // HALVED, height // HALVED)
