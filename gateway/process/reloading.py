"""Reads the settings file anew when it is asked for, in a thread of its own: the control loop takes what was found.

Rules
    * One reading at a time, a second apart at least: however often it is asked for, one more is enough.
    * It runs below all other threads: on their core a parser at their priority would keep the robot's samples waiting. It runs
      above other processes: it holds the interpreter, which the loop needs.
    * A thread that ends unasked is begun anew once, and told with its reason. No robot stops because nobody reads a file.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections import deque
from collections.abc import Callable

from gateway.core.messages.events import SettingsRead
from gateway.errors import GatewayError
from gateway.process.threads import supervised
from gateway.settings.reloading import changes, marks
from gateway.settings.settings import Settings

__all__ = ["Reloader", "has_terminal"]

APART_S = 1.0
"""Between two readings [s]."""
MOST_TEXT = 600
"""So much of a message is told: it may quote a file that is none."""
ENDED = "what reads them has ended twice; start the gateway anew while nothing moves"


class Reloader:
    """Reads the settings anew.

    Args:
        settings: Those of the start.
        read: Reads them, as they were read then.
        apart_s: Between two readings [s].
    """

    def __init__(self, settings: Settings, read: Callable[[], Settings], apart_s: float = APART_S) -> None:
        self._began = self._running = settings
        self._files = marks(settings)
        self._read, self._apart_s = read, apart_s
        self._found: deque[tuple[SettingsRead, Settings | None]] = deque()
        self._is_asked, self._is_closing = threading.Event(), threading.Event()
        self._thread = supervised(
            self._run,
            "settings",
            may_return=self._is_closing.is_set,
            again=True,
            on_lost=lambda lost: self._refuse(str(lost)),
        )
        self._thread.start()

    def ask(self) -> None:
        """Have the file read, soon. Never waits."""
        self._is_asked.set()
        if not self._thread.is_alive():
            self._refuse(ENDED)

    def take(self) -> list[tuple[SettingsRead, Settings | None]]:
        """Return what was read since the last call, with the settings that are in force where it is taken. Never waits."""
        return [self._found.popleft() for _ in range(len(self._found))]

    def close(self) -> None:
        """Read no more; a disk that hangs is left to itself."""
        self._is_closing.set()
        self._is_asked.set()

    def _run(self) -> None:
        while self._is_asked.wait() and not self._is_closing.is_set():
            self._is_asked.clear()
            self._look()
            self._is_closing.wait(self._apart_s)

    def _look(self) -> None:
        with contextlib.suppress(OSError, AttributeError):  # not permitted, or not there
            if os.sched_getscheduler(0) == os.SCHED_FIFO:
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        try:
            fresh = self._read()
            now = marks(fresh)
            changed = [name for name, mark in self._files.items() if now[name] != mark]
            values, words = changes(self._began, self._running, fresh, changed)
        except GatewayError as error:
            self._refuse(f"{error.message}; {error.hint}" if error.hint else error.message)
            return
        self._found.append((SettingsRead(values=values, message=words, at_ns=time.monotonic_ns()), fresh))
        self._running = fresh

    def _refuse(self, why: str) -> None:
        message = why[:MOST_TEXT]
        self._found.append((SettingsRead(values={}, message=message, at_ns=time.monotonic_ns(), is_refused=True), None))


def has_terminal() -> bool:
    """Return whether this process has a terminal that is still there: SIGHUP says that it is not, or asks for a reading."""
    try:
        os.close(os.open("/dev/tty", os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC))
    except OSError:
        return False
    return True
