"""Where the server listens: no peer takes all connections from others, whose stop needs one.

Everywhere those go that wait longest for a request, where there are too many. Beyond loopback no peer has too many in all:
there connections count from the first packet on, also those that say nothing, not even of TLS; of peers that vanished the
kernel tells within half a minute.
"""

from __future__ import annotations

import asyncio
import contextlib
import resource
import socket
from collections import Counter
from typing import Any, ClassVar

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from gateway.web.logins import network_of

__all__ = ["FairListener", "PageProtocol", "RequestProtocol", "open_more_files"]

MOST_OF_ADDRESS = 32
"""Connections; a browser opens six, and one for each page."""
MOST_AT_ONCE = 100
MOST_WAITING = 200
"""Connections without a whole request: new ones, those that were answered, and those that send one bit by bit."""
LEAST_WAIT_S = 0.5
"""None of them goes sooner [s]: what it has sent may not have been read yet."""
ALIVE = {"TCP_KEEPIDLE": 10, "TCP_KEEPINTVL": 5, "TCP_KEEPCNT": 3}
MOST_FILES = 65_536
MOST_UNTAKEN_BYTES = 2**20
"""Answers to pings that a page does not take. States wait for it, 64 kB of them at most."""


def open_more_files() -> None:
    """Let this process open as many files as it may: a crowd is accepted before it is counted."""
    soft, hard = (MOST_FILES if of < 0 else of for of in resource.getrlimit(resource.RLIMIT_NOFILE))
    if soft < min(hard, MOST_FILES):
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, MOST_FILES), hard))


class FairListener(socket.socket):
    """A listening socket that closes what one peer opens too much of, at once.

    Args:
        listener: The socket that listens; it is taken over.
    """

    def __init__(self, listener: socket.socket) -> None:
        super().__init__(fileno=listener.detach())
        self._open: Counter[str] = Counter()

    def accept(self) -> tuple[socket.socket, Any]:
        """Return the next connection of a peer that has not too many, as `socket.accept` does.

        Raises:
            ConnectionAbortedError: There were only others, and maybe there are more.
        """
        for _ in range(MOST_AT_ONCE):
            connection, address = super().accept()
            peer = network_of(address[0])
            if self._open[peer] < MOST_OF_ADDRESS:
                return _Counted(connection, self._open, peer), address
            connection.close()
        raise ConnectionAbortedError


class _Counted(socket.socket):
    def __init__(self, connection: socket.socket, counts: Counter[str], peer: str) -> None:
        super().__init__(fileno=connection.detach())
        self._counts: Counter[str] | None = counts
        self._peer = peer
        counts[peer] += 1
        with contextlib.suppress(OSError):  # gone already
            self.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for name, value in ALIVE.items():
                self.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)

    def close(self) -> None:
        """Close it, and count one less."""
        counts, self._counts = self._counts, None
        super().close()
        if counts is not None:
            counts[self._peer] -= 1
            if not counts[self._peer]:
                del counts[self._peer]


class RequestProtocol(H11Protocol):
    """A connection that makes room for others, whose stop needs one, where it has waited longest for a whole request."""

    _waiting: ClassVar[dict[RequestProtocol, float]] = {}
    """Those of this process, who waits longest first, and since when [s]."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # as its base
        """Take a connection."""
        super().connection_made(transport)
        self._count()

    def data_received(self, data: bytes) -> None:
        """Take what was sent."""
        super().data_received(data)
        self._count()

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        super().on_response_complete()
        self._count()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        super().connection_lost(exc)
        self._count()

    def _count(self) -> None:
        # Of uvicorn's connections it is one until it has ended, or is a page's socket.
        if self not in self.connections or self.conn.their_state not in (h11.IDLE, h11.SEND_BODY):
            self._waiting.pop(self, None)
            return
        now_s = self.loop.time()
        self._waiting.setdefault(self, now_s)
        while len(self._waiting) > MOST_WAITING:
            oldest, since_s = next(iter(self._waiting.items()))
            if now_s - since_s < LEAST_WAIT_S:
                return
            del self._waiting[oldest]
            oldest.transport.abort()


class PageProtocol(WebSocketsSansIOProtocol):
    """A page's socket, which breaks off where it is pinged and the answers are not taken: they would be kept without end."""

    def handle_ping(self) -> None:
        """Answer."""
        super().handle_ping()
        if self.transport.get_write_buffer_size() > MOST_UNTAKEN_BYTES:
            self.transport.abort()
