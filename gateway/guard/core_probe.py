"""Asks whether another process could run: its core, by a thread of ours put there and above it, and the kernel.

The thread waits for a question and says when it came to answer. On a core that a busy host has taken away it answers when
the core is given back, like everything else there. It holds nothing meanwhile: it is waiting outside the interpreter. A
core that answers may still be busy with others: whether threads of the process wait for it, `starvation.py` knows.
"""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path

from gateway.guard.starvation import Starvation
from gateway.process.cores import LinuxAffinity
from gateway.process.threads import supervised

__all__ = ["CoreProbe"]

MS = 1_000_000
PROCESSOR = 37
"""Place of the core a thread ran on in /proc/PID/stat, counted from the state behind its name (proc_pid_stat(5), field 39)."""


class CoreProbe:
    """Answers for the process, and for the core that it is bound to or was last seen on.

    `priority` is that of the process's most urgent thread; without `starvation` it is as the kernel says.
    """

    def __init__(self, pid: int, affinity: LinuxAffinity, priority: int, starvation: Starvation | None = None) -> None:
        self._pid, self._affinity = pid, affinity
        self._priority = min(priority + 1, 99)
        self._starvation = Starvation(pid) if starvation is None else starvation
        self._asked_ns = self._ran_ns = self._waited_ns = self._answered_ns = self._runnable = 0
        self._reader, self._writer = os.pipe()
        self._is_closing = False
        self._thread = supervised(self._answer, "core-probe", may_return=lambda: self._is_closing)
        self._thread.start()

    def ask(self) -> None:
        """Ask; `ran_ns` is at least the present time as soon as the process could run. Never waits."""
        thread_id = self._thread.native_id
        core = self._core()
        if core is None or thread_id is None:
            return
        self._asked_ns = self._waited_ns = time.monotonic_ns()
        self._runnable = self._starvation.ask()
        try:
            self._affinity.keep(thread_id, {core})
        except OSError:  # a core that was taken away: nothing can be said of it
            self._ran_ns = time.monotonic_ns()
            return
        with contextlib.suppress(OSError, AttributeError):  # then the process has no more rights than this one
            os.sched_setscheduler(thread_id, os.SCHED_FIFO, os.sched_param(self._priority))
        os.write(self._writer, b"?")

    def ran_ns(self) -> int | None:
        """Return when the process last could run, as far as it was asked [ns], 0 before; None when nobody knows its core."""
        if self._core() is None:
            return None
        if self._answered_ns < self._asked_ns <= self._ran_ns:
            now_ns = time.monotonic_ns()
            if self._starvation.is_over():
                self._answered_ns = max(self._ran_ns, self._waited_ns)
            else:
                self._waited_ns = now_ns
        return self._answered_ns

    def account(self, now_ns: int) -> str:
        """Return in words what was asked last and when it was answered."""
        times_ns = {"asked": self._asked_ns, "its core ran": self._ran_ns, "it could run": self._answered_ns}
        said = [f"{what} {(now_ns - at_ns) / MS:.1f} ms ago" for what, at_ns in times_ns.items() if at_ns]
        return ", ".join([*said, f"{self._runnable} threads runnable then"] if said else ["its core was not asked"])

    def close(self) -> None:
        """End the thread."""
        self._is_closing = True
        os.close(self._writer)
        self._thread.join(1.0)

    def _core(self) -> int | None:
        try:
            cores = self._affinity.cores(self._pid)
            if len(cores) == 1:
                return next(iter(cores))
            return int(Path(f"/proc/{self._pid}/stat").read_bytes().rpartition(b")")[2].split()[PROCESSOR - 1])
        except (OSError, ValueError, IndexError):  # it has ended, or nothing is said of it here
            return None

    def _answer(self) -> None:
        while os.read(self._reader, 64):
            self._ran_ns = time.monotonic_ns()
        os.close(self._reader)
