"""A sender that may take the place of the one that is listened to: its packets, from a key picture on.

A sender that begins anew does so with parameter sets and a key picture. Whoever waits for a long silence of the old one
misses them, and shows nothing until the next ones come. So they are kept here, and given back when the silence is long
enough: nothing of the new one is lost, and a stranger gains nothing by being kept.

Pure: packets of one other sender at a time.
"""

from __future__ import annotations

from typing import Final

from gateway.video.hevc.nal import HEADER_BYTES, PARAMETER_SETS, NalType, is_irap, nal_type
from gateway.video.receiving.rtp import RtpPacket

__all__ = ["Successor"]

MAX_PACKETS: Final = 2000
"""No more are kept: more than a second of the robot's stream at 20 Mbit/s."""
_TURN: Final = 1 << 16
_STARTS: Final = 0x80
_KIND: Final = 0x3F


class Successor:
    """Another sender than the one listened to.

    Attributes:
        sender: Its SSRC and address; None when nothing is kept.
        packets: What is kept of it, each with the time of its arrival [ns].
    """

    def __init__(self) -> None:
        self.sender: tuple[int, str] | None = None
        self.packets: list[tuple[RtpPacket, int]] = []
        self._offsets: set[int] = set()  # of their sequence numbers, from the first one's on
        self._kinds: set[int] = set()  # of the NAL units that began in them
        self._is_ended = False  # the first picture

    @property
    def is_ready(self) -> bool:
        """Whether it has shown a whole key picture with parameter sets, and nothing is missing since."""
        return (
            self._is_ended
            and self._kinds >= PARAMETER_SETS
            and any(map(is_irap, self._kinds))
            and len(self._offsets) == max(self._offsets) + 1
        )

    def keep(self, packet: RtpPacket, sender: tuple[int, str], now_ns: int) -> int:
        """Take another sender's packet; return how many packets are known to be of no use now, it or those before it."""
        kinds = _beginning_in(packet.payload)
        offset = (packet.seq - self.packets[0][0].seq) % _TURN if self.packets else 0
        if sender == self.sender and offset in self._offsets:
            return 1  # it came before
        dropped = 0
        if NalType.VPS in kinds or len(self.packets) >= MAX_PACKETS:
            dropped, offset = self.forget(), 0
        if NalType.VPS in kinds:
            self.sender = sender
        if sender != self.sender or offset >= _TURN // 2:
            return dropped + 1
        self._is_ended |= packet.is_marked or bool(self.packets and packet.timestamp != self.packets[0][0].timestamp)
        self._offsets.add(offset)
        self._kinds |= kinds
        self.packets.append((packet, now_ns))
        return dropped

    def forget(self) -> int:
        """Keep nothing any more; return how many packets were kept."""
        count = len(self.packets)
        self.sender, self.packets = None, []
        self._offsets, self._kinds, self._is_ended = set(), set(), False
        return count


def _beginning_in(payload: bytes) -> set[int]:
    """Return the types of the NAL units that begin in an RTP payload (RFC 7798 section 4.4)."""
    kind = nal_type(payload)
    if kind == NalType.FU:
        flags = payload[HEADER_BYTES] if len(payload) > HEADER_BYTES else 0
        return {flags & _KIND} if flags & _STARTS else set()
    if kind != NalType.AP:
        return {kind}
    kinds, at = set(), HEADER_BYTES
    while at + 2 < len(payload):
        kinds.add(nal_type(payload[at + 2 :]))
        at += 2 + int.from_bytes(payload[at : at + 2], "big")
    return kinds
