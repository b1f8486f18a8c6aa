"""MJCF elements: numbers as text, frames as positions and quaternions, and which parts may touch which."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import Final
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from gateway.sim.physics.body_numbers import quat_wxyz

__all__ = ["TOUCH", "Element", "Touch", "add", "placed"]

Array = NDArray[np.float64]
Element = ElementTree.Element


class Touch(Enum):
    """What a shape belongs to."""

    NOTHING = "is only seen"
    THING = "floor, table and things"
    TRUNK = "base, column, torso and head"
    LEFT_UPPER = "left arm next to its shoulder"
    RIGHT_UPPER = "right arm next to its shoulder"
    LEFT = "left forearm and hand"
    RIGHT = "right forearm and hand"


_THING, _TRUNK, _LEFT, _RIGHT = 1, 2, 4, 8
TOUCH: Final = {
    Touch.NOTHING: (0, 0),
    Touch.THING: (_THING, _THING | _TRUNK | _LEFT | _RIGHT),
    Touch.TRUNK: (_TRUNK, 0),
    Touch.LEFT_UPPER: (_LEFT, 0),
    Touch.RIGHT_UPPER: (_RIGHT, _LEFT),
    Touch.LEFT: (_LEFT, _TRUNK),
    Touch.RIGHT: (_RIGHT, _TRUNK | _LEFT),
}
"""MuJoCo's contype and conaffinity: two shapes touch when one's type is in the other's affinity. Parts of one arm never
touch each other, nor does an upper arm the trunk: their hulls overlap at the joints."""


def add(parent: Element, tag: str, **attributes: str | float | Sequence[float]) -> Element:
    """Add an element below another and return it.

    Texts are taken as they are, numbers in full precision; a trailing `_` of a name is dropped.
    """
    texts = {name.rstrip("_"): value if isinstance(value, str) else _text(value) for name, value in attributes.items()}
    return ElementTree.SubElement(parent, tag, texts)


def _text(value: float | Sequence[float]) -> str:
    return " ".join(f"{number:.17g}" for number in np.atleast_1d(np.asarray(value, dtype=np.float64)))


def placed(parent_T_child: Array) -> dict[str, Sequence[float]]:
    """Return the attributes that put an element at a transform, shape (4, 4)."""
    return {"pos": parent_T_child[:3, 3].tolist(), "quat": quat_wxyz(parent_T_child)}
