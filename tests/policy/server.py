"""A policy's server for tests, by websockets and msgpack as openpi's own are: real sockets on loopback, scripted answers."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np
from websockets.sync.server import Server, ServerConnection, serve

__all__ = ["Scripted", "packed"]


def packed(values: object) -> bytes:
    """Return a frame as openpi packs it."""

    def as_map(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            data = value.tobytes() if value.dtype.kind != "O" else b"\x80\x04N."
            return {b"__ndarray__": True, b"data": data, b"dtype": value.dtype.str, b"shape": value.shape}
        if isinstance(value, np.generic):
            return {b"__npgeneric__": True, b"data": value.item(), b"dtype": value.dtype.str}
        raise TypeError(type(value))

    return msgpack.packb(values, default=as_map)


def unpacked(frame: bytes) -> Any:
    """Return what a frame holds, as openpi reads it."""

    def revive(value: Any) -> Any:
        if b"__ndarray__" in value:
            return np.ndarray(buffer=value[b"data"], dtype=np.dtype(value[b"dtype"]), shape=value[b"shape"])
        return value

    return msgpack.unpackb(frame, object_hook=revive)


class Scripted:
    """Serves until it is closed.

    Args:
        policy: Observation to answer: a map, or a frame as it is (bytes, or text for a traceback); None hangs up.
        metadata: Sent first, the same.
        port: To serve on; 0 takes a free one.
    """

    def __init__(self, policy: Callable[[Any], Any], metadata: Any = None, port: int = 0) -> None:
        self._policy, self.metadata = policy, {"fps": 30} if metadata is None else metadata
        self.seen: list[Any] = []
        self.headers: list[Any] = []
        self._connections: list[ServerConnection] = []
        self._server: Server = serve(self._serve, "127.0.0.1", port, compression=None, max_size=None)
        self.port = self._server.socket.getsockname()[1]
        self.url = f"ws://127.0.0.1:{self.port}"
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def _serve(self, connection: ServerConnection) -> None:
        self._connections.append(connection)
        self.headers.append(connection.request.headers)
        if not self._send(connection, self.metadata):
            return
        for frame in connection:
            self.seen.append(unpacked(frame))
            if not self._send(connection, self._policy(self.seen[-1])):
                return

    def _send(self, connection: ServerConnection, what: Any) -> bool:
        """Send something; return whether the connection goes on."""
        if what is not None:
            connection.send(what if isinstance(what, (bytes, str)) else packed(what))
        if isinstance(what, str):
            connection.close(1011, "Internal server error. Traceback included in previous frame.")
        return what is not None and not isinstance(what, str)

    def close(self) -> None:
        """End it as a killed process would: every connection is torn."""
        self._server.shutdown()
        for connection in self._connections:
            with contextlib.suppress(OSError):  # it is gone already
                connection.socket.shutdown(socket.SHUT_RDWR)
        self._thread.join(5.0)
