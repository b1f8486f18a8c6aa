"""A frame counter written into pixels, so that a receiver's test knows which picture it has, and whether it is damaged.

Every crop has its own code, 32 cells that are black or white: 24 bits of counter, then a CRC-8 of them, most significant
bit first. Crops that disagree come from different pictures; a wrong CRC is visible damage. In full-size crops it is a
row of cells of 16 x 16 pixels, 16 pixels in from the top left corner; in small ones four rows of cells of 8 x 8 pixels,
8 pixels in.

The counter is that of the cameras' trigger, so it tells the time at which a picture was taken, in periods. When it was
handed to the network stands in a table (`handover`): the pixels of a loop that was encoded before cannot know that.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from gateway.sim.camera.composite import CROPS, Size, crop_box

__all__ = ["COUNTERS", "Layout", "crc8", "layout_of", "read_code", "read_codes", "read_composite", "write_code"]

COUNTERS: Final = 1 << 24
"""So many counters there are; the next one is 0 again."""

_BITS: Final = 32
_BLACK, _WHITE, _THRESHOLD = 16, 235, 125  # luma of limited range; of full range the threshold holds as well
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


def read_code(crop: npt.NDArray[Any]) -> int | None:
    """Return the counter in a crop, or None when its CRC is wrong.

    Args:
        crop: Luma, shape (height, width), or RGB, shape (height, width, 3).

    Raises:
        ValueError: If a crop of this size cannot have a code.
    """
    height, width = crop.shape[:2]
    layout = layout_of(width, height)
    x0, y0, x1, y1 = layout.box
    grey = crop[y0:y1, x0:x1] if crop.ndim == 2 else crop[y0:y1, x0:x1, 1]
    cells = grey.reshape(-1, layout.cell, layout.columns, layout.cell)
    middle = slice(layout.cell // 2 - 2, layout.cell // 2 + 2)
    bits = cells[:, middle, :, middle].mean(axis=(1, 3)) > _THRESHOLD
    word = int(np.packbits(bits.reshape(-1)).view(">u4")[0])
    counter = word >> 8
    return counter if crc8(counter) == word & 0xFF else None


def read_codes(composite: npt.NDArray[Any]) -> Mapping[str, int | None]:
    """Return the counter of every crop by name, None for a damaged one.

    Args:
        composite: Luma, shape (height, width), or RGB, shape (height, width, 3).

    Raises:
        ValueError: If it cannot be cut, or crops of its size cannot have a code.
    """
    size = Size(composite.shape[1], composite.shape[0]).checked()
    boxes = {name: crop_box(size, name) for name in CROPS}
    return {name: read_code(composite[y0:y1, x0:x1]) for name, (x0, y0, x1, y1) in boxes.items()}


def read_composite(composite: npt.NDArray[Any]) -> int | None:
    """Return the counter of a composite, or None when a crop is damaged or crops are of different pictures.

    Raises:
        ValueError: If it cannot be cut, or crops of its size cannot have a code.
    """
    counters = set(read_codes(composite).values())
    return counters.pop() if len(counters) == 1 else None
