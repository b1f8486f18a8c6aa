"""From a decoded picture to RGB: one conversion, when somebody looks, no copy after it, and nobody can write into it.

A stream may say by which matrix its colours were made (H.265, E.2.1). Where it does not, nobody can know: FFmpeg, and with
it most tools for datasets, then takes BT.601, GStreamer takes BT.2020 for a picture of more than 2160 rows. It is an
argument here.
"""

from __future__ import annotations

import threading
from typing import Literal, cast

import numpy as np
import numpy.typing as npt

from gateway.video.decoding.libav import VideoReformatter, av

__all__ = ["MATRICES", "LazyRgb", "Matrix", "RgbConverter", "rows_of"]

Matrix = Literal["bt601", "bt709", "bt2020"]
MATRICES: dict[Matrix, int] = {"bt601": 5, "bt709": 1, "bt2020": 9}
"""Numbers of libswscale."""
NAMED = {1: 1, 4: 4, 5: 5, 6: 5, 7: 7, 9: 9, 10: 9}
"""matrix_coeffs of a stream (H.265, Table E.5) -> number of libswscale, where that knows it."""
UNSPECIFIED = 2
FULL_RANGE = 2
IS_OLD = int(av.__version__.partition(".")[0]) < 17
"""PyAV 16 takes a matrix only as an argument, and not if the picture bears it; PyAV 17 some only from the picture."""
CHANNELS = 3


class RgbConverter:
    """Converts pictures of one stream; keeps the tables of the conversion from picture to picture. For any thread.

    Args:
        matrix: For pictures that do not say theirs.
    """

    def __init__(self, matrix: Matrix = "bt601") -> None:
        self._matrix = MATRICES[matrix]
        self._reformatter = VideoReformatter()
        self._separator = VideoReformatter()
        self.guard = threading.RLock()
        """Held while it converts: the tables are for one picture at a time."""

    def convert(self, picture: av.VideoFrame) -> npt.NDArray[np.uint8]:
        """Return it as RGB of the full range, shape (height, width, 3), not writable; its memory is its own."""
        picture = self._planar(picture)
        matrix = NAMED.get(picture.colorspace, self._matrix)
        picture.colorspace = UNSPECIFIED if IS_OLD else matrix
        colour_range = FULL_RANGE if picture.color_range == FULL_RANGE else None
        with self.guard:
            rgb = self._reformatter.reformat(
                picture, format="rgb24", src_colorspace=matrix, src_color_range=colour_range
            )
        return rows_of(rgb)[:, : rgb.width * CHANNELS].reshape(rgb.height, rgb.width, CHANNELS)

    def _planar(self, picture: av.VideoFrame) -> av.VideoFrame:
        """Return a picture of a GPU with its two planes of colour apart, as software decodes it.

        Straight to RGB it would take another way through swscale, which costs eight times as much and makes other colours
        at edges (by up to 35 of 255).
        """
        if picture.format.name != "nv12":
            return picture
        with self.guard:
            planar = self._separator.reformat(picture, format="yuv420p")
        planar.colorspace, planar.color_range = picture.colorspace, picture.color_range
        return planar


class LazyRgb:
    """A picture that is converted when it is first asked for, by whoever asks: most are never looked at.

    Args:
        converter: To RGB.
        picture: As it was decoded; let go once it is converted.
    """

    def __init__(self, converter: RgbConverter, picture: av.VideoFrame) -> None:
        self._converter = converter
        self._picture: av.VideoFrame | None = picture
        self._rgb: npt.NDArray[np.uint8] | None = None

    def array(self) -> npt.NDArray[np.uint8]:
        """Return it as RGB of the full range, shape (height, width, 3), not writable; the same one each time."""
        if (rgb := self._rgb) is not None:
            return rgb
        with self._converter.guard:
            if self._rgb is None:  # nobody else asked meanwhile
                assert self._picture is not None
                self._rgb, self._picture = self._converter.convert(self._picture), None
            return self._rgb


def rows_of(picture: av.VideoFrame) -> npt.NDArray[np.uint8]:
    """Return the bytes of a picture's first plane, shape (height, bytes of a line), padding included; not writable."""
    plane = picture.planes[0]
    # NumPy would make a writable array of it, which any reader could turn back after it was forbidden.
    memory = memoryview(cast("bytes", plane)).toreadonly()
    rows = np.frombuffer(memory, np.uint8).reshape(-1, plane.line_size)
    return rows[: picture.height]
