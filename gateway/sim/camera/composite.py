"""Where the four capture channels and the six crops lie in the robot's composite picture (§3.1.2, §5.2, §6.9).

Each channel is as wide as the composite: head right eye, head left eye, right wrist, left wrist from top to bottom. A
wrist's channel has its two eyes side by side; of a head's channel only the middle three quarters are shown.
Composites of other sizes have the same proportions.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import Final, NamedTuple

__all__ = ["CHANNELS", "CROPS", "FULL", "Size", "channel_rows", "crop_box", "crops_of"]


class Size(NamedTuple):
    """Of a composite [pixels]."""

    width: int
    height: int

    def checked(self) -> Size:
        """Return it.

        Raises:
            ValueError: If crops would begin or end inside a pixel, or inside a pixel of the colour planes.
        """
        if self.width < 16 or self.width % 16 or self.height < 68 or self.height % 68:
            raise ValueError(
                f"a composite of {self.width}x{self.height} pixels cannot be cut: the width must be a multiple of 16, "
                "the height one of 68, e.g. 1280x2720 or 160x340"
            )
        return self


FULL: Final = Size(1280, 2720)
"""Of the real composite (§5.2)."""

CHANNELS: Final = ("head_right", "head_left", "right_wrist", "left_wrist")
"""The capture channels, from top to bottom."""

_ROWS: Final = ((0, 12), (12, 24), (24, 29), (29, 34))  # of each channel, in parts of 34 of the height

CROPS: Final = MappingProxyType(
    {
        "head_right_eye": (0, 1, 7),
        "head_left_eye": (1, 1, 7),
        "right_wrist_left_eye": (2, 0, 4),
        "right_wrist_right_eye": (2, 4, 8),
        "left_wrist_left_eye": (3, 0, 4),
        "left_wrist_right_eye": (3, 4, 8),
    }
)
"""Each crop's channel, first and last column in parts of 8 of the width."""


def channel_rows(size: Size, channel: int) -> tuple[int, int]:
    """Return a channel's first row and the one after its last."""
    first, last = _ROWS[channel]
    return size.height * first // 34, size.height * last // 34


def crop_box(size: Size, name: str) -> tuple[int, int, int, int]:
    """Return a crop's box in the composite: x0, y0, x1, y1, the last two exclusive [pixels].

    Raises:
        KeyError: If there is no such crop.
    """
    channel, left, right = CROPS[name]
    top, bottom = channel_rows(size, channel)
    return size.width * left // 8, top, size.width * right // 8, bottom


def crops_of(channel: int) -> tuple[str, ...]:
    """Return the names of the crops of a channel."""
    return tuple(name for name, place in CROPS.items() if place[0] == channel)
