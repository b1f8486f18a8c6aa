"""Remembers the stream's parameter sets, so that decoding can begin where the sender does not repeat them.

One NAL unit is kept for each kind and id (H.265 section 7.4.2.4): at most 16 VPS, 16 SPS and 64 PPS of 4 kB each.
"""

from __future__ import annotations

from collections.abc import Set
from typing import Final

from gateway.video.hevc.bits import BitReader, BitsEnded
from gateway.video.hevc.nal import HEADER_BYTES, PARAMETER_SETS, NalType, nal_type

__all__ = ["ParameterSets"]

MAX_BYTES: Final = 4096
"""No longer one is kept [bytes]; the robot's encoder should need some hundred at most (assumed)."""
MAX_IDS: Final = {NalType.VPS: 16, NalType.SPS: 16, NalType.PPS: 64}
GENERAL_PROFILE_BITS: Final = 88
LEVEL_BITS: Final = 8


class ParameterSets:
    """Those of one sender."""

    def __init__(self) -> None:
        self._nals: dict[tuple[int, int], bytes] = {}

    @property
    def is_complete(self) -> bool:
        """Whether one of each kind is there."""
        return {kind for kind, _ in self._nals} == PARAMETER_SETS

    def keep(self, nal: bytes) -> bool:
        """Remember a VPS, SPS or PPS in place of an earlier one with its id; return whether it could be read."""
        kind = nal_type(nal)
        if len(nal) > MAX_BYTES:
            return False
        try:
            number = _id_of(kind, BitReader(nal[HEADER_BYTES:]))
        except BitsEnded:
            return False
        if number >= MAX_IDS[NalType(kind)]:
            return False
        self._nals[kind, number] = nal
        return True

    def all_but(self, kinds: Set[int]) -> list[bytes]:
        """Return those of the kinds not given, in the order in which a decoder wants them."""
        return [nal for (kind, _), nal in sorted(self._nals.items()) if kind not in kinds]


def _id_of(kind: int, reader: BitReader) -> int:
    """Return a parameter set's id (H.265 section 7.3.2.1 to 7.3.2.3)."""
    if kind == NalType.VPS:
        return reader.read(4)
    if kind == NalType.SPS:
        reader.read(4)  # of its VPS
        layers = reader.read(3)
        reader.read(1)
        _skip_profile(reader, layers)
    return reader.unsigned()


def _skip_profile(reader: BitReader, layers: int) -> None:
    """Pass over profile, tier and level (H.265 section 7.3.3)."""
    reader.read(GENERAL_PROFILE_BITS + LEVEL_BITS)
    flags = [(reader.read(1), reader.read(1)) for _ in range(layers)]
    if layers:
        reader.read(2 * (8 - layers))
    for has_profile, has_level in flags:
        reader.read(has_profile * GENERAL_PROFILE_BITS + has_level * LEVEL_BITS)
