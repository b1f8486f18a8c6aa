"""A network that does to datagrams what real ones do, and worse; the same each time for the same seed.

`BadNetwork` is pure: a datagram in, datagrams out. `Relay` puts it between two sockets.
"""

from __future__ import annotations

import random
import socket
import struct
import threading
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import NamedTuple

__all__ = ["OTHER", "ROBOT", "BadNetwork", "Datagram", "Faults", "Relay", "relay"]

ROBOT, OTHER = "127.0.0.1", "127.0.0.2"
"""Addresses of the sender, and of one who is not."""
HEADER = 12


class Datagram(NamedTuple):
    """What arrives.

    Attributes:
        data: Its bytes.
        source: Address that it came from.
    """

    data: bytes
    source: str = ROBOT


@dataclass(frozen=True, kw_only=True)
class Faults:
    """What happens to datagrams; probabilities are per datagram that comes in.

    Attributes:
        loss_p: It is lost.
        burst_p: With it a burst of losses begins.
        burst_length: Mean length of these.
        swap_p: It arrives after its successor.
        duplicate_p: It arrives twice.
        truncate_p: Its end is missing.
        truncates_last: Whether that of a picture's last packet can be missing too, which no receiver can know.
        garbage_p: Random bytes arrive before it.
        spoof_p: Valid RTP with another SSRC arrives before it, from another address unless `spoofs_address`.
        spoofs_address: Whether that bears the sender's address.
        payload_type: Which it has instead of its own; None for its own.
        is_silent: Whether nothing at all arrives.
    """

    loss_p: float = 0.0
    burst_p: float = 0.0
    burst_length: float = 20.0
    swap_p: float = 0.0
    duplicate_p: float = 0.0
    truncate_p: float = 0.0
    truncates_last: bool = True
    garbage_p: float = 0.0
    spoof_p: float = 0.0
    spoofs_address: bool = False
    payload_type: int | None = None
    is_silent: bool = False


class BadNetwork:
    """Passes datagrams on, more or less.

    Args:
        faults: What happens; may be set anew at any time.
        seed: Of everything that is drawn.

    Attributes:
        did: How often each fault happened, by its name.
    """

    def __init__(self, faults: Faults | None = None, seed: int = 0) -> None:
        self.faults = faults or Faults()
        self.did: Counter[str] = Counter()
        self._chance = random.Random(seed)
        self._burst = 0
        self._held: bytes | None = None
        self._spoofed = self._chance.getrandbits(16)

    def pass_on(self, data: bytes) -> list[Datagram]:
        """Take a datagram of the sender; return what arrives now."""
        faults = self.faults
        if faults.is_silent:
            self.did["silence"] += 1
            return []
        arriving = [*self._garbage(), *self._spoof(data)]
        if self._is_lost():
            return arriving
        if faults.payload_type is not None and len(data) > 1:
            self.did["payload_type"] += 1
            data = data[:1] + bytes((data[1] & 0x80 | faults.payload_type,)) + data[2:]
        is_spared = not faults.truncates_last and len(data) > 1 and bool(data[1] & 0x80)
        if not is_spared and self._happens("truncate", faults.truncate_p):
            data = data[: self._chance.randrange(len(data))]
        own = [data, data] if self._happens("duplicate", faults.duplicate_p) else [data]
        if self._held is not None:
            own.append(self._held)
            self._held = None
        elif self._happens("swap", faults.swap_p):
            self._held = own.pop()
        return [*arriving, *map(Datagram, own)]

    def flush(self) -> list[Datagram]:
        """Return what is still held."""
        held, self._held = self._held, None
        return [] if held is None else [Datagram(held)]

    def _happens(self, name: str, probability: float) -> bool:
        happens = probability > 0.0 and self._chance.random() < probability
        self.did[name] += happens
        return happens

    def _is_lost(self) -> bool:
        if not self.faults.burst_p:
            self._burst = 0
        if not self._burst and self._happens("burst", self.faults.burst_p):
            self._burst = 1 + int(self._chance.expovariate(1 / self.faults.burst_length))
        if self._burst:
            self._burst -= 1
            self.did["loss"] += 1
            return True
        return self._happens("loss", self.faults.loss_p)

    def _garbage(self) -> Iterable[Datagram]:
        if self._happens("garbage", self.faults.garbage_p):
            yield Datagram(self._chance.randbytes(self._chance.randrange(1401)))

    def _spoof(self, data: bytes) -> Iterable[Datagram]:
        if len(data) > HEADER and self._happens("spoof", self.faults.spoof_p):
            self._spoofed = (self._spoofed + 1) & 0xFFFF
            (timestamp,) = struct.unpack_from("!I", data, 4)
            header = data[:2] + struct.pack("!HII", self._spoofed, timestamp ^ 0xFFFF, 0xDEADBEEF)
            yield Datagram(header + data[HEADER:], ROBOT if self.faults.spoofs_address else OTHER)


class Relay:
    """A bad network between two UDP ports of loopback: a sender is told `port`, and what arrives goes to `to`.

    Args:
        network: What happens on the way.
        to: Port of the receiver.

    Attributes:
        port: Where the sender sends to.
    """

    def __init__(self, network: BadNetwork, to: int) -> None:
        self.network = network
        self._to = ("127.0.0.1", to)
        self._in = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._in.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_000_000)
        self._in.bind((ROBOT, 0))
        self._in.settimeout(0.02)
        self.port = int(self._in.getsockname()[1])
        self._out = {address: socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for address in (ROBOT, OTHER)}
        for address, out in self._out.items():
            out.bind((address, 0))
        self._is_running = True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def set(self, **faults: object) -> None:
        """Change what happens on the way."""
        self.network.faults = replace(self.network.faults, **faults)  # type: ignore[arg-type]

    def _run(self) -> None:
        while self._is_running:
            try:
                data = self._in.recv(65_536)
            except TimeoutError:
                arriving = self.network.flush()
            else:
                arriving = self.network.pass_on(data)
            for datagram in arriving:
                self._out[datagram.source].sendto(datagram.data, self._to)

    def close(self) -> None:
        """End it."""
        self._is_running = False
        self._thread.join()
        for end in (self._in, *self._out.values()):
            end.close()


@contextmanager
def relay(network: BadNetwork, to: int) -> Iterator[Relay]:
    """Run a relay during a block."""
    running = Relay(network, to)
    try:
        yield running
    finally:
        running.close()
