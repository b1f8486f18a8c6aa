"""Whether a sender cuts its NAL units into fragments of one size, the last one but: then another size is damage.

Nothing in a packet says how long it should be, and decoders do not notice that the end of one is missing. Senders fill
all fragments but the last up to one size, as far as is known (assumed for the robot's): what is shorter was cut short.
Senders that do not are recognised by their first pictures, and nothing is said of later ones. Pure: sizes in, a judgement
out.

Not seen: a last fragment, or a NAL unit in a packet of its own, that is cut short.
"""

from __future__ import annotations

from typing import Final

__all__ = ["Evenness"]

ENOUGH: Final = 2
"""NAL units of even fragments, less those of uneven ones, from which on a sender is taken for even."""
START: Final = 4
"""At the beginning it is: an uneven one has its first group of pictures called damaged, at worst."""
MOST: Final = 8
"""So many count at most, either way: habits are believed soon, and changes of them seen soon."""

ROUNDING: Final = 1
"""Later fragments may be shorter by so many bytes: some senders spread a NAL unit's bytes over them evenly."""


class Evenness:
    """Of one sender's fragments."""

    def __init__(self) -> None:
        self._score = START
        self._first = self._size = 0
        self._count = 0
        self._is_uneven = False

    def begin(self, size: int) -> None:
        """Take the first fragment of a NAL unit.

        Args:
            size: Of its payload [bytes].
        """
        self._first, self._size, self._count, self._is_uneven = size, size, 1, False

    def is_cut_short(self, size: int, *, is_last: bool) -> bool:
        """Take the next fragment; return whether it, or the first one, was cut short.

        Args:
            size: Of its payload [bytes].
            is_last: Whether it is the last one, which may be shorter.
        """
        if self._is_uneven:
            return False
        self._count += 1
        is_known = self._score >= ENOUGH
        before, self._size = self._size, size
        if size > before or (size < self._first - ROUNDING and not is_last):
            self._is_uneven = True
            self._score = max(-MOST, self._score - 1)
            return is_known
        if is_last and self._count > 2:
            self._score = min(MOST, self._score + 1)
        return False

    def repeat(self, count: int) -> None:
        """Take so many fragments more of the size of the newest one, none of them the last one."""
        self._count += count
