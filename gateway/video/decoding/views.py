"""The six views in the robot's composite picture, by the names and boxes of the manual (§5.2, §6.9).

In the composite the head's right eye comes first, and the right wrist before the left one. `head_camera` is the whole
composite here, as in the manual's receiver; policies and datasets call the head's view by that name.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["BOXES", "COMPOSITE", "COMPOSITE_SHAPE", "HALVES", "VIEWS", "pixel_box", "view_of"]

Picture = npt.NDArray[np.uint8]

COMPOSITE: Final = "head_camera"
"""Name of the whole composite (§5.2)."""
COMPOSITE_SHAPE: Final = (2720, 1280, 3)
"""Rows, columns, channels of the composite (§5.2)."""
BOXES: Final[Mapping[str, tuple[float, float, float, float]]] = MappingProxyType(
    {
        "head_right_eye": (0.1250, 0.0000, 0.8750, 0.3529411765),
        "head_left_eye": (0.1250, 0.3529411765, 0.8750, 0.7058823529),
        "right_wrist_left_eye": (0.0000, 0.7058823529, 0.5000, 0.8529411765),
        "right_wrist_right_eye": (0.5000, 0.7058823529, 1.0000, 0.8529411765),
        "left_wrist_left_eye": (0.0000, 0.8529411765, 0.5000, 1.0000),
        "left_wrist_right_eye": (0.5000, 0.8529411765, 1.0000, 1.0000),
    }
)
"""Each view's box as parts of width and height: x0, y0, x1, y1 (§6.9)."""
HALVES: Final = {"left": (0.0, 0.0, 0.5, 1.0), "right": (0.5, 0.0, 1.0, 1.0)}
"""Both eyes of a camera in a picture of that camera alone, as the robot's own recorder has it (§5.4)."""
VIEWS: Final = tuple(BOXES)
"""Names of the six views, in the manual's order."""


def pixel_box(name: str, width: int, height: int) -> tuple[int, int, int, int]:
    """Return a view's box in pixels: x0, y0, x1, y1, the last two exclusive.

    Args:
        name: Of a view, or of the composite.
        width: Of the composite [pixels].
        height: Of the composite [pixels].

    Raises:
        KeyError: If there is no such view; the message names those that there are.
    """
    if name == COMPOSITE:
        return 0, 0, width, height
    if name not in BOXES and name not in HALVES:
        raise KeyError(f"no view {name!r}: there are {', '.join((COMPOSITE, *VIEWS))} (§5.2)")
    x0, y0, x1, y1 = BOXES[name] if name in BOXES else HALVES[name]
    return round(x0 * width), round(y0 * height), round(x1 * width), round(y1 * height)


def view_of(composite: Picture, name: str) -> Picture:
    """Return a view of the composite, without copying (shape (h, w, 3)).

    Args:
        composite: The whole picture, shape (height, width, 3).
        name: Of a view, or of the composite.

    Raises:
        KeyError: If there is no such view.
    """
    height, width = composite.shape[:2]
    x0, y0, x1, y1 = pixel_box(name, width, height)
    return composite[y0:y1, x0:x1]
