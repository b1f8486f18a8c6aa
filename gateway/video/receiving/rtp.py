"""One RTP packet out of one datagram, or the reason why there is none in it (RFC 3550 section 5.1, 5.3.1).

Knows nothing of what the payload means, nor of the packets before.
"""

from __future__ import annotations

import struct
from enum import Enum
from typing import Final, NamedTuple

__all__ = ["HEADER_BYTES", "PAYLOAD_TYPE", "RtpFault", "RtpPacket", "parse", "payload_type_of"]

PAYLOAD_TYPE: Final = 96
"""Payload type of the robot's stream unless it is told otherwise (§5.1)."""

_HEADER: Final = struct.Struct("!BBHII")
HEADER_BYTES: Final = _HEADER.size
"""Of a header without sources and extension."""
_VERSION: Final = 2
_HAS_PADDING: Final = 0x20
_HAS_EXTENSION: Final = 0x10
_MARKER: Final = 0x80


class RtpFault(str, Enum):
    """Why a datagram is no packet of the stream; the value is the name of its counter in `Counts`."""

    TOO_SHORT = "too_short"
    BAD_VERSION = "bad_version"
    BAD_PAYLOAD_TYPE = "bad_payload_type"
    BAD_HEADER = "bad_header"
    BAD_PADDING = "bad_padding"
    EMPTY = "empty"


class RtpPacket(NamedTuple):
    """A packet, its header checked and taken off.

    Attributes:
        seq: Sequence number, modulo 2^16.
        timestamp: Modulo 2^32 [ticks].
        ssrc: Of its sender.
        is_marked: The marker bit: the last packet of a picture (RFC 7798 section 4.1).
        payload: Without padding; at least one byte.
    """

    seq: int
    timestamp: int
    ssrc: int
    is_marked: bool
    payload: bytes


def parse(datagram: bytes | memoryview, payload_type: int = PAYLOAD_TYPE) -> RtpPacket | RtpFault:
    """Return the packet in a datagram, or why there is none.

    Args:
        datagram: As it came; it is copied, so that a buffer can be used again.
        payload_type: The one that is wanted, 0 to 127.
    """
    size = len(datagram)
    if size < _HEADER.size:
        return RtpFault.TOO_SHORT
    first, second, seq, timestamp, ssrc = _HEADER.unpack_from(datagram)
    if first >> 6 != _VERSION:
        return RtpFault.BAD_VERSION
    if second & 0x7F != payload_type:
        return RtpFault.BAD_PAYLOAD_TYPE
    start = _HEADER.size + 4 * (first & 0x0F)
    if first & _HAS_EXTENSION:
        if start + 4 > size:
            return RtpFault.BAD_HEADER
        start += 4 + 4 * int.from_bytes(datagram[start + 2 : start + 4], "big")
    if start > size:
        return RtpFault.BAD_HEADER
    end = size
    if first & _HAS_PADDING:
        padding = datagram[size - 1]
        if padding == 0 or start + padding > size:
            return RtpFault.BAD_PADDING
        end -= padding
    if start == end:
        return RtpFault.EMPTY
    return RtpPacket(seq, timestamp, ssrc, bool(second & _MARKER), bytes(datagram[start:end]))


def payload_type_of(datagram: bytes | memoryview) -> int:
    """Return the payload type of a datagram that `parse` found none but that wrong."""
    return datagram[1] & 0x7F
