"""Closes the connection of a session that was dropped without `close`; a robot that it owned is left held."""

from __future__ import annotations

import atexit
import os
from collections.abc import Callable

from gateway.client.connection.transport import Transport
from gateway.process.threads import supervised

__all__ = ["close_forgotten"]

CLOSING_S = 3.0
"""So long Python waits at its end for a connection that is being closed [s]: usual are milliseconds."""


def close_forgotten(transport: Transport, beating: list[Callable[[], None]], pid: int) -> None:
    """Close a connection from a thread of its own.

    The last reference may go anywhere, also in the middle of a callback of the transport. Python waits for the thread before
    it ends: one that came back from zenoh afterwards would abort the process (`over_zenoh.Pulse`).

    In another process than the one that connected nothing is done.
    """
    if os.getpid() != pid:
        return

    def close() -> None:
        for stop in list(beating):
            stop()
        transport.close()
        atexit.unregister(thread.join)

    thread = supervised(close, "ta2-close")
    atexit.register(thread.join, CLOSING_S)
    try:
        thread.start()
    except RuntimeError:  # the interpreter is ending, and the connection with it
        atexit.unregister(thread.join)
