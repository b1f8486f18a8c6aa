"""How long after their stamps messages arrive: the clock of who sent them against the recording host's, and whether it was set.

Arrival jitters with the network, a delay below the smallest does not: it changes with a clock alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Final

from gateway.recording.topics import NEVER_NS

__all__ = ["WINDOW_NS", "Delays", "Least", "merged", "step_ns", "widened"]

LOOK_NS: Final = 1_000_000_000
"""A clock that was set is looked for in windows of so long [ns]: in a bag's first and last one it does not show."""
WINDOW_NS: Final = 10 * LOOK_NS
"""Of so long the smallest delay tells how far two clocks are apart [ns]."""
STEP_NS: Final = 50_000_000
"""A smallest delay that changes by more from one window to the next is a clock that was set [ns]; 200 ppm are 0.2 ms."""

Least = Mapping[int, int]
"""Windows, as numbers of their lengths since 1970, and the smallest arrival minus stamp in each [ns], in their order."""


class Delays:
    """The smallest delays of one topic while it is read, in windows of `LOOK_NS`.

    A single stamp that is ahead of those around it is no delay: one takes another one beside it.
    """

    __slots__ = ("_before_ns", "least")

    def __init__(self) -> None:
        self.least: dict[int, int] = {}
        self._before_ns: int | None = None

    def add(self, arrival_ns: int, stamp_ns: int) -> None:
        """Take the next message, in the order of arrival [ns]."""
        delay_ns = arrival_ns - stamp_ns
        before_ns, self._before_ns = self._before_ns, delay_ns
        if before_ns is None:
            return
        taken_ns = min(delay_ns, before_ns) if abs(delay_ns - before_ns) <= STEP_NS else max(delay_ns, before_ns)
        window = arrival_ns // LOOK_NS
        self.least[window] = min(taken_ns, self.least.get(window, NEVER_NS))


def merged(parts: Iterable[Least]) -> dict[int, int]:
    """Return the smallest delays of topics with one clock."""
    least: dict[int, int] = {}
    for part in parts:
        for window, delay_ns in part.items():
            least[window] = min(delay_ns, least.get(window, NEVER_NS))
    return dict(sorted(least.items()))


def widened(least: Least) -> dict[int, int]:
    """Return the same in windows of `WINDOW_NS`."""
    return merged({window * LOOK_NS // WINDOW_NS: delay_ns} for window, delay_ns in least.items())


def step_ns(least: Least) -> int:
    """Return by how much a clock was set, ahead or back, at its largest step [ns]; 0 where it was not."""
    largest_ns = max((before - after for before, after in pairwise(least.values())), key=abs, default=0)
    return largest_ns if abs(largest_ns) > STEP_NS else 0
