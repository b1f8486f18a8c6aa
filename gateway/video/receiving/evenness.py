"""Whether a sender cuts its NAL units into fragments of one size, the last one but: then another size is damage.

Nothing in a packet says how long it should be, and decoders do not notice that the end of one is missing. Senders fill
all fragments but the last up to one size, as far as is known (assumed for the robot's): what is shorter was cut short.
Senders that do not are recognised by their first pictures, and nothing is said of later ones. Most fill them all up to
the same size, whatever the NAL unit: then the first one of only two can be judged, too. Pure: sizes in, a judgement out.

Not seen: a last fragment, or a NAL unit in a packet of its own, that is cut short. Nothing in it says so, and FFmpeg's
decoder takes what is missing for zeros: of 1600 pictures cut on purpose it refused or flagged none. No network does that,
since UDP refuses a datagram that is shorter than its header says (RFC 768); only a sender could.
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
        self._full = 0  # size that all fragments but the last one have; 0: not known
        self._filling = 0  # how sure that is, as `_score`
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
        return is_last and self._is_first_of_two_cut_short()

    def _is_first_of_two_cut_short(self) -> bool:
        """Take in that a NAL unit has ended, its fragments even; return whether it has two, and the first is too short."""
        is_telling = self._count > 2
        if is_telling:
            self._score = min(MOST, self._score + 1)
        if self._first == self._full:
            self._filling = min(MOST, self._filling + 1)
            return False
        is_known = self._filling >= ENOUGH
        self._filling = max(0, self._filling - 1)
        if is_telling and not self._filling:
            self._filling = 1 if self._full else START
            self._full = self._first
        return is_known and not is_telling and self._first < self._full

    def repeat(self, count: int) -> None:
        """Take so many fragments more of the size of the newest one, none of them the last one."""
        self._count += count
