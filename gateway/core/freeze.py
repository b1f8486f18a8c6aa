"""Whether ticks that are missing mean that the daemon hangs, or that the core it runs on stands still. Pure.

On a busy virtual machine one core may get no time for a tenth of a second while the other one does. A daemon there can
do nothing about it, and goes on as soon as the core does: ended, it would take everybody's connection with it. So before
the guard judges, it asks the daemon's core: a thread of its own, bound to it and above the daemon, answers at once or as
late as the core runs again.

Rules (BEHAVIOUR, the guard)
    * A freeze is ticks missing for 80 ms while something is on the wire, on a core that answers.
    * What held up the guard, or the core, counts anew from its end: the daemon has had no time to tick.
    * A core that stays silent for long is judged like a hanging daemon: the robot's own watchdogs have acted by then.
"""

from __future__ import annotations

from gateway.core.held import Held

__all__ = ["LATE_NS", "FreezeWatch"]

MS = 1_000_000

LATE_NS = 20 * MS
"""A look, or an answer of the core, that comes later than this after its instant was held up [ns]."""
AHEAD_NS = 30 * MS
"""So long before the verdict the core is asked for the first time [ns]."""
EVERY_NS = 10 * MS
"""And again so often, once it has answered [ns]."""
PATIENCE_NS = 300 * MS
"""A core may be silent for so long after the verdict was due [ns]."""


class FreezeWatch:
    """Judges one daemon's ticks.

    Args:
        freeze_ns: Ticks missing for so long are a freeze [ns].

    Attributes:
        look_ns: When to judge next [ns]; 0 before the first time.
        is_asking: Whether the daemon's core is to be asked now.
    """

    def __init__(self, freeze_ns: int) -> None:
        self._freeze_ns = freeze_ns
        self.look_ns = 0
        self.is_asking = False
        self._anew_ns = 0
        self._asked_ns: int | None = None

    def is_frozen(self, held: Held | None, now_ns: int, core_ran_ns: int | None = None) -> bool:
        """Return whether the daemon must be ended because it no longer ticks.

        Args:
            held: What it showed last; None before its first tick.
            now_ns: Monotonic time [ns].
            core_ran_ns: When its core last answered [ns]; None when it is bound to no core that could be asked.
        """
        self.is_asking = False
        if self.look_ns and now_ns - self.look_ns > LATE_NS:
            self._anew_ns = now_ns
        if self._asked_ns is not None and (core_ran_ns is None or core_ran_ns >= self._asked_ns):
            if core_ran_ns is not None and core_ran_ns - self._asked_ns > LATE_NS:
                self._anew_ns = max(self._anew_ns, core_ran_ns)
            self._asked_ns = None
        is_sending = held is not None and held.is_sending
        since_ns = max(held.at_ns, self._anew_ns) if held is not None and is_sending else now_ns
        due_ns = since_ns + self._freeze_ns
        ahead_ns = AHEAD_NS if is_sending and core_ran_ns is not None else 0
        if ahead_ns == 0 or now_ns < due_ns - ahead_ns:
            self._asked_ns = None
            self.look_ns = max(due_ns - ahead_ns, now_ns + MS)
            return now_ns >= due_ns
        if self._asked_ns is not None:
            self.look_ns = max(min(due_ns, now_ns + EVERY_NS), now_ns + MS)
            return now_ns >= due_ns + PATIENCE_NS
        if now_ns >= due_ns:
            self.look_ns = now_ns + MS
            return True
        self._asked_ns, self.is_asking = now_ns, True
        self.look_ns = min(due_ns, now_ns + EVERY_NS)
        return False
