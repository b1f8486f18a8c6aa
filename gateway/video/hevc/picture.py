"""One picture while its packets come: its NAL units so far, what is known of them, and what is wrong with it."""

from __future__ import annotations

from typing import Final, TypeAlias

from gateway.video.hevc.nal import (
    PARAMETER_SETS,
    START_CODE,
    NalType,
    annex_b,
    begins_picture,
    is_irap,
    is_slice,
    nal_type,
    recovery_point,
)
from gateway.video.hevc.parameter_sets import ParameterSets

__all__ = ["MAX_PICTURE_BYTES", "Picture", "Ranges", "joined"]

MAX_PICTURE_BYTES: Final = 8 << 20
"""Longer than any coded picture: as NV12, without any compression, the composite has 5.2 MB."""
OVERHEAD_BYTES: Final = 100
"""What a part costs beyond its bytes: tiny ones must not fill the memory either."""
MAX_RANGES: Final = 64

Ranges: TypeAlias = list[tuple[int, int]]


class Picture:
    """The picture of one RTP time.

    Args:
        rtp_time: Unwrapped [ticks].
        is_begun: Whether the packet before its first one was the last of another picture.

    Attributes:
        lost: Ranges of packets that were lost before it or in it.
        first_ns: When the first of its packets arrived [ns].
        slice_type: NAL unit type of its first slice; None before there is one.
        is_headless: Whether its slices do not begin with the first one.
        is_broken: Whether something of it is known to be missing or wrong.
        recovers_after: See `AccessUnit`.
        awaits: What every further fragment of the unfinished NAL unit begins with, but for the flag of the last one: payload
            header, FU header; empty when no NAL unit is unfinished.
    """

    def __init__(self, rtp_time: int, *, is_begun: bool) -> None:
        self.rtp_time = rtp_time
        self.lost: Ranges = []
        self.first_ns: int | None = None
        self.slice_type: int | None = None
        self.is_headless = False
        self.is_broken = False
        self.recovers_after: int | None = None
        self._is_begun = is_begun
        self._parts: list[bytes] = []
        self._size = 0
        self._kinds: set[int] = set()
        self._is_cut = False
        self.awaits = b""
        self._fragment = 0  # where the unfinished NAL unit begins in the parts

    @property
    def is_full(self) -> bool:
        """Whether it is larger than any picture."""
        return self._size > MAX_PICTURE_BYTES

    def is_intact(self) -> bool:
        """Return whether all of its packets came, as far as can be told: then its first slice is there, too."""
        return self._is_begun and not (self.is_broken or self.is_headless)

    def is_irap(self) -> bool:
        """Return whether decoding can begin with it."""
        return self.slice_type is not None and is_irap(self.slice_type)

    def lose(self, gap: Ranges) -> None:
        """Take note of packets lost in it."""
        self.lost = joined(self.lost, gap)
        self.break_off()

    def cut(self) -> bool:
        """Take note of a packet that is left out since it is full; return whether it is the first."""
        is_first, self._is_cut = not self._is_cut, True
        self.break_off()
        return is_first

    def arrive(self, at_ns: int) -> None:
        """Take note of when a packet of it came [ns]."""
        if self.first_ns is None or at_ns < self.first_ns:
            self.first_ns = at_ns

    def add(self, nal: bytes, *, sees_delimiters: bool) -> None:
        """Add a NAL unit, or the first fragment of one.

        Args:
            nal: From its header on.
            sees_delimiters: Whether this sender's pictures begin with an access unit delimiter.
        """
        kind = nal_type(nal)
        if not self._parts and not self._is_begun:
            # Nothing that matters can come before a delimiter, nor before a VPS but a delimiter (H.265 7.4.2.4.4).
            self._is_begun = kind == NalType.AUD or (kind == NalType.VPS and not sees_delimiters)
        if is_slice(kind) and self.slice_type is None:
            self.slice_type = kind
            self.is_headless = not begins_picture(nal)
        elif kind == NalType.PREFIX_SEI and self.recovers_after is None:
            self.recovers_after = recovery_point(nal)
        self._kinds.add(kind)
        self._append(START_CODE, nal)

    def begin_fragments(self, nal: bytes, awaits: bytes, *, sees_delimiters: bool) -> None:
        """Add the first fragment of a NAL unit, its header put before it.

        Args:
            nal: The NAL unit so far.
            awaits: See the attribute.
            sees_delimiters: See `add`.
        """
        self.awaits = awaits
        self._fragment = len(self._parts) + 1
        self.add(nal, sees_delimiters=sees_delimiters)

    def add_fragments(self, *payloads: bytes) -> None:
        """Add to the unfinished NAL unit."""
        self._append(*payloads)

    def end_fragments(self) -> bytes:
        """Finish the NAL unit and return it."""
        nal = b"".join(self._parts[self._fragment :])
        self.awaits = b""
        return nal

    def break_off(self) -> None:
        """Leave the unfinished NAL unit as it is: what came of it can still be decoded, and shown as damaged."""
        self.awaits = b""
        self.is_broken = True

    def coded(self, sets: ParameterSets) -> tuple[bytes, bool, bool]:
        """Return it in Annex B form, whether parameter sets of all kinds are in it, and whether some were put there."""
        added: list[bytes] = []
        kinds = self._kinds
        if (self.is_irap() or self.recovers_after is not None) and not kinds >= PARAMETER_SETS and sets.is_complete:
            added = sets.all_but(kinds)
            kinds = kinds | PARAMETER_SETS
        at = 2 if added and nal_type(self._parts[1]) == NalType.AUD else 0
        data = b"".join((*self._parts[:at], annex_b(added), *self._parts[at:]))
        return data, kinds >= PARAMETER_SETS, bool(added)

    def _append(self, *parts: bytes) -> None:
        self._parts += parts
        self._size += sum(map(len, parts)) + len(parts) * OVERHEAD_BYTES


def joined(ranges: Ranges, more: Ranges) -> Ranges:
    """Return ranges of packets one after the other; where they become too many, the last ones as one."""
    both = ranges + more
    return both if len(both) <= MAX_RANGES else [*both[: MAX_RANGES - 1], (both[MAX_RANGES - 1][0], both[-1][1])]
