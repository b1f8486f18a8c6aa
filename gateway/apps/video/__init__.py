"""Moved: `gateway.video` is the library of the robot's cameras. This place goes with the next release."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import gateway.video

if TYPE_CHECKING:
    from gateway.video import Video

__all__ = ["Video"]

warnings.warn("gateway.apps.video has moved to gateway.video", DeprecationWarning, stacklevel=2)


def __getattr__(name: str) -> object:
    """Give what is asked for from its new place."""
    return getattr(gateway.video, name)
