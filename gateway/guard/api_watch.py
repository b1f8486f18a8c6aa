"""The guard's look at the daemon's API: whether somebody answers at its socket although the control loop ticks.

A thread asks once a second on a key that passes what a stop passes: zenoh's session, a callback, and the thread that answers
stops. Floods of other requests pass none of the last, and a daemon that does not tick is judged by `core/handover/freeze.py`.

Rules
    * Nothing counts before the first answer, or before the daemon commands anything, which somebody asked for: it opens its
      socket after it has started its guard.
    * A question without an answer counts only where the host explains nothing: this thread asked and gave up on time, and
      the daemon ticked. Else counting begins anew.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable
from pathlib import Path

import zenoh

from gateway.api import protocol
from gateway.core.messages.held import Held
from gateway.process.threads import supervised

__all__ = ["END_MISSES", "SILENT_MISSES", "ApiWatch"]

MS = 1_000_000
PERIOD_S = 1.0
"""Between an answer and the next question [s]."""
PATIENCE_S = 1.0
"""So long one answer may take [s]."""
LATE_NS = 300 * MS
"""A question that took this much longer than it may was held up, here [ns]."""
TICKING_NS = 300 * MS
"""A daemon ticks whose last tick is not older [ns]; at rest there are 50 ms between them."""
SILENT_MISSES = 5
"""So many questions in a row without an answer, and the daemon is told that its API is silent: 5 s and more."""
END_MISSES = 15
"""So many, and it is ended: it had 10 s to do so by itself, and needs 5 at most."""

_log = logging.getLogger(__name__)


class ApiWatch:
    """Asks a daemon's socket again and again, from a thread of its own.

    Args:
        socket: Of the daemon.
        shown: Returns what the daemon showed last; None before its first tick.

    Attributes:
        misses: Questions in a row that nobody answered.
    """

    def __init__(self, socket: Path, shown: Callable[[], Held | None]) -> None:
        self.misses = 0
        self._socket = socket
        self._shown = shown
        self._session: zenoh.Session | None = None
        self._was_open = False
        self._closing = threading.Event()
        self._thread = supervised(self._watch, "api-watch", may_return=self._closing.is_set)

    def start(self) -> None:
        """Begin to ask."""
        self._thread.start()

    def close(self) -> None:
        """End; does not wait for the thread, which may hang in zenoh. Nobody asks any more, and nothing counts."""
        self._closing.set()

    def _watch(self) -> None:
        while not self._closing.wait(PERIOD_S if self.misses == 0 else 0.0):
            began_ns = time.monotonic_ns()
            is_answered = self._ask()
            if self._closing.is_set():  # nobody wants to know any more: the daemon is being ended
                return
            now_ns = time.monotonic_ns()
            is_late = now_ns - began_ns > PATIENCE_S * 1000 * MS + LATE_NS
            held = self._shown()
            is_ticking = held is not None and now_ns - held.at_ns < TICKING_NS
            self._was_open |= is_answered or (held is not None and held.is_sending)
            if is_answered or is_late or not is_ticking or not self._was_open:
                self.misses = 0
                continue
            self.misses += 1
            _log.warning("the daemon ticks and its API did not answer within %.0f s (%d)", PATIENCE_S, self.misses)
            self._closing.wait(max(0.0, PATIENCE_S - (now_ns - began_ns) / 1e9))  # refused at once: still one a second

    def _ask(self) -> bool:
        """Ask once; return whether there was an answer."""
        try:
            if self._session is None:
                if not self._socket.exists():
                    return False
                self._session = zenoh.open(_configuration(self._socket))
            replies = self._session.get(protocol.PING_KEY, timeout=PATIENCE_S)
            return any(reply.ok is not None for reply in replies)
        except zenoh.ZError as error:
            _log.debug("the daemon's API cannot be asked: %s", error)
            return False


def _configuration(socket: Path) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in {
        "mode": "client",
        "connect/endpoints": [f"unixsock-stream/{socket}"],
        "connect/timeout_ms": round(PATIENCE_S * 1000),
        "connect/exit_on_failure": True,
        "listen/endpoints": [],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return config
