"""Receives the robot's video: a thread of its own empties the socket, others take coded pictures (§5.1, §2.6.3).

```
with Receiver(source="192.168.1.100") as receiver:
    while (unit := receiver.take(timeout_s=1.0)) is not None: ...   # live: one taker, old pictures are dropped
    with receiver.tap(write, name="recorder"): ...                  # every picture, in a thread of its own
    for finding in receiver.why(): ...
```

The thread does nothing that could wait: whoever takes pictures has a queue, and pictures that are too old or too many are
dropped there, counted, and leave a hole in `AccessUnit.seq`.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

from gateway.process.threads import supervised
from gateway.video.hevc.access_unit import AccessUnit
from gateway.video.receiving.backlog import MAX_AGE_NS, Keeping, Live
from gateway.video.receiving.counters import Counts
from gateway.video.receiving.diagnosis import Facts, Finding, why
from gateway.video.receiving.reorder import WINDOW
from gateway.video.receiving.rtp import PAYLOAD_TYPE
from gateway.video.receiving.stream import Stream
from gateway.video.receiving.tap import CallbackTap, Tap
from gateway.video.receiving.udp import PORT, RECEIVE_BUFFER_BYTES, UdpSocket, addresses_of

__all__ = ["Receiver", "ReceiverSettings"]

_log = logging.getLogger(__name__)

RECENT_NS: Final = 2_000_000_000
"""Findings are about the last two to four seconds [ns]."""
DROPPED_EVERY_NS: Final = 500_000_000
"""The kernel is asked so often what it dropped [ns]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverSettings:
    """How to receive.

    Attributes:
        source: The robot's address or name; packets from elsewhere are refused. None takes them from anywhere.
        port: UDP port, as in the robot's system configuration; 0 takes a free one.
        host: Local address to listen on; empty: all of IPv4.
        payload_type: The robot's (§5.1).
        receive_buffer_bytes: Asked for; what is granted is reported.
        window: Packets held behind a missing one; see `Reorder`.
        max_age_ns: Longest wait of a picture for the live taker [ns].
    """

    source: str | None
    port: int = PORT
    host: str = ""
    payload_type: int = PAYLOAD_TYPE
    receive_buffer_bytes: int = RECEIVE_BUFFER_BYTES
    window: int = WINDOW
    max_age_ns: int = MAX_AGE_NS


class Receiver:
    """Receives from `start` to `stop`, or as a context; can be started again.

    Raises:
        ValueError: A setting is out of its bounds.
    """

    def __init__(self, settings: ReceiverSettings) -> None:
        self.settings = settings
        self._stream = Stream(None, payload_type=settings.payload_type, window=settings.window)
        self._socket: UdpSocket | None = None
        self._thread: threading.Thread | None = None
        self._is_stopping = False
        self._error: BaseException | None = None
        self._sources: frozenset[str] | None = None
        self._started_ns = 0
        self._live: Tap | None = None
        self._taps: tuple[Tap, ...] = ()
        self._taps_change = threading.Lock()
        self._marks: tuple[tuple[int, Counts], tuple[int, Counts]] = ((0, Counts()), (0, Counts()))

    def __enter__(self) -> Receiver:
        """Start it."""
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop it."""
        self.stop()

    @property
    def port(self) -> int:
        """The port that it listens on."""
        return self.settings.port if self._socket is None else self._socket.port

    @property
    def granted_bytes(self) -> int | None:
        """The receive buffer that the kernel granted; None before it is started."""
        return None if self._socket is None else self._socket.granted_bytes

    @property
    def counts(self) -> Counts:
        """What came and what was lost, since the receiver was made."""
        return self._stream.tally.snapshot()

    @property
    def is_over(self) -> bool:
        """Whether no more will come to `take`."""
        return self._live_tap().is_over

    def start(self) -> None:
        """Bind the port and receive; nothing when it does already.

        Raises:
            VideoError: PORT_BUSY or BAD_ADDRESS.
        """
        if self._thread is not None and self._thread.is_alive() and self._error is None:
            return
        self.stop()  # what is left of one that failed, and may still be ending
        settings = self.settings
        sources = None if settings.source is None else addresses_of(settings.source)
        self._socket = UdpSocket(settings.port, host=settings.host, buffer_bytes=settings.receive_buffer_bytes)
        self._sources = sources
        self._started_ns = time.monotonic_ns()
        self._is_stopping, self._error = False, None
        self._stream = Stream(
            sources, payload_type=settings.payload_type, window=settings.window, tally=self._stream.tally
        )
        with self._taps_change:
            self._live, self._taps = None, ()
        self._marks = ((self._started_ns, self.counts),) * 2
        if self._socket.granted_bytes < settings.receive_buffer_bytes:
            for finding in self.why():
                _log.warning("%s: %s -> %s", finding.code, finding.message, finding.hint)
        self._thread = supervised(
            partial(self._run, self._socket, self._stream), "video-receiver", may_return=lambda: self._is_stopping
        )
        self._thread.start()

    def stop(self) -> None:
        """Stop receiving and let go of the port; who takes pictures is given what waits, and then no more."""
        if self._thread is None or self._socket is None:
            return
        self._is_stopping = True
        self._thread.join()
        self._thread = None
        self._close_taps(None)

    def take(self, timeout_s: float) -> AccessUnit | None:
        """Return the next coded picture, live: those that became too old are dropped. For one taker.

        Pictures are kept for it from its first call on. Compare each with the one before by `AccessUnit.follows`.

        Args:
            timeout_s: Longest wait [s].

        Returns:
            The picture; None when none comes in time, or no more will come (`is_over`).

        Raises:
            VideoError: RECEIVER_FAILED: receiving ended by an error.
        """
        return self._live_tap().take(timeout_s)

    def tap(self, callback: Callable[[AccessUnit], object], *, name: str) -> CallbackTap:
        """Call a function with every coded picture from now on, in a thread of its own; see `CallbackTap`.

        The receiver must have been started; else the tap is over at once.

        Returns:
            Close it, or use it as a context. It ends with the receiver, too.
        """
        tap = Tap(Keeping(self._stream.tally))
        self._join(tap)
        return CallbackTap(tap, callback, name, self._leave)

    def facts(self) -> Facts:
        """Return what is known now, for `why`."""
        (before_ns, before), _ = self._marks
        counts = self.counts
        socket = self._socket
        return Facts(
            started_ns=self._started_ns,
            port=self.port,
            payload_type=self.settings.payload_type,
            sources=None if self._sources is None else tuple(sorted(self._sources)),
            asked_bytes=self.settings.receive_buffer_bytes,
            granted_bytes=self.settings.receive_buffer_bytes if socket is None else socket.granted_bytes,
            counts=counts,
            recent=counts.since(before),
            recent_since_ns=before_ns,
            stream=self._stream.facts(),
            error="" if self._error is None else repr(self._error),
        )

    def why(self) -> tuple[Finding, ...]:
        """Return what is wrong now, in words; empty when nothing is."""
        return why(self.facts(), time.monotonic_ns())

    def _live_tap(self) -> Tap:
        with self._taps_change:
            live = self._live
            if live is None:
                live = self._live = Tap(Live(self._stream.tally, self.settings.max_age_ns))
                if self._thread is None or self._error is not None:
                    live.close(self._error)
                self._taps = (*self._taps, live)
        return live

    def _join(self, tap: Tap) -> None:
        with self._taps_change:
            if self._thread is None or self._error is not None:
                tap.close(self._error)
            self._taps = (*self._taps, tap)

    def _leave(self, tap: Tap) -> None:
        with self._taps_change:
            self._taps = tuple(other for other in self._taps if other is not tap)

    def _close_taps(self, error: BaseException | None) -> None:
        with self._taps_change:
            taps = self._taps
        for tap in taps:
            tap.close(error)

    def _run(self, socket: UdpSocket, stream: Stream) -> None:
        try:
            self._receive(socket, stream)
        except BaseException as error:
            self._error = error
            self._close_taps(error)
            raise
        finally:
            socket.close()

    def _receive(self, socket: UdpSocket, stream: Stream) -> None:
        dropped, asked_ns = 0, 0
        while not self._is_stopping:
            received = socket.receive()
            now_ns = time.monotonic_ns()
            units = stream.expire(now_ns) if received is None else stream.receive(*received, now_ns)
            if units:
                taps = self._taps
                for unit in units:
                    for tap in taps:
                        tap.put(unit)
            if now_ns - asked_ns >= DROPPED_EVERY_NS:
                asked_ns, before = now_ns, dropped
                dropped = socket.dropped()
                stream.tally.add(kernel_dropped=dropped - before)
                if now_ns - self._marks[1][0] >= RECENT_NS:
                    self._marks = self._marks[1], (now_ns, stream.tally.snapshot())
