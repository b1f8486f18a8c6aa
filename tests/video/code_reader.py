"""The frame counter that the simulated camera writes into pixels, read: which picture it is, and whether it is damaged."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from gateway.sim.camera.composite import CROPS, Size, crop_box
from gateway.sim.camera.pixel_code import crc8, layout_of

__all__ = ["read_code", "read_codes", "read_composite"]

THRESHOLD = 125
"""Luma between black and white, in limited range and in full range."""


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
    bits = cells[:, middle, :, middle].mean(axis=(1, 3)) > THRESHOLD
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
