"""Keeps the threads of a process together on one processor core, where they run above everything else anyway.

A daemon is a dozen threads that wake each other all the time and of which hardly two have something to do at once. Spread
over several cores each of these wake-ups is an interrupt of another core, and whatever one thread has just read must be
fetched again by the next. Measured beside a plain subscriber in the same seconds, two cores, others at work on both:
6.5 % of a core for a daemon at rest against 4.7 % on one core, 14 to 16 % against 12 to 13.5 % with both arms held. The
interval of setpoints at the robot is the same, quiet and under four CPU hogs (99 %: 10.7-10.9 ms against 10.6-11.3 ms).

Rules it obeys
    * Only under SCHED_FIFO: a thread that must wait for its turn like any other is better off where a core is free.
    * Every thread or none; when one cannot be moved, all go back. The process id chooses the core: several daemons of one
      host spread over its cores.
    * Nothing here fails: what is not taken is a `Measure` that says why.

A process that must run when this one spins, its guard, must not inherit the core: see `spread`.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Set as AbstractSet

from gateway.process.realtime import Linux, Measure, require_linux

__all__ = ["LinuxAffinity", "OneCore", "spread"]

NAME = "one core"


class LinuxAffinity(Linux):
    """The running Linux kernel, with the cores of its threads; elsewhere every call raises `OSError`."""

    def cores(self, thread_id: int) -> set[int]:
        """Return the cores of a thread; 0 is the calling one."""
        require_linux()
        return set(os.sched_getaffinity(thread_id))

    def keep(self, thread_id: int, cores: AbstractSet[int]) -> None:
        """Let a thread run on these cores only."""
        require_linux()
        os.sched_setaffinity(thread_id, cores)


class OneCore:
    """Moves all threads of this process to one core.

    Args:
        affinity: Of this process.
        number: Spreads daemons over the cores, e.g. the process id.
    """

    def __init__(self, affinity: LinuxAffinity, number: int) -> None:
        self._affinity = affinity
        self._number = number
        self._before: set[int] = set()
        self.active = False
        """Whether the threads are together now."""

    def apply(self) -> Measure:
        """Move every thread, also those that were born since; when one cannot be moved, put all back."""
        try:
            if not self.active:
                self._before = self._affinity.cores(0)
            cores = sorted(self._before)
            core = cores[-1 - self._number % len(cores)]
            if len(cores) == 1:
                return Measure(name=NAME, taken=False, line=f"{NAME}: not taken, core {core} is the only one")
            self._keep({core})
        except OSError as error:
            self.undo()
            reason = error.strerror or str(error)
            return Measure(
                name=NAME, taken=False, line=f"{NAME}: not taken ({reason}); threads wake each other over all cores"
            )
        self.active = True
        return Measure(name=NAME, taken=True, line=f"{NAME}: all threads on core {core} of {sorted(self._before)}")

    def undo(self) -> None:
        """Let every thread run where the process could before."""
        self.active = False
        if self._before:
            with contextlib.suppress(OSError):  # no list, or a core that is gone: nothing better is known
                self._keep(self._before)

    def _keep(self, cores: AbstractSet[int]) -> None:
        for thread_id in self._affinity.thread_ids():
            with contextlib.suppress(ProcessLookupError):  # it ended between the listing and now
                self._affinity.keep(thread_id, cores)


def spread(affinity: LinuxAffinity) -> None:
    """Let the calling thread, and those that it starts, run on every core: whatever it inherited from who started it."""
    with contextlib.suppress(OSError):  # not available here, so nothing was inherited either
        affinity.keep(0, set(range(os.cpu_count() or 1)))
