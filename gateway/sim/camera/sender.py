"""Sends encoded pictures as RTP on an absolute grid, as the robot does: one way, to one address (§5.1).

A picture's packets are spread over part of its period, as a network card's pacing does. A late sender skips whole
periods, counts them, and its timestamps go on with the grid: no burst, and no picture is left out of the stream.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from gateway.sim.camera.annexb import is_irap, nal_units
from gateway.sim.camera.film import Coded
from gateway.sim.camera.handover import HandOver, HandOvers
from gateway.sim.camera.rtp import CLOCK_HZ, PAYLOAD_TYPE, Packetiser

__all__ = ["DEFAULT_TO", "Counts", "Sender", "address_of"]

DEFAULT_TO: Final = "127.0.0.1:8890"
"""The robot's default port (§5.1), on this host."""
S: Final = 1_000_000_000
_BUNCHES: Final = 10  # a picture's packets leave in so many groups: a sleep for each packet would cost more than it


@dataclass(slots=True)
class Counts:
    """What was sent.

    Attributes:
        pictures: Handed over.
        packets: Of these.
        sent_bytes: Of these, with RTP headers.
        late: Periods that were skipped because the sender was late.
        refused: Packets that the operating system did not take.
        lives: Senders so far: each restart is another.
    """

    pictures: int = 0
    packets: int = 0
    sent_bytes: int = 0
    late: int = 0
    refused: int = 0
    lives: int = 1


def address_of(text: str) -> tuple[str, int]:
    """Return host and port of `HOST:PORT`; IPv6 addresses stand in brackets.

    Raises:
        ValueError: If it is neither.
    """
    host, colon, port = text.rpartition(":")
    if not (colon and host and port.isdigit() and 0 < int(port) < 65_536) or (":" in host and not host.startswith("[")):
        raise ValueError(f"{text!r} is no HOST:PORT, e.g. 127.0.0.1:8890")
    return host.strip("[]"), int(port)


class Sender:
    """One way of pictures to one address.

    `restart` and `is_silent` may be used from another thread than the one that runs it.

    `seed` is of SSRC, sequence number and timestamp, None for new ones each time; `spread` is the part of a period
    over which a picture's packets are spread, 0 for at once; an empty `bind` leaves the local address to the
    operating system.

    Attributes:
        counts: What was sent.
        is_silent: Set to send nothing for a while; the stream's clock goes on.

    Raises:
        OSError: If the address cannot be resolved, or sent from.
        ValueError: If a number is out of range.
    """

    def __init__(
        self,
        to: tuple[str, int],
        pictures: Iterator[Coded],
        rate_hz: int = 45,
        *,
        seed: int | None = None,
        spread: float = 0.5,
        payload_type: int = PAYLOAD_TYPE,
        table: HandOvers | None = None,
        bind: str = "",
    ) -> None:
        if not 0.0 <= spread <= 0.9:
            raise ValueError(f"spread {spread} is outside [0, 0.9] periods")
        family, kind, protocol, _, where = socket.getaddrinfo(*to, type=socket.SOCK_DGRAM)[0]
        self._to: tuple[object, ...] = where
        self._pictures, self._rate_hz, self._spread = pictures, rate_hz, spread
        self._seed, self._payload_type = seed, payload_type
        self._table = table
        self._packetiser = Packetiser(seed, payload_type=payload_type)
        self._must_begin_anew = False
        self.counts = Counts()
        self.is_silent = False
        self._socket = socket.socket(family, kind, protocol)
        if bind:
            try:
                self._socket.bind((bind, 0))
            except OSError:
                self._socket.close()
                raise

    @property
    def ssrc(self) -> int:
        """Of the stream that is sent now."""
        return self._packetiser.ssrc

    def restart(self, *, at_key_frame: bool = True) -> None:
        """Be another sender from the next picture on: new SSRC, sequence number and timestamp.

        Args:
            at_key_frame: Begin with the next key frame; else wherever the stream is.
        """
        seed = None if self._seed is None else self._seed + self.counts.lives
        self.counts.lives += 1
        self._must_begin_anew = at_key_frame
        self._packetiser = Packetiser(seed, payload_type=self._payload_type)

    def run(self, should_stop: Callable[[], bool]) -> None:
        """Send until asked to stop, which is asked before each picture."""
        begin_ns = time.monotonic_ns()
        period = 0
        while not should_stop():
            coded = None if self.is_silent else next(self._pictures)
            if coded is not None and self._must_begin_anew:
                if not is_irap(nal_units(coded.data)):
                    continue
                self._must_begin_anew = False
            due_ns = begin_ns + period * S // self._rate_hz
            late = (time.monotonic_ns() - due_ns) * self._rate_hz // S
            if late > 0:
                self.counts.late += late
                period += late
                due_ns = begin_ns + period * S // self._rate_hz
            _sleep_until(due_ns)
            if coded is not None:
                self._send(coded, period)
            period += 1

    def _send(self, coded: Coded, period: int) -> None:
        packetiser = self._packetiser
        tick = period * CLOCK_HZ // self._rate_hz
        packets = packetiser.packets(coded.data, tick)
        size = -(-len(packets) // _BUNCHES)
        bunches = [packets[begin : begin + size] for begin in range(0, len(packets), size)]
        gap_ns = int(self._spread * S / self._rate_hz / len(bunches))
        start_ns = time.monotonic_ns()
        if self._table is not None:
            timestamp = (packetiser.first_timestamp + tick) & 0xFFFFFFFF
            self._table.note(coded.counter, HandOver(start_ns, timestamp, packetiser.ssrc))
        for number, bunch in enumerate(bunches):
            if gap_ns and number:
                _sleep_until(start_ns + number * gap_ns)
            self._send_bunch(bunch)
        self.counts.pictures += 1

    def _send_bunch(self, packets: Sequence[bytes]) -> None:
        for packet in packets:
            try:
                self._socket.sendto(packet, self._to)
            except OSError:  # no route now, or no room: the robot does not wait for its host either
                self.counts.refused += 1
                continue
            self.counts.packets += 1
            self.counts.sent_bytes += len(packet)

    def close(self) -> None:
        """Let go of the socket."""
        self._socket.close()


def _sleep_until(due_ns: int) -> None:
    rest_ns = due_ns - time.monotonic_ns()
    if rest_ns > 0:
        time.sleep(rest_ns / S)
