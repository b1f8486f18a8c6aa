"""Where the server listens beyond loopback: no peer takes all connections from others, whose stop needs one.

Connections count from the first packet on, also those that say nothing, not even of TLS; of peers that vanished the kernel
tells within half a minute.
"""

from __future__ import annotations

import contextlib
import resource
import socket
from collections import Counter
from typing import Any

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from gateway.web.logins import network_of

__all__ = ["FairListener", "PageProtocol"]

MOST_OF_ADDRESS = 32
"""Connections; a browser opens six, and one for each page."""
MOST_AT_ONCE = 100
ALIVE = {"TCP_KEEPIDLE": 10, "TCP_KEEPINTVL": 5, "TCP_KEEPCNT": 3}
MOST_FILES = 65_536
MOST_UNTAKEN_BYTES = 2**20
"""Answers to pings that a page does not take. States wait for it, 64 kB of them at most."""


class FairListener(socket.socket):
    """A listening socket that closes what one peer opens too much of, at once.

    Args:
        listener: The socket that listens; it is taken over.
    """

    def __init__(self, listener: socket.socket) -> None:
        super().__init__(fileno=listener.detach())
        self._open: Counter[str] = Counter()
        soft, hard = (MOST_FILES if of < 0 else of for of in resource.getrlimit(resource.RLIMIT_NOFILE))
        if soft < min(hard, MOST_FILES):
            resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, MOST_FILES), hard))

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


class PageProtocol(WebSocketsSansIOProtocol):
    """A page's socket, which breaks off where it is pinged and the answers are not taken: they would be kept without end."""

    def handle_ping(self) -> None:
        """Answer."""
        super().handle_ping()
        if self.transport.get_write_buffer_size() > MOST_UNTAKEN_BYTES:
            self.transport.abort()
