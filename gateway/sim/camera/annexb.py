"""H.265 byte streams taken apart into NAL units, and put together again (H.265 annex B)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

__all__ = ["PARAMETER_SETS", "START_CODE", "is_irap", "joined", "nal_type", "nal_units", "without_parameter_sets"]

START_CODE: Final = b"\x00\x00\x00\x01"
PARAMETER_SETS: Final = frozenset({32, 33, 34})
"""Types of VPS, SPS and PPS (H.265 table 7-1)."""

_IRAP: Final = range(16, 24)  # BLA, IDR, CRA and what is reserved beside them


def nal_units(stream: bytes) -> list[bytes]:
    """Return the NAL units of a byte stream, without start codes and the zeros between them.

    Raises:
        ValueError: If it does not begin with a start code.
    """
    first = stream.find(b"\x00\x00\x01")
    if first < 0 or stream[:first].strip(b"\x00"):
        raise ValueError(f"no start code at the beginning of {len(stream)} bytes {stream[:8].hex(' ')}")
    units = []
    begin = first + 3
    while (end := stream.find(b"\x00\x00\x01", begin)) >= 0:
        units.append(stream[begin:end].rstrip(b"\x00"))
        begin = end + 3
    units.append(stream[begin:].rstrip(b"\x00"))
    return units


def joined(units: Iterable[bytes]) -> bytes:
    """Return NAL units as a byte stream, each behind a start code of four bytes."""
    return b"".join(START_CODE + unit for unit in units)


def nal_type(unit: bytes) -> int:
    """Return the type of a NAL unit, 0 to 63 (H.265 §7.3.1.2)."""
    return unit[0] >> 1 & 0x3F


def is_irap(units: Iterable[bytes]) -> bool:
    """Return whether decoding can begin with a picture of these NAL units."""
    return any(nal_type(unit) in _IRAP for unit in units)


def without_parameter_sets(stream: bytes) -> bytes:
    """Return a byte stream without VPS, SPS and PPS, as of an encoder that sends them only once."""
    return joined(unit for unit in nal_units(stream) if nal_type(unit) not in PARAMETER_SETS)
