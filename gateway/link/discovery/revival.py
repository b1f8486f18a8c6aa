"""When dead routes are declared again: all of them at once, and at the instants at which the guard does it as well.

A robot's bridge makes a new reader for a dead route only when its *last* subscription went and another one comes (wire.md
3.1 b). The daemon and its guard both subscribe, in two processes: each alone would declare again in vain for ever, because
of the other. So whoever finds a route dead waits for the next instant that all processes of this host know, multiples of
3 s of the monotonic clock, undeclares, and declares again 0.2 s later: long enough for both to be out together.

Two that find it on different sides of such an instant miss each other once. Their next attempts come 2, 8 and 26 s after
the first (`route_watch`): two seconds off the grid of three, so that they do not miss each other again.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

__all__ = ["GRID_NS", "Revival"]

S = 1_000_000_000

GRID_NS = 3 * S
"""Instants at which subscriptions are declared again are multiples of this [ns]."""


class Revival:
    """Collects dead routes and has them declared again when it is time.

    Args:
        redeclare: Undeclares and declares the subscriptions of these topics; takes a moment.
    """

    def __init__(self, redeclare: Callable[[Collection[str]], None]) -> None:
        self._redeclare = redeclare
        self._topics: dict[str, None] = {}
        self._due_ns = 0

    def want(self, topics: Collection[str], now_ns: int) -> None:
        """Take routes that are to be revived."""
        if topics and not self._topics:
            self._due_ns = (now_ns // GRID_NS + 1) * GRID_NS
        self._topics.update(dict.fromkeys(topics))

    def forget(self) -> None:
        """The transport is gone: everything is declared anew with the next one."""
        self._topics.clear()

    def step(self, now_ns: int) -> None:
        """Declare again what is due. What fails leaves topics without a subscription: due again at the next instant."""
        if self._topics and now_ns >= self._due_ns:
            topics = tuple(self._topics)
            self._topics.clear()
            try:
                self._redeclare(topics)
            except BaseException:
                self.want(topics, now_ns)
                raise

    def pause_s(self, now_ns: int, longest_s: float) -> float:
        """Return how long to wait until the next step [s]."""
        return min(longest_s, max(0, self._due_ns - now_ns) / S) if self._topics else longest_s
