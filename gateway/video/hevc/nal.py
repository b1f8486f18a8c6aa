"""HEVC NAL units: their types, Annex B form, and what a receiver must know of their insides (H.265 section 7.3, 7.4.2).

A NAL unit here is its bytes from the two-byte header on, with emulation prevention, without start code.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from typing import Final

from gateway.video.hevc.bits import BitReader, BitsEnded

__all__ = [
    "HEADER_BYTES",
    "PARAMETER_SETS",
    "START_CODE",
    "NalType",
    "annex_b",
    "begins_picture",
    "is_irap",
    "is_slice",
    "is_valid",
    "nal_type",
    "recovery_point",
]

START_CODE: Final = b"\x00\x00\x00\x01"
HEADER_BYTES: Final = 2


class NalType(IntEnum):
    """Types of NAL units that somebody here must know; 48 to 50 exist in RTP payloads only (RFC 7798 section 4.4)."""

    TRAIL_R = 1
    RASL_N = 8
    RASL_R = 9
    BLA_W_LP = 16
    BLA_N_LP = 18
    IDR_W_RADL = 19
    IDR_N_LP = 20
    CRA = 21
    LAST_IRAP = 23
    LAST_SLICE = 31
    VPS = 32
    SPS = 33
    PPS = 34
    AUD = 35
    PREFIX_SEI = 39
    LAST_SINGLE = 47
    AP = 48
    FU = 49
    PACI = 50


PARAMETER_SETS: Final = frozenset({NalType.VPS, NalType.SPS, NalType.PPS})
RECOVERY_POINT: Final = 6
"""Payload type of the recovery point SEI message (H.265 section D.2.8)."""
MAX_SEI_BYTES: Final = 4096
"""A longer SEI is not looked into."""


def nal_type(nal: bytes) -> int:
    """Return the type of a NAL unit of at least one byte."""
    return (nal[0] >> 1) & 0x3F


def is_valid(nal: bytes) -> bool:
    """Return whether its header is one of a NAL unit: zero bit, a type below 48, a temporal id, something behind it."""
    return len(nal) > HEADER_BYTES and nal[0] < 0x60 and bool(nal[1] & 0x07)


def is_slice(kind: int) -> bool:
    """Return whether a type is one of a picture's slices (VCL)."""
    return kind <= NalType.LAST_SLICE


def is_irap(kind: int) -> bool:
    """Return whether decoding can begin with a picture of such slices: IDR, CRA, BLA."""
    return NalType.BLA_W_LP <= kind <= NalType.LAST_IRAP


def begins_picture(slice_nal: bytes) -> bool:
    """Return whether a slice is the first of its picture (`first_slice_segment_in_pic_flag`)."""
    return bool(slice_nal[2] & 0x80)


def recovery_point(sei: bytes) -> int | None:
    """Return after how many pictures, in order of output, decoding that begins here is exactly right.

    Args:
        sei: A prefix SEI NAL unit.

    Returns:
        The number; None without such a message, or with one that promises a picture that is only nearly right.
    """
    if len(sei) > MAX_SEI_BYTES:
        return None
    reader = BitReader(sei[HEADER_BYTES:])
    try:
        while True:
            kind, size = _number(reader), _number(reader)
            if kind == RECOVERY_POINT:
                count, is_exact, is_broken = reader.signed(), reader.read(1), reader.read(1)
                return count if is_exact and not is_broken else None
            reader.read(8 * size)
    except BitsEnded:
        return None


def _number(reader: BitReader) -> int:
    total = 0
    while (byte := reader.read(8)) == 0xFF:
        total += byte
    return total + byte


def annex_b(nals: Iterable[bytes]) -> bytes:
    """Return NAL units one after the other, each behind a start code of four bytes."""
    return b"".join(part for nal in nals for part in (START_CODE, nal))
