"""Asks the one core that another process is bound to whether it runs: a thread of ours, put there and above that process.

The thread waits for a question and says when it came to answer. On a core that a busy host has taken away it answers when
the core is given back, like everything else there. It holds nothing meanwhile: it is waiting outside the interpreter.
"""

from __future__ import annotations

import contextlib
import os
import time

from gateway.cores import Affinity
from gateway.threads import supervised

__all__ = ["CoreProbe"]


class CoreProbe:
    """A thread that answers from the core of another process.

    Args:
        pid: That process.
        affinity: Of threads to cores.
        priority: SCHED_FIFO priority of that process's most urgent thread.
    """

    def __init__(self, pid: int, affinity: Affinity, priority: int) -> None:
        self._pid, self._affinity = pid, affinity
        self._priority = min(priority + 1, 99)
        self._ran_ns = 0
        self._reader, self._writer = os.pipe()
        self._is_closing = False
        self._thread = supervised(self._answer, "core-probe", may_return=lambda: self._is_closing)
        self._thread.start()

    def ask(self) -> None:
        """Ask; `ran_ns` is at least the present time as soon as the core has answered. Never waits."""
        thread_id = self._thread.native_id
        core = self._core()
        if core is None or thread_id is None:
            return
        try:
            self._affinity.keep(thread_id, {core})
        except OSError:  # a core that was taken away: nothing can be said of it
            self._ran_ns = time.monotonic_ns()
            return
        with contextlib.suppress(OSError, AttributeError):  # then the process has no more rights than this one
            os.sched_setscheduler(thread_id, os.SCHED_FIFO, os.sched_param(self._priority))
        os.write(self._writer, b"?")

    def ran_ns(self) -> int | None:
        """Return when the core last answered [ns], 0 before; None when the process is bound to no single core."""
        return None if self._core() is None else self._ran_ns

    def close(self) -> None:
        """End the thread."""
        self._is_closing = True
        os.close(self._writer)
        self._thread.join(1.0)

    def _core(self) -> int | None:
        try:
            cores = self._affinity.cores(self._pid)
        except OSError:  # it has ended
            return None
        return next(iter(cores)) if len(cores) == 1 else None

    def _answer(self) -> None:
        while os.read(self._reader, 64):
            self._ran_ns = time.monotonic_ns()
        os.close(self._reader)
