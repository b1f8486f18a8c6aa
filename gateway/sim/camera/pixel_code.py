"""A frame counter written into pixels, so that a receiver's test knows which picture it has, and whether it is damaged.

Every crop has its own code, 32 cells that are black or white: 24 bits of counter, then a CRC-8 of them, most significant
bit first. Crops that disagree come from different pictures; a wrong CRC is visible damage. In full-size crops it is a
row of cells of 16 x 16 pixels, 16 pixels in from the top left corner; in small ones four rows of cells of 8 x 8 pixels,
8 pixels in.

The counter is that of the cameras' trigger, so it tells the time at which a picture was taken, in periods. When it was
handed to the network stands in a table (`handover`): the pixels of a loop that was encoded before cannot know that.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["COUNTERS", "Layout", "crc8", "layout_of", "write_code"]

COUNTERS: Final = 1 << 24
"""So many counters there are; the next one is 0 again."""

_BITS: Final = 32
_BLACK, _WHITE = 16, 235  # luma of limited range
_POLYNOMIAL, _CRC_START = 0x31, 0xFF  # begun with ones: a picture all black must not read as counter 0


class Layout(NamedTuple):
    """Where the cells are in a crop.

    Attributes:
        cell: Side of a cell, and distance from the crop's top left corner [pixels].
        columns: Cells in a row.
    """

    cell: int
    columns: int

    @property
    def box(self) -> tuple[int, int, int, int]:
        """All cells together, in the crop: x0, y0, x1, y1, the last two exclusive [pixels]."""
        rows = _BITS // self.columns
        return self.cell, self.cell, self.cell * (1 + self.columns), self.cell * (1 + rows)


def layout_of(width: int, height: int) -> Layout:
    """Return where the code is in a crop of a size.

    Raises:
        ValueError: If there is no room for it.
    """
    for layout in (Layout(16, 32), Layout(8, 8)):
        _, _, right, bottom = layout.box
        if width >= right and height >= bottom:
            return layout
    raise ValueError(f"a crop of {width}x{height} pixels has no room for a code: it takes 72x40 pixels")


def crc8(counter: int) -> int:
    """Return the CRC-8 of a counter's three bytes (polynomial 0x31, begun with 0xFF)."""
    value = _CRC_START
    for byte in counter.to_bytes(3, "big"):
        value ^= byte
        for _ in range(8):
            value = (value << 1 ^ _POLYNOMIAL if value & 0x80 else value << 1) & 0xFF
    return value


def write_code(luma: npt.NDArray[np.uint8], counter: int) -> None:
    """Write a code into a crop.

    Args:
        luma: Of the crop, shape (height, width); written to.
        counter: The picture's, modulo COUNTERS.

    Raises:
        ValueError: If there is no room.
    """
    counter %= COUNTERS
    height, width = luma.shape
    layout = layout_of(width, height)
    x0, y0, x1, y1 = layout.box
    word = np.array([counter << 8 | crc8(counter)], ">u4").view(np.uint8)
    cells = np.unpackbits(word).reshape(-1, layout.columns) * np.uint8(_WHITE - _BLACK) + np.uint8(_BLACK)
    luma[y0:y1, x0:x1] = cells.repeat(layout.cell, axis=0).repeat(layout.cell, axis=1)
