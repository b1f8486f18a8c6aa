"""Rates, copies and the robot's clock over the last seconds, for people. Pure: tallies and times in, figures out.

The link's thread notes what its mailboxes have counted, a few times a second; anybody may read the figures, which are
replaced as a whole. Nothing here is looked at on a tick.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

from gateway.link.mailbox import Tally

__all__ = ["WINDOW_NS", "Figure", "Meter"]

S = 1_000_000_000

WINDOW_NS = 5 * S
"""Figures are of this long: five samples of the slowest topic."""


class Figure(NamedTuple):
    """What was measured of a topic.

    Attributes:
        rate_hz: Samples a second, copies excluded; 0 when none came of late.
        times: How often each sample came.
    """

    rate_hz: float = 0.0
    times: float = 1.0


class Meter:
    """Keeps what was noted.

    Attributes:
        stamp: Of the newest sample: the robot's time in it and its arrival on our monotonic clock [ns]. Set by the loop.
        refused: Per topic how many samples could not be read, and what was wrong with the last. Noted by the loop.
        figures: Per topic, of the last seconds.
        clock_ns: The robot's clock minus ours [ns]: by the stamp of the fastest of the last samples, so too small by what
            that one needed to get here. None before the first.
    """

    def __init__(self) -> None:
        self.stamp: tuple[int, int] | None = None
        self.refused: dict[str, tuple[int, str]] = {}
        self.figures: Mapping[str, Figure] = {}
        self.clock_ns: int | None = None
        self._notes: deque[tuple[int, Mapping[str, Tally]]] = deque()
        self._offsets: deque[tuple[int, int]] = deque()

    def refuse(self, topic: str, why: str) -> None:
        """Note that a sample could not be read."""
        self.refused[topic] = self.refused.get(topic, (0, ""))[0] + 1, why

    def note(self, now_ns: int, tallies: Mapping[str, Tally], wall_ns: int) -> None:
        """Take what has been counted.

        Tallies are since the beginning; the wall clock is read beside `now_ns`.
        """
        notes, offsets, stamp = self._notes, self._offsets, self.stamp
        notes.append((now_ns, tallies))
        while notes[0][0] < now_ns - WINDOW_NS:
            notes.popleft()
        if stamp is not None and stamp[1] >= now_ns - WINDOW_NS:
            offsets.append((now_ns, stamp[0] - (wall_ns - (now_ns - stamp[1]))))
        while offsets and offsets[0][0] < now_ns - WINDOW_NS:
            offsets.popleft()
        if offsets:
            self.clock_ns = max(offset for _, offset in offsets)
        self.figures = {topic: self._figure(topic, tally) for topic, tally in tallies.items()}

    def forget(self) -> None:
        """The transport is gone: what was counted before says nothing about the next one."""
        self._notes.clear()
        self._offsets.clear()
        self.stamp = None
        self.figures, self.clock_ns = {}, None

    def _figure(self, topic: str, newest: Tally) -> Figure:
        """Compare with the oldest note in which a sample is: the time between two arrivals is exact."""
        oldest = next((tallies[topic] for _, tallies in self._notes if tallies[topic].last_ns is not None), newest)
        if oldest.last_ns is None or newest.last_ns is None:
            return Figure()
        samples, between_ns = newest.samples - oldest.samples, newest.last_ns - oldest.last_ns
        if samples <= 0 or between_ns <= 0:
            return Figure()
        copies = newest.copies - oldest.copies
        return Figure(rate_hz=samples * S / between_ns, times=1.0 + copies / samples)
