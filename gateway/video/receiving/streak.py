"""Fragments that bring nothing new but their bytes: nearly all packets of a stream, told from others by one look.

The layers that every packet goes through (`rtp`, `reorder`, `depacketiser`) cost a few microseconds when they are busy,
and four times that for a packet that comes alone, as paced ones do: nothing of them is in a processor's caches any more.
So the packets of one NAL unit that are just what is expected next are put aside here, and handed to the layers together
(measured: 14 us a packet in all instead of 21 us).

What is expected: the next sequence number, everything else in the header as before, no marker, the same size. Whatever
else comes ends the streak, and goes through all layers. Until then what was put aside is not counted: some milliseconds.
"""

from __future__ import annotations

import struct
from typing import Final

from gateway.video.receiving.rtp import HEADER_BYTES, RtpPacket

__all__ = ["Streak"]

_HEAD: Final = struct.Struct("!HH11s")
"""Version to payload type; sequence number; timestamp, SSRC and both headers of an FU."""
_TAIL: Final = struct.Struct("!II3s")
_PLAIN: Final = 0x8000  # version 2; no padding, extension, sources nor marker
MAX_BYTES: Final = 1 << 20
"""A streak ends with so much, lest a picture without an end fill the memory."""


class Streak:
    """The fragments behind one that went through all layers.

    Attributes:
        pieces: What follows the headers in those that came.
    """

    def __init__(self, before: RtpPacket, awaits: bytes, source: str, payload_type: int) -> None:
        self.pieces: list[bytes] = []
        self.size = HEADER_BYTES + len(before.payload)
        """Of each datagram [bytes]."""
        self._head = _PLAIN | payload_type
        self._seq = before.seq
        self._tail = _TAIL.pack(before.timestamp, before.ssrc, awaits)
        self._source = source
        self._room = MAX_BYTES // self.size

    def takes(self, datagram: bytes | memoryview, source: str) -> bool:
        """Return whether a datagram is what is expected next; its bytes are copied then."""
        if len(datagram) != self.size or source != self._source or not self._room:
            return False
        head, seq, tail = _HEAD.unpack_from(datagram)
        if head != self._head or seq != (self._seq + 1) & 0xFFFF or tail != self._tail:
            return False
        self._seq = seq
        self._room -= 1
        self.pieces.append(bytes(datagram[_HEAD.size :]))
        return True
