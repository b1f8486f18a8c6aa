"""An absolute time grid: instants k·period of the monotonic clock, skipped when missed, never caught up.

Instants are multiples of the period from the clock's origin, so streams of commensurate rates share wake-ups (100 Hz
arms, 50 Hz grippers, 20 Hz heartbeat) and a 70 Hz stream still gets intervals of one length, 14.29 ms.
"""

from __future__ import annotations

__all__ = ["Grid"]

S = 1_000_000_000


class Grid:
    """Which instants of a fixed rate have come.

    Args:
        rate_hz: Instants per second; need not divide a second evenly.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._index = -1
        self._next_ns = 0  # instant of the next index: asked for many times before it comes

    def _instant(self, index: int) -> int:
        return round(index * S / self._rate_hz)

    def _index_at(self, now_ns: int) -> int:
        index = int(now_ns * self._rate_hz // S)  # one too low beside a rounded instant, one too high after 100 days up
        while self._instant(index + 1) <= now_ns:
            index += 1
        while self._instant(index) > now_ns:
            index -= 1
        return index

    def start(self, now_ns: int) -> None:
        """Make the grid's first due instant the latest one not after `now_ns`: due at once."""
        index = self._index_at(now_ns)
        self._index, self._next_ns = index - 1, self._instant(index)

    def due(self, now_ns: int) -> int | None:
        """Return the instant that is due, or None. Each instant is given once; of several missed ones only the newest."""
        due_ns = self._next_ns
        if now_ns < due_ns:
            return None
        index = self._index + 1
        next_ns = self._instant(index + 1)
        if next_ns <= now_ns:
            index = self._index_at(now_ns)
            due_ns, next_ns = self._instant(index), self._instant(index + 1)
        self._index, self._next_ns = index, next_ns
        return due_ns

    def next_ns(self) -> int:
        """Return the next instant that has not been given [ns]."""
        return self._next_ns
