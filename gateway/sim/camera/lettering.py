"""Words in pixels: so that a person sees which crop of a test pattern is which."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["lettering"]

_GLYPHS: Final = {
    " ": "00000 00000 00000 00000 00000 00000 00000",
    "A": "01110 10001 10001 11111 10001 10001 10001",
    "D": "11110 10001 10001 10001 10001 10001 11110",
    "E": "11111 10000 10000 11110 10000 10000 11111",
    "F": "11111 10000 10000 11110 10000 10000 10000",
    "G": "01110 10001 10000 10111 10001 10001 01111",
    "H": "10001 10001 10001 11111 10001 10001 10001",
    "I": "01110 00100 00100 00100 00100 00100 01110",
    "L": "10000 10000 10000 10000 10000 10000 11111",
    "R": "11110 10001 10001 11110 10100 10010 10001",
    "S": "01111 10000 10000 01110 00001 00001 11110",
    "T": "11111 00100 00100 00100 00100 00100 00100",
    "W": "10001 10001 10001 10101 10101 11011 10001",
    "Y": "10001 10001 01010 00100 00100 00100 00100",
}
"""Seven rows of five pixels each: the letters in the names of the crops."""


def lettering(text: str, scale: int) -> npt.NDArray[np.bool_]:
    """Return where the ink is in a line of text, shape (7 * scale, 6 * scale * letters).

    Args:
        text: Of letters that occur in names of crops, and spaces.
        scale: Side of a dot [pixels].

    Raises:
        ValueError: If there is no glyph for a letter.
    """
    unknown = set(text) - set(_GLYPHS)
    if unknown:
        raise ValueError(f"no glyph for {', '.join(sorted(unknown))}: there are {''.join(_GLYPHS)}")
    rows = [[[mark == "1" for mark in f"{row}0"] for row in _GLYPHS[letter].split()] for letter in text]
    dots = np.concatenate([np.array(glyph, bool) for glyph in rows], axis=1)
    return dots.repeat(scale, axis=0).repeat(scale, axis=1)
