"""The transport without a network: a client and an engine in one thread, in the engine's time. For tests.

The other half is `tests.memory_plane.MemoryPlane`, known here by its shape only. Waiting pumps: each wait calls
`pump`, which runs the engine for one tick and moves its clock, so that a blocking client needs no second thread.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from gateway.api import protocol
from gateway.client.connection.transport import Receiver

__all__ = ["MemoryTransport", "Plane"]


class Plane(Protocol):
    """What the daemon's half looks like."""

    def join(self, client_id: str, listener: Receiver) -> None:
        """Let a client in."""
        ...

    def leave(self, client_id: str) -> None:
        """Let a client go, as when its token ends."""
        ...

    def ask(self, key: str, payload: bytes, encoding: str, on_done: Callable[[bytes | None], None]) -> None:
        """Ask something."""
        ...

    def put(self, key: str, payload: bytes) -> None:
        """Put a target or a keepalive."""
        ...


@dataclass(slots=True)
class _Beat:
    period_ns: int
    due_ns: int
    call: Callable[[], None]


class MemoryTransport:
    """A way to an engine in this process.

    Args:
        plane: The daemon's half.
        now_ns: The clock of both [ns].
        pump: Runs the engine for one tick and moves the clock.
    """

    def __init__(self, plane: Plane, now_ns: Callable[[], int], pump: Callable[[], None]) -> None:
        self.address = "memory"
        self._plane = plane
        self._now_ns = now_ns
        self._pump = pump
        self._client_id = ""
        self._beats: list[_Beat] = []

    def open(self, client_id: str, receiver: Receiver, timeout_s: float) -> None:
        """Join the plane."""
        self._client_id = client_id
        self._plane.join(client_id, receiver)

    def close(self) -> None:
        """Leave the plane."""
        self._plane.leave(self._client_id)

    def ask(self, key: str, payload: bytes, timeout_s: float, on_done: Callable[[bytes | None], None]) -> None:
        """Ask; the answer comes when the engine was pumped."""
        self._plane.ask(key, payload, protocol.MSGPACK, on_done)

    def drop(self, key: str, payload: bytes) -> None:
        """Drop nothing: there is no pipe."""

    def put(self, key: str, payload: bytes) -> None:
        """Put a target or a keepalive."""
        self._plane.put(key, payload)

    def now_ns(self) -> int:
        """Return the engine's time [ns]."""
        return self._now_ns()

    def wait(self, changed: threading.Condition, timeout_s: float) -> None:
        """Run the engine for one tick instead of waiting, and beat what is due."""
        self._pump()
        self.beat()

    def beat(self) -> None:
        """Beat what is due by now."""
        for beat in list(self._beats):
            if self._now_ns() >= beat.due_ns:
                beat.due_ns += beat.period_ns
                beat.call()

    def every(self, period_ns: int, beat: Callable[[], None], on_lost: Callable[[str], None]) -> Callable[[], None]:
        """Call `beat` when time passes, on a grid of `period_ns`; it is never lost."""
        entry = _Beat(period_ns, self._now_ns() + period_ns, beat)
        self._beats.append(entry)

        def stop() -> None:
            if entry in self._beats:
                self._beats.remove(entry)

        return stop
