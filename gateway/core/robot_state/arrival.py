"""Arrivals of one topic, counted: how many, how fast, and the longest silence."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from gateway.core.messages.events import SampleArrived

__all__ = ["Meter", "Recent"]

MS = 1_000_000
S = 1_000_000_000

RATE_WINDOW_NS = 2500 * MS
RATE_MARK_NS = 250 * MS
"""Rates are measured over two periods of the slowest topic (1 Hz) with jitter, from one mark of the count per this."""
FIGURES_NS = 100 * MS
"""Rate and worst gap for views are computed this often [ns]."""


class Recent:
    """The extreme of a quantity over the last ten buckets of time."""

    __slots__ = ("_bucket_ns", "_buckets", "_pick")

    def __init__(self, pick: Callable[[int, int], int], bucket_ns: int) -> None:
        self._pick = pick
        self._bucket_ns = bucket_ns
        self._buckets: deque[tuple[int, int]] = deque(maxlen=10)  # (bucket, extreme in it)

    def add(self, at_ns: int, quantity: int) -> None:
        """Take a quantity in."""
        bucket = at_ns // self._bucket_ns
        if self._buckets and self._buckets[-1][0] == bucket:
            self._buckets[-1] = (bucket, self._pick(self._buckets[-1][1], quantity))
        else:
            self._buckets.append((bucket, quantity))

    def extreme(self, now_ns: int, start: int) -> int:
        """Return the extreme of `start` and of what was added lately."""
        oldest = now_ns // self._bucket_ns - 10
        for bucket, quantity in self._buckets:
            if bucket > oldest:
                start = self._pick(start, quantity)
        return start


class Meter:
    """Counters, rate and worst gap of one topic. Every arrival counts here, believed or not."""

    __slots__ = ("_figures", "_gaps", "_last_ns", "_marks", "count", "duplicates", "refused")

    def __init__(self) -> None:
        self.count = 0
        self.duplicates = 0
        self.refused = 0
        self._last_ns: int | None = None
        self._marks: deque[tuple[int, int]] = deque(maxlen=RATE_WINDOW_NS // RATE_MARK_NS)  # (arrival, count at it)
        self._gaps = Recent(max, 1 * S)
        self._figures: tuple[int, float, int] | None = None  # (when computed, rate, worst gap)

    def add(self, event: SampleArrived, at_ns: int) -> None:
        """Count what arrived at `at_ns` [ns]."""
        self.count += event.count
        self.duplicates += event.duplicates
        self._gaps.add(at_ns, event.worst_gap_ns or (at_ns - self._last_ns if self._last_ns is not None else 0))
        self._last_ns = at_ns
        if not self._marks or at_ns - self._marks[-1][0] >= RATE_MARK_NS:
            self._marks.append((at_ns, self.count))

    def rate_hz(self, now_ns: int) -> float:
        """Return samples per second between arrivals; up to now once more than two periods are missing."""
        for at_ns, count in self._marks:
            if self._last_ns is not None and now_ns - RATE_WINDOW_NS <= at_ns < self._last_ns:
                arrived, span_ns = self.count - count, self._last_ns - at_ns
                if now_ns - self._last_ns > 2 * span_ns // arrived:
                    span_ns = now_ns - at_ns
                return arrived * S / span_ns
        return 0.0

    def worst_gap_ns(self, now_ns: int) -> int:
        """Return the longest silence of the last 10 s, the present one included [ns]."""
        return self._gaps.extreme(now_ns, 0 if self._last_ns is None else now_ns - self._last_ns)

    def figures(self, now_ns: int) -> tuple[float, int]:
        """Return rate [Hz] and worst gap [ns] for views: computed ten times a second, however often they are asked."""
        figures = self._figures
        if figures is None or not 0 <= now_ns - figures[0] < FIGURES_NS:
            self._figures = figures = now_ns, self.rate_hz(now_ns), self.worst_gap_ns(now_ns)
        return figures[1], figures[2]
