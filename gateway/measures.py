"""Takes the real-time measures of a process that commands the robot, and says what became of each."""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable

from gateway.cores import LinuxAffinity, OneCore
from gateway.realtime import FifoScheduling, Linux, calm_interpreter, lock_memory, sharpen_timer
from gateway.settings import Settings

__all__ = ["take_measures"]

_log = logging.getLogger(__name__)


def take_measures(settings: Settings, *, is_guard: bool = False) -> Callable[[], None]:
    """Take what is permitted, for the calling thread as the loop's; return what is to be done after a new link.

    Args:
        settings: Say which are wanted.
        is_guard: Whether this process must run even when the daemon spins: then it keeps all cores.
    """
    kernel = Linux()
    measures = [sharpen_timer(kernel), calm_interpreter()]
    if settings.realtime.lock_memory:
        measures.append(lock_memory(kernel))
    fifo = FifoScheduling(kernel, settings.realtime.fifo_priority, threading.get_native_id())
    if settings.realtime.fifo:
        measures.append(fifo.apply())
    together = OneCore(LinuxAffinity(), os.getpid())
    if fifo.active and settings.realtime.one_core and not is_guard:
        measures.append(together.apply())
    for measure in measures:
        _log.info("%s", measure.line)

    def after_link_up() -> None:
        if fifo.active and not (measure := fifo.refresh()).taken:
            _log.warning("%s", measure.line)
        if together.active:
            if fifo.active:
                together.apply()
            else:
                together.undo()

    return after_link_up
