"""What a client needs from the outside: bytes to and from a daemon, and time. `over_zenoh` provides it, tests have another.

Rules
    * Callbacks of the receiver may come from any thread, and may come before the call that caused them returns.
    * Time is here too, so that client and engine can be joined in virtual time: nobody else reads a clock or waits.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Protocol

__all__ = ["SPAWN_HINT", "Receiver", "Transport"]

SPAWN_HINT = "begin processes by multiprocessing's spawn, or by subprocess, and connect() there"
"""What a forked process is told: zenoh's threads are not in it, and come in none."""


class Receiver(Protocol):
    """Who gets what the daemon sends."""

    def on_snapshot(self, payload: bytes, seq: int, received_ns: int) -> None:
        """Take a published snapshot; `seq` is its number, `received_ns` its local arrival."""

    def on_notice(self, payload: bytes, number: int) -> None:
        """Take a notice; `number` is its number at the daemon, rising by one from 1 (0: it has none)."""

    def on_daemon(self, token: str, alive: bool) -> None:
        """Learn that a daemon's liveliness token came or went."""


class Transport(Protocol):
    """A way to a daemon.

    Attributes:
        address: What a person would type to get there.
    """

    address: str

    def open(self, client_id: str, receiver: Receiver, timeout_s: float) -> None:
        """Connect, show this client's token, and begin to listen.

        Raises:
            Disconnected: Nobody listens there.
        """

    def close(self) -> None:
        """Disconnect; the daemon sees the token go. May be called again."""

    def ask(self, key: str, payload: bytes, timeout_s: float, on_done: Callable[[bytes | None], None]) -> None:
        """Ask something; `on_done` is called once, with the reply or with None when there will be none.

        With None it must wait for nobody who may be asking: it may come while the link is taken down, under a lock of zenoh's
        that the next question takes.
        """

    def drop(self, key: str, payload: bytes) -> None:
        """Drop a stop where it acts without a session, if there is such a place. Whoever wants to know of it asks, too."""

    def put(self, key: str, payload: bytes) -> None:
        """Send something that needs no answer; lost when the daemon is not there."""

    def now_ns(self) -> int:
        """Return monotonic time [ns]."""

    def wait(self, changed: threading.Condition, timeout_s: float) -> None:
        """Let time pass until `changed` (held by the caller) is notified, at most `timeout_s`."""

    def every(self, period_ns: int, beat: Callable[[], None], on_lost: Callable[[str], None]) -> Callable[[], None]:
        """Call `beat` every `period_ns`, a period from now first, from elsewhere, until the returned function is called.

        Should it end before that, `on_lost` is called with why, once.
        """
