"""Whether ticks that are missing mean that the daemon hangs, or that it is kept from running. Pure.

On a busy virtual machine one core may get no time for a tenth of a second while the other one does, and on a busy core a
process may wait that long for its turn. A daemon there can do nothing about it, and goes on as soon as it may: ended, it
would take everybody's connection with it. So before the guard judges, it asks whether the daemon could run: the answer
comes at once, or when its core runs again and none of its threads waits for it any more (`core_probe.py`).

Rules (BEHAVIOUR, the guard)
    * A freeze is ticks missing for 80 ms while something is on the wire, of a daemon that could run then.
    * What held up the guard, or the daemon, counts anew from its end: the daemon has had no time to tick.
    * A daemon that is kept from running for long is judged like one that hangs: the robot's own watchdogs have acted by
      then.
"""

from __future__ import annotations

from gateway.core.messages.held import Held

__all__ = ["LATE_NS", "FreezeWatch"]

MS = 1_000_000

LATE_NS = 20 * MS
"""A look, or an answer, that comes later than this after its instant was held up [ns]."""
AHEAD_NS = 30 * MS
"""So long before the verdict is asked for the first time whether the daemon could run [ns]."""
EVERY_NS = 10 * MS
"""And again so often, once it was answered [ns]."""
LAST_NS = 2 * MS
"""The last time so long before the verdict [ns]."""
PATIENCE_NS = 300 * MS
"""A daemon may be kept from running for so long after the verdict was due [ns]."""


class FreezeWatch:
    """Judges one daemon's ticks.

    Attributes:
        look_ns: When to judge next [ns]; 0 before the first time.
        is_asking: Whether is to be asked now if the daemon could run.
    """

    def __init__(self, freeze_ns: int) -> None:
        self._freeze_ns = freeze_ns
        self.look_ns = 0
        self.is_asking = False
        self._late_ns = 0
        """When the guard itself was late last [ns]."""
        self._anew_ns = 0
        """Until when the daemon was kept from running [ns]."""
        self._asked_ns = 0
        self._is_open = False
        """Whether the question of then waits for its answer."""

    def is_frozen(self, held: Held | None, now_ns: int, could_run_ns: int | None = None) -> bool:
        """Return whether the daemon must be ended because it no longer ticks.

        Args:
            held: What it showed last; None before its first tick.
            now_ns: Monotonic time [ns].
            could_run_ns: When it last could run, as far as was asked [ns]; None where nobody can tell.
        """
        self.is_asking = False
        if self.look_ns and now_ns - self.look_ns > LATE_NS:
            self._late_ns = now_ns
        if could_run_ns is None:
            self._is_open = False
        elif self._is_open and could_run_ns >= self._asked_ns:
            self._is_open = False
            if could_run_ns - self._asked_ns > LATE_NS:
                self._anew_ns = could_run_ns
        if held is None or not held.is_sending:
            self._is_open = False
            self.look_ns = now_ns + self._freeze_ns
            return False
        begun_ns = max(held.at_ns, self._late_ns)
        due_ns, end_ns = max(begun_ns, self._anew_ns) + self._freeze_ns, begun_ns + self._freeze_ns + PATIENCE_NS
        if could_run_ns is None:
            self.look_ns = max(due_ns, now_ns + MS)
            return now_ns >= due_ns
        if now_ns < due_ns - AHEAD_NS:
            self._is_open = False
            self.look_ns = max(min(due_ns - AHEAD_NS, end_ns), now_ns + MS)
            return now_ns >= end_ns
        last_ns = due_ns - LAST_NS
        if not self._is_open and now_ns >= due_ns and self._asked_ns >= last_ns:
            self.look_ns = now_ns + MS
            return True
        if not self._is_open:
            self._asked_ns, self._is_open, self.is_asking = now_ns, True, True
        next_ns = due_ns if now_ns >= last_ns else min(last_ns, now_ns + EVERY_NS)
        self.look_ns = max(min(next_ns, end_ns), now_ns + MS)
        return now_ns >= end_ns
