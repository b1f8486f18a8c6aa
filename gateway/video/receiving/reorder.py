"""Puts RTP packets in the order of their sequence numbers, and says which are lost.

Rules
    * Sequence numbers are unwrapped: they rise for ever, whatever their 16 bits do.
    * A packet that comes early is held. Its predecessors are given up when more than a window of packets is held, or the
      one held longest has waited for `HOLD_NS`.
    * The first packets of a sender are held until there are a few: the very first may have been overtaken, and with the
      parameter sets in it a whole group of pictures would be lost.
    * One packet far off in the sequence is a stray; two in a row there are a jump, and are followed (RFC 3550 appendix
      A.1). How many packets were lost then, only their numbers say.

Pure: packets and times in, packets in order out.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from gateway.video.receiving.counters import Tally
from gateway.video.receiving.rtp import RtpPacket

__all__ = ["HOLD_NS", "MAX_WINDOW", "MIN_WINDOW", "WINDOW", "Ordered", "Reorder"]

MIN_WINDOW: Final = 4
MAX_WINDOW: Final = 32
WINDOW: Final = 16
"""Packets that are held behind a missing one: 9 ms of the robot's stream at 20 Mbit/s (derived)."""
HOLD_NS: Final = 20_000_000
"""Longest time that a packet is held behind a missing one [ns]: about one picture, and what the network may swap within."""
START: Final = 4
"""Packets from which on a sender's first number is believed."""
MAX_DROPOUT: Final = 3000
"""Larger gaps are jumps [packets]."""
MAX_MISORDER: Final = 512
"""Further back is another sequence [packets]."""
_TURN: Final = 1 << 16
_REMEMBERED: Final = (1 << MAX_MISORDER) - 1


class Ordered(NamedTuple):
    """A packet whose turn it is.

    Attributes:
        packet: The packet.
        seq: Its sequence number, unwrapped.
        lost: How many directly before it are lost, by their numbers.
        is_jump: Whether the sequence jumped here; `lost` is not counted then.
        arrived_ns: When it arrived [ns].
    """

    packet: RtpPacket
    seq: int
    lost: int
    is_jump: bool
    arrived_ns: int


class Reorder:
    """The packets of one sender.

    Args:
        tally: What counts lost, late, duplicate, reordered and stray packets, and jumps.
        window: Packets held behind a missing one, MIN_WINDOW to MAX_WINDOW.

    Raises:
        ValueError: If the window is outside its bounds.
    """

    def __init__(self, tally: Tally, window: int = WINDOW) -> None:
        if not MIN_WINDOW <= window <= MAX_WINDOW:
            raise ValueError(f"reorder window {window} is outside [{MIN_WINDOW}, {MAX_WINDOW}] packets")
        self._tally = tally
        self._window = window
        self._held: dict[int, tuple[RtpPacket, int]] = {}  # in order of arrival
        self._next: int | None = None
        self._is_starting = True
        self._received = 0  # bit n: whether the packet n + 1 before the next one came
        self._stray: tuple[RtpPacket, int] | None = None

    def is_newest(self, packet: RtpPacket) -> bool:
        """Return whether a packet is the last whose turn it was, with nothing held behind it: its successor is next."""
        return self._next is not None and not self._held and (self._next - packet.seq) % _TURN == 1

    def pass_over(self, count: int) -> None:
        """Take in that the next packets came, in order, and went by; only while nothing is held."""
        assert self._next is not None
        self._received = (self._received << count | (1 << count) - 1) & _REMEMBERED
        self._next += count
        self._stray = None

    def put(self, packet: RtpPacket, now_ns: int) -> list[Ordered]:
        """Take a packet; return those whose turn it is now."""
        if self._next is None:
            self._next = packet.seq + _TURN - START
        ahead = _signed(packet.seq - self._next)
        if not (ahead or self._held):  # nearly always
            self._stray, self._is_starting = None, False
            self._received = (self._received << 1 | 1) & _REMEMBERED
            self._next += 1
            return [Ordered(packet, self._next - 1, 0, False, now_ns)]
        if not -MAX_MISORDER <= ahead <= MAX_DROPOUT:
            return self._far(packet, now_ns)
        self._stray = None
        seq = self._next + ahead
        if ahead < 0:
            self._tally.add(**{"duplicates" if self._received >> (-ahead - 1) & 1 else "late": 1})
            return []
        if seq in self._held:
            self._tally.add(duplicates=1)
            return []
        if any(held > seq for held in self._held):
            self._tally.add(reordered=1)
        self._held[seq] = packet, now_ns
        return [*self._released(), *self.expire(now_ns)]

    def expire(self, now_ns: int) -> list[Ordered]:
        """Give up what was waited for too long; return the packets whose turn it is then."""
        ordered: list[Ordered] = []
        while self._held:
            _, oldest_ns = next(iter(self._held.values()))
            if len(self._held) <= (START if self._is_starting else self._window) and now_ns - oldest_ns < HOLD_NS:
                break
            ordered += self._passed_gap()
        return ordered

    def _passed_gap(self) -> list[Ordered]:
        """Go on with the first packet held; what is missing before it is lost, unless nothing came before."""
        assert self._next is not None
        first = min(self._held)
        lost = 0 if self._is_starting else first - self._next
        self._is_starting = False
        self._tally.add(lost=lost)
        self._received = (self._received << lost) & _REMEMBERED
        self._next = first
        return self._released(lost)

    def _released(self, lost: int = 0, *, is_jump: bool = False) -> list[Ordered]:
        assert self._next is not None
        ordered = []
        while self._next in self._held:
            packet, arrived_ns = self._held.pop(self._next)
            ordered.append(Ordered(packet, self._next, lost, is_jump, arrived_ns))
            lost, is_jump, self._is_starting = 0, False, False
            self._received = (self._received << 1 | 1) & _REMEMBERED
            self._next += 1
        return ordered

    def _far(self, packet: RtpPacket, now_ns: int) -> list[Ordered]:
        stray, self._stray = self._stray, (packet, now_ns)
        if stray is None or packet.seq != (stray[0].seq + 1) % _TURN:
            self._tally.add(strays=1)
            return []
        ordered: list[Ordered] = []
        while self._held:
            ordered += self._passed_gap()
        assert self._next is not None
        before = self._next
        self._next += (stray[0].seq - before) % _TURN
        self._held = {self._next: stray, self._next + 1: (packet, now_ns)}
        self._received, self._stray = 0, None
        self._tally.add(resyncs=1)
        return [*ordered, *self._released(self._next - before, is_jump=True)]


def _signed(difference: int) -> int:
    """Return a difference of sequence numbers as one between -2^15 and 2^15 - 1."""
    return (difference + _TURN // 2) % _TURN - _TURN // 2
