"""Closes the connection of a session that was dropped without `close`; a robot that it owned is left held.

What calls it from outside keeps it from being dropped no more than a weak reference does.
"""

from __future__ import annotations

import atexit
import os
import weakref
from collections.abc import Callable
from typing import ParamSpec

from gateway.client.connection.transport import Transport
from gateway.process.threads import supervised

__all__ = ["close_forgotten", "weakly"]

P = ParamSpec("P")

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


def weakly(method: Callable[P, None]) -> Callable[P, None]:
    """Return what calls a bound method as long as somebody else holds its object, and does nothing afterwards."""
    held = weakref.WeakMethod(method)

    def call(*args: P.args, **kwargs: P.kwargs) -> None:
        needed = held()
        if needed is not None:
            needed(*args, **kwargs)

    return call
