"""All six views of a frame in one picture, each under its name: for a window, and for a file where there is none.

The robot's left is left here; in the composite the right ones come first (§5.2).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gateway.video.decoding.frame import Frame
from gateway.video.decoding.views import BOXES, pixel_box
from gateway.video.errors import VideoCode, VideoError

__all__ = ["ROWS", "Sheet", "write_sheet"]

Picture = npt.NDArray[np.uint8]

ROWS = (
    ("head_left_eye", "head_right_eye"),
    ("left_wrist_left_eye", "left_wrist_right_eye"),
    ("right_wrist_left_eye", "right_wrist_right_eye"),
)
"""What stands beside each other, from top to bottom."""
QUALITY = 92
"""Of a JPEG, up to 95."""
INK, GROUND, ALARM = (235, 235, 235), (24, 24, 24), (220, 40, 40)


class Sheet:
    """Composes sheets for composites of one size.

    Args:
        width: Of the composite [pixels].
        height: Of the composite [pixels].
        step: Every so many-th pixel is taken, in both directions.

    Raises:
        VideoError: NOT_INSTALLED, without Pillow.
    """

    def __init__(self, width: int, height: int, step: int = 1) -> None:
        self.size = width, height
        self._step = step
        self._line = max(12, width // 40 // step)  # height of a line of text [pixels]
        boxes = {name: pixel_box(name, width, height) for name in BOXES}
        shapes = {name: (-(-(y1 - y0) // step), -(-(x1 - x0) // step)) for name, (x0, y0, x1, y1) in boxes.items()}
        column = max(shape[1] for shape in shapes.values())
        gap = self._line // 2
        self._places: dict[str, tuple[int, int]] = {}
        top = 2 * self._line
        for row in ROWS:
            for number, name in enumerate(row):
                self._places[name] = top + 2 * self._line, gap + number * (column + gap)
            top += 2 * self._line + max(shapes[name][0] for name in row) + gap
        self._ground = np.empty((top, 2 * column + 3 * gap, 3), np.uint8)
        self._ground[:] = GROUND
        for name, (y, x) in self._places.items():
            x0, y0, x1, y1 = boxes[name]
            self._write(self._ground, f"{name}  {y1 - y0} x {x1 - x0}", x, y - 2 * self._line, INK)

    def compose(self, frame: Frame, title: str = "") -> Picture:
        """Return the sheet of a frame, RGB, uint8; a damaged frame has a red edge."""
        sheet = self._ground.copy()
        step = self._step
        for name, (y, x) in self._places.items():
            view = frame[name][::step, ::step]
            sheet[y : y + view.shape[0], x : x + view.shape[1]] = view
        if not frame.clean:
            for edge in (sheet[:4], sheet[-4:], sheet[:, :4], sheet[:, -4:]):
                edge[:] = ALARM
        if title:
            self._write(sheet, title, self._line // 2, 0, INK if frame.clean else ALARM)
        return sheet

    def _write(self, picture: Picture, text: str, x: int, y: int, colour: tuple[int, int, int]) -> None:
        """Write a line of text into two lines' height."""
        image, draw, font = _pillow()
        strip = image.fromarray(picture[y : y + 2 * self._line])
        draw.Draw(strip).text((x, self._line // 3), text, font=font.load_default(self._line), fill=colour)
        picture[y : y + 2 * self._line] = np.asarray(strip)


def write_sheet(frame: Frame, path: Path, title: str = "") -> None:
    """Write the sheet of a frame, in full size, as a JPEG file.

    Raises:
        VideoError: NOT_INSTALLED, without Pillow; CANNOT_WRITE.
    """
    height, width = frame.rgb.shape[:2]
    picture = Sheet(width, height).compose(frame, title)
    image, _, _ = _pillow()
    try:
        image.fromarray(picture).save(path, format="JPEG", quality=QUALITY)
    except OSError as error:
        raise VideoError(
            VideoCode.CANNOT_WRITE,
            f"{path} cannot be written: {error}",
            "name a file in a folder that can be written to",
        ) from None


def _pillow() -> tuple[Any, Any, Any]:
    try:
        from PIL import Image, ImageDraw, ImageFont
    except ImportError as error:
        raise VideoError(
            VideoCode.NOT_INSTALLED,
            f"a sheet of pictures needs Pillow, which cannot be loaded: {error}",
            "install it: pip install 'teleavatar-gateway[video]'",
        ) from None
    return Image, ImageDraw, ImageFont
