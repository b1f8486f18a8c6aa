"""H.265 pictures as RTP packets (RFC 3550, RFC 7798): what the robot's sender does, written from the standards.

Small NAL units travel together in an aggregation packet, large ones in fragmentation units; the last packet of a
picture has the marker. No DONL fields, no PACI packets. Pure: bytes in, bytes out.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Iterator, Sequence
from typing import Final

from gateway.sim.camera.annexb import nal_units

__all__ = ["CLOCK_HZ", "HEADER_BYTES", "MAX_PACKET_BYTES", "PAYLOAD_TYPE", "Packetiser"]

CLOCK_HZ: Final = 90_000
"""Ticks of an RTP timestamp per second (RFC 7798 §4.1)."""
PAYLOAD_TYPE: Final = 96
"""Unless told otherwise (§5.1)."""
MAX_PACKET_BYTES: Final = 1400
"""With the RTP header (choice): fits into an Ethernet frame through most tunnels."""
HEADER_BYTES: Final = 12

_AGGREGATION, _FRAGMENTATION = 48, 49


class Packetiser:
    """One sender's stream: SSRC, sequence number and first timestamp are random, as RFC 3550 §5.1 asks.

    Args:
        seed: Of the random beginnings; None for new ones each time.
        payload_type: 0 to 127.
        max_bytes: Of a packet with its header.

    Attributes:
        ssrc: 32 bits.
        sequence: Of the next packet, 16 bits.
        first_timestamp: Of a picture at tick 0, 32 bits.

    Raises:
        ValueError: If a number is out of range.
    """

    def __init__(
        self, seed: int | None = None, *, payload_type: int = PAYLOAD_TYPE, max_bytes: int = MAX_PACKET_BYTES
    ) -> None:
        if not 0 <= payload_type <= 127:
            raise ValueError(f"payload type {payload_type} is outside [0, 127] (RFC 3550 §5.1)")
        if not 64 <= max_bytes <= 65_507:
            raise ValueError(f"max_bytes {max_bytes} is outside [64, 65507] bytes")
        chance = random.Random(seed)
        self.ssrc = chance.getrandbits(32)
        self.sequence = chance.getrandbits(16)
        self.first_timestamp = chance.getrandbits(32)
        self._payload_type = payload_type
        self._room = max_bytes - HEADER_BYTES

    def packets(self, picture: bytes, tick: int) -> list[bytes]:
        """Return a picture's packets, in order.

        Args:
            picture: Its NAL units as an annex B byte stream.
            tick: Its time since the stream began [ticks of CLOCK_HZ].

        Raises:
            ValueError: If the picture does not begin with a start code, or has a NAL unit without a whole header.
        """
        payloads = list(_payloads(nal_units(picture), self._room))
        timestamp = (self.first_timestamp + tick) & 0xFFFFFFFF
        packets = []
        for number, payload in enumerate(payloads, start=1):
            second = self._payload_type | (0x80 if number == len(payloads) else 0)
            packets.append(struct.pack("!BBHII", 0x80, second, self.sequence, timestamp, self.ssrc) + payload)
            self.sequence = (self.sequence + 1) & 0xFFFF
        return packets


def _payloads(units: Sequence[bytes], room: int) -> Iterator[bytes]:
    """Yield the payloads of packets that carry these NAL units."""
    together: list[bytes] = []
    for unit in units:
        if len(unit) < 2:
            raise ValueError(f"a NAL unit of {len(unit)} bytes: its header alone has 2 (H.265 §7.3.1.2)")
        if together and 2 + sum(2 + len(one) for one in (*together, unit)) > room:
            yield _aggregated(together)
            together = []
        if len(unit) > room:
            yield from _fragments(unit, room)
        else:
            together.append(unit)
    if together:
        yield _aggregated(together)


def _aggregated(units: Sequence[bytes]) -> bytes:
    """Return one NAL unit as it is, several as an aggregation packet (RFC 7798 §4.4.2)."""
    if len(units) == 1:
        return units[0]
    parts = b"".join(struct.pack("!H", len(unit)) + unit for unit in units)
    forbidden = max(unit[0] & 0x80 for unit in units)
    layer = min((unit[0] & 1) << 5 | unit[1] >> 3 for unit in units)
    temporal = min(unit[1] & 7 for unit in units)
    return bytes((forbidden | _AGGREGATION << 1 | layer >> 5, (layer & 0x1F) << 3 | temporal)) + parts


def _fragments(unit: bytes, room: int) -> Iterator[bytes]:
    """Yield a NAL unit as fragmentation units (RFC 7798 §4.4.3)."""
    header = bytes(((unit[0] & 0x81) | _FRAGMENTATION << 1, unit[1]))
    kind = unit[0] >> 1 & 0x3F
    size = room - 3
    for begin in range(2, len(unit), size):
        start = 0x80 if begin == 2 else 0
        end = 0x40 if begin + size >= len(unit) else 0
        yield header + bytes((start | end | kind,)) + unit[begin : begin + size]
