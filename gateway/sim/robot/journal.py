"""The robot's own log: what it refused, clipped or noticed, and how often.

The real robot tells nobody why it refused (§4.10, §4.12); neither does this one over its topics. Tests and people
read the journal instead. It reads no clock and prints nothing.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass
from typing import Final

from gateway.sim.robot.manual import S

__all__ = ["Journal", "LogEntry"]

_REPEAT_NS: Final = 1 * S
_KEPT: Final = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class LogEntry:
    """One line of the robot's log.

    Attributes:
        number: 1 for the first entry ever, growing by one.
        now_ns: When it was written, in the robot's stepping time [ns].
        code: Stable upper-case name of what happened.
        text: The values behind it.
    """

    number: int
    now_ns: int
    code: str
    text: str


class Journal:
    """Counts every event by code and keeps the last thousand lines.

    The same code about the same subject is written at most once a second and counted always, so that a refused 100 Hz
    stream does not push everything else out.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.entries: deque[LogEntry] = deque(maxlen=_KEPT)
        self._written = 0
        self._last_ns: dict[tuple[str, str], int] = {}

    def note(self, now_ns: int, code: str, subject: str, text: str = "") -> None:
        """Count an event and write it down unless the same was written less than a second ago."""
        self.counts[code] += 1
        last_ns = self._last_ns.get((code, subject))
        if last_ns is not None and 0 <= now_ns - last_ns < _REPEAT_NS:
            return
        self._last_ns[(code, subject)] = now_ns
        self._written += 1
        line = f"{subject}: {text}" if text else subject
        self.entries.append(LogEntry(number=self._written, now_ns=now_ns, code=code, text=line))

    def codes(self) -> set[str]:
        """Return every code that ever occurred."""
        return set(self.counts)

    def since(self, number: int) -> list[LogEntry]:
        """Return the kept entries with a larger number."""
        return [entry for entry in self.entries if entry.number > number]
