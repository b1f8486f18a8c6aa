"""A frame's picture that is there already."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["Shown"]


class Shown:
    """An array as the source of a frame."""

    def __init__(self, rgb: npt.NDArray[np.uint8]) -> None:
        self._rgb = rgb

    def array(self) -> npt.NDArray[np.uint8]:
        """Return it."""
        return self._rgb
