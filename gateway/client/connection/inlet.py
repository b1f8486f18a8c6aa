"""Where a transport delivers, without holding the client alive: a client that nobody uses any more can be closed.

Transports are held by threads that Python does not see, and hold their receiver. If that were the session itself, a client
that was dropped without `close()` (a notebook cell that ran twice) would stay connected for as long as the process lives.
"""

from __future__ import annotations

import weakref

from gateway.client.connection.transport import Receiver

__all__ = ["Inlet"]


class Inlet:
    """Hands on what a transport delivers, while there is somebody to take it.

    Args:
        receiver: Who takes it; held weakly.
    """

    def __init__(self, receiver: Receiver) -> None:
        self._receiver = weakref.ref(receiver)

    def on_snapshot(self, payload: bytes, seq: int, received_ns: int) -> None:
        """Hand on a snapshot."""
        receiver = self._receiver()
        if receiver is not None:
            receiver.on_snapshot(payload, seq, received_ns)

    def on_notice(self, payload: bytes, number: int) -> None:
        """Hand on a notice."""
        receiver = self._receiver()
        if receiver is not None:
            receiver.on_notice(payload, number)

    def on_daemon(self, token: str, alive: bool) -> None:
        """Hand on that a daemon's token came or went."""
        receiver = self._receiver()
        if receiver is not None:
            receiver.on_daemon(token, alive)
