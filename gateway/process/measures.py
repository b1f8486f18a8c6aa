"""Takes the real-time measures of a process that commands the robot, says what became of each, and undoes them at its end.

Rules it obeys
    * A process leaves real time before it takes itself to pieces. Freeing some 40,000 objects keeps its core for 0.15 s and
      more: at the priority of a loop that is as long without a tick for every other daemon on that core, whose guards then
      take them for frozen, since a core that something urgent runs on answers.
"""

from __future__ import annotations

import logging
import os
import threading

from gateway.process.cores import LinuxAffinity, OneCore
from gateway.process.realtime import (
    FifoScheduling,
    Linux,
    calm_interpreter,
    lock_memory,
    release_interpreter,
    sharpen_timer,
)
from gateway.settings.settings import Settings

__all__ = ["Measures"]

_log = logging.getLogger(__name__)


class Measures:
    """The measures of this process. Make it in the thread of the loop.

    Args:
        settings: Say which are wanted.
        is_guard: Whether this process must run even when the daemon spins: then it keeps all cores.
    """

    def __init__(self, settings: Settings, *, is_guard: bool = False) -> None:
        self._wanted = settings.realtime
        self._is_guard = is_guard
        self._kernel = Linux()
        self._fifo = FifoScheduling(self._kernel, self._wanted.fifo_priority, threading.get_native_id())
        self._together = OneCore(LinuxAffinity(), os.getpid())

    def take(self) -> None:
        """Take what is permitted, and tell."""
        measures = [sharpen_timer(self._kernel), calm_interpreter()]
        if self._wanted.lock_memory:
            measures.append(lock_memory(self._kernel))
        if self._wanted.fifo:
            measures.append(self._fifo.apply())
        if self._fifo.active and self._wanted.one_core and not self._is_guard:
            measures.append(self._together.apply())
        for measure in measures:
            _log.info("%s", measure.line)

    def renew(self) -> None:
        """Bring the threads of a new link to where the others are."""
        if self._fifo.active and not (measure := self._fifo.apply()).taken:
            _log.warning("%s", measure.line)
        if self._together.active:
            if self._fifo.active:
                self._together.apply()
            else:
                self._together.undo()

    def undo(self) -> None:
        """Leave real time, at the end: when the last frame has left and sessions are closed. May be called untaken."""
        self._fifo.undo()
        self._together.undo()
        release_interpreter()
