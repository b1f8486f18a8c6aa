"""Datagrams of one port -> coded pictures of the one sender that is listened to.

Rules
    * Only addresses that are allowed are listened to; the robot's, unless told otherwise (§2.6.3).
    * One sender at a time, known by SSRC and address. Another one is taken after 0.3 s of silence only: whoever is not
      listened to cannot take the stream over. From its first packet on: its parameter sets may be in it.
    * One at the same address that has begun with a whole key picture is the sender after a restart: it is taken after
      0.1 s, from that picture on (`successor`).
    * A new sender is a new life: sequence, time, parameter sets and the picture begun belong to the old one. A jump of the
      RTP time together with one of the sequence is a restart of the same sender, and a new life, too; a jump of the time
      alone is its clock's.
    * Fragments that bring nothing new are put aside and handed on together (`streak`).

Pure: datagrams and times in, pictures out. One thread at a time; `counts` and `facts` may be read from any.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

from gateway.video.hevc.access_unit import AccessUnit
from gateway.video.hevc.nal import NalType
from gateway.video.receiving.counters import Tally
from gateway.video.receiving.depacketiser import Depacketiser
from gateway.video.receiving.reorder import HOLD_NS, WINDOW, Ordered, Reorder
from gateway.video.receiving.rtp import PAYLOAD_TYPE, RtpFault, RtpPacket, parse, payload_type_of
from gateway.video.receiving.rtp_clock import RtpClock
from gateway.video.receiving.streak import Streak
from gateway.video.receiving.successor import Successor

__all__ = ["RESTART_NS", "SILENCE_NS", "Stream", "StreamFacts"]

SILENCE_NS: Final = 300_000_000
"""Another sender is taken when the one listened to was silent for so long [ns]."""
RESTART_NS: Final = 100_000_000
"""So long is enough [ns] for one that begins as the sender after a restart does: no sender pauses for four pictures."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamFacts:
    """What the receiver has seen, beside its counters; times are monotonic [ns], None: never.

    Attributes:
        datagram_ns: When the last datagram came.
        packet_ns: When the last packet of the sender listened to came.
        entry_ns: When the last intact picture was complete that decoding can begin with, parameter sets in it.
        idr_ns: When the last intact IDR was complete.
        life_ns: When the sender listened to began.
        life: Its number, from 0; None before the first.
        ssrc: Its SSRC.
        source: Its address.
        wrong_payload_type: The last one that was refused.
        wrong_source: The last address that was refused.
        knows_parameter_sets: Whether a VPS, an SPS and a PPS of it have come.
        unsupported: What of it goes on being malformed; see `Depacketiser`.
    """

    datagram_ns: int | None = None
    packet_ns: int | None = None
    entry_ns: int | None = None
    idr_ns: int | None = None
    life_ns: int | None = None
    life: int | None = None
    ssrc: int | None = None
    source: str | None = None
    wrong_payload_type: int | None = None
    wrong_source: str | None = None
    knows_parameter_sets: bool = False
    unsupported: str = ""


class Stream:
    """What comes to one port.

    Args:
        sources: Addresses that are listened to; None: all.
        payload_type: The one that is wanted.
        window: Packets held behind a missing one; see `Reorder`.
        tally: What counts; its own when None.
    """

    def __init__(
        self,
        sources: Collection[str] | None,
        *,
        payload_type: int = PAYLOAD_TYPE,
        window: int = WINDOW,
        tally: Tally | None = None,
    ) -> None:
        self.tally = Tally() if tally is None else tally
        """Its counters."""
        self._sources = None if sources is None else frozenset(sources)
        self._payload_type = payload_type
        self._window = window
        self._sender: tuple[int, str] | None = None
        self._reorder = Reorder(self.tally, window)
        self._clock: RtpClock | None = None
        self._streak: Streak | None = None
        self._successor = Successor()
        self._depacketiser = Depacketiser(self.tally, ssrc=0, life=-1, seq=0)
        self._life = -1
        self._life_ns: int | None = None
        self._datagram_ns: int | None = None
        self._packet_ns: int | None = None
        self._entry_ns: int | None = None
        self._idr_ns: int | None = None
        self._wrong_payload_type: int | None = None
        self._wrong_source: str | None = None

    def facts(self) -> StreamFacts:
        """Return what was seen until now."""
        sender = self._sender
        return StreamFacts(
            datagram_ns=self._datagram_ns,
            packet_ns=self._packet_ns,
            entry_ns=self._entry_ns,
            idr_ns=self._idr_ns,
            life_ns=self._life_ns,
            life=None if self._life < 0 else self._life,
            ssrc=None if sender is None else sender[0],
            source=None if sender is None else sender[1],
            wrong_payload_type=self._wrong_payload_type,
            wrong_source=self._wrong_source,
            knows_parameter_sets=self._depacketiser.knows_parameter_sets,
            unsupported=self._depacketiser.unsupported,
        )

    def receive(self, datagram: bytes | memoryview, source: str, now_ns: int) -> list[AccessUnit]:
        """Take a datagram; return the pictures that are complete now. Whatever it holds, nothing is raised.

        The datagram is copied; its source is an address without port.
        """
        self._datagram_ns = now_ns
        if (streak := self._streak) is not None:
            if streak.takes(datagram, source):
                self._packet_ns = now_ns
                return []
            self._end_streak(streak)
        self.tally.arrive(len(datagram))
        if self._sources is not None and source not in self._sources:
            self._wrong_source = source
            self.tally.add(bad_source=1)
            return self.expire(now_ns)
        packet = parse(datagram, self._payload_type)
        if isinstance(packet, RtpFault):
            self.tally.add(**{packet.value: 1})
            if packet is RtpFault.BAD_PAYLOAD_TYPE:
                self._wrong_payload_type = payload_type_of(datagram)
            return self.expire(now_ns)
        sender = packet.ssrc, source
        if sender != self._sender:
            return self._hear_another(packet, sender, now_ns)
        if self._successor.packets and now_ns - self._successor.packets[0][1] > HOLD_NS:  # no packet that was overtaken
            self.tally.add(bad_ssrc=self._successor.forget())
        units = self._accept(packet, now_ns, now_ns)
        if (awaits := self._depacketiser.awaits) and self._reorder.is_newest(packet):
            self._streak = Streak(packet, awaits, source, self._payload_type)
        return units

    def _hear_another(self, packet: RtpPacket, sender: tuple[int, str], now_ns: int) -> list[AccessUnit]:
        """Take a packet of another sender than the one listened to, or none."""
        successor = self._successor
        silence_ns = SILENCE_NS if self._packet_ns is None else now_ns - self._packet_ns
        if silence_ns >= SILENCE_NS:
            self.tally.add(bad_ssrc=successor.forget())
            self._listen_to(sender)
            return self._accept(packet, now_ns, now_ns)
        self.tally.add(bad_ssrc=successor.keep(packet, sender, now_ns))
        is_here = self._sender is not None and sender[1] == self._sender[1]
        if not (silence_ns >= RESTART_NS and is_here and successor.sender == sender and successor.is_ready):
            return self.expire(now_ns)
        packets = successor.packets
        successor.forget()
        self._listen_to(sender)
        return [unit for kept, came_ns in packets for unit in self._accept(kept, came_ns, now_ns)]

    def _listen_to(self, sender: tuple[int, str]) -> None:
        self._sender = sender
        self._reorder = Reorder(self.tally, self._window)
        self._clock = None

    def _accept(self, packet: RtpPacket, came_ns: int, now_ns: int) -> list[AccessUnit]:
        """Take a packet of the sender listened to."""
        self._packet_ns = now_ns
        self.tally.accept()
        return self._take(self._reorder.put(packet, came_ns), now_ns)

    def expire(self, now_ns: int) -> list[AccessUnit]:
        """Give up packets that were waited for too long, while nothing comes; return the pictures complete then."""
        if self._streak is not None:
            self._end_streak(self._streak)
        return self._take(self._reorder.expire(now_ns), now_ns)

    def _end_streak(self, streak: Streak) -> None:
        """Hand what was put aside to the layers."""
        self._streak = None
        if count := len(streak.pieces):
            self.tally.accept_all(count, streak.size)
            self._reorder.pass_over(count)
            self._depacketiser.extend(streak.pieces)

    def _take(self, packets: list[Ordered], now_ns: int) -> list[AccessUnit]:
        units: list[AccessUnit] = []
        for ordered in packets:
            ordered, rtp_time = self._timed(ordered)
            units += self._depacketiser.push(ordered, rtp_time, now_ns)
        for unit in units:
            if unit.is_entry and unit.has_parameter_sets:
                self._entry_ns = now_ns
                if unit.slice_type in (NalType.IDR_W_RADL, NalType.IDR_N_LP):
                    self._idr_ns = now_ns
        return units

    def _timed(self, ordered: Ordered) -> tuple[Ordered, int]:
        """Return a packet with its time unwrapped, in a new life where it begins one."""
        clock, packet = self._clock, ordered.packet
        if clock is not None and packet.timestamp == clock.stamp and not ordered.is_jump:  # nearly always
            return ordered, clock.time
        is_new = clock is None
        if clock is not None and clock.is_jump(packet.timestamp, ordered.arrived_ns):
            if ordered.lost or ordered.is_jump:
                is_new = True
            else:
                self.tally.add(time_jumps=1)
                clock.step_over(packet.timestamp, ordered.arrived_ns, self._depacketiser.period)
        if clock is None or is_new:
            clock = self._clock = self._begin(packet, ordered.arrived_ns)
            return ordered._replace(lost=0), clock.time
        if ordered.is_jump:
            self.tally.add(lost=ordered.lost)
        if clock.follow(packet.timestamp, ordered.arrived_ns):
            self.tally.add(time_falls=1)
        return ordered, clock.time

    def _begin(self, packet: RtpPacket, arrived_ns: int) -> RtpClock:
        """Begin a life of the sender."""
        self._life += 1
        self._life_ns = arrived_ns
        self.tally.add(lives=1, abandoned=self._depacketiser.is_in_picture)
        self._depacketiser = Depacketiser(self.tally, ssrc=packet.ssrc, life=self._life, seq=self._depacketiser.seq)
        return RtpClock(packet.timestamp, arrived_ns)
