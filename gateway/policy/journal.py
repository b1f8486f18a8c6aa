"""Tells whoever records on this host what a policy wanted and what became of it; where nobody does, nothing happens."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from queue import Full, Queue

from gateway.client.connection.recorder import ask_recorder
from gateway.errors import GatewayError
from gateway.process.threads import supervised

__all__ = ["Journal"]

MOST_WAITING = 100


class Journal:
    """Tells the recorder beside the socket of a gateway (None finds it), in a thread of its own; `mode` is said each time."""

    def __init__(self, address: str | None, mode: str) -> None:
        self._address, self._mode = address, mode
        self._queue: Queue[Mapping[str, object] | None] = Queue(MOST_WAITING)
        self._thread = supervised(self._run, "ta2-policy-journal")
        self._thread.start()

    def note(self, facts: Mapping[str, object]) -> None:
        """Have facts told; never waits, and leaves them out where a recorder hangs."""
        with suppress(Full):
            self._queue.put_nowait({"mode": self._mode, **facts})

    def close(self) -> None:
        """Tell what is left, for a few seconds at most."""
        with suppress(Full):
            self._queue.put(None, timeout=2.0)
            self._thread.join(2.0)

    def _run(self) -> None:
        while (facts := self._queue.get()) is not None:
            with suppress(GatewayError):  # nobody records, or not now
                ask_recorder(self._address, "policy", facts=facts)
