"""DecodeSchedule: which state topics are decoded in a poll. What costs time and serves nobody now waits for its turn.

What does not decide at once has its turn in the same poll: what caches lose while a loop sleeps is paid once. Pure.
"""

from __future__ import annotations

from typing import Final

from gateway.link.hearing import POSED, SHOWN

__all__ = ["DecodeSchedule"]

TURN_NS: Final = 20_000_000
"""What does not decide at once is decoded this often [ns]."""
LATE_NS: Final = 15_000_000
"""After a pause of more than this everything is decoded [ns]: its turn is over."""


class DecodeSchedule:
    """Keeps the turns of the four classes of topics (`hearing`)."""

    def __init__(self) -> None:
        self._periods_ns = [0, TURN_NS, TURN_NS, TURN_NS]
        self._polled_ns = 0

    def pace(self, *, is_moving: bool, is_watched: bool, is_posing: bool) -> None:
        """Say what is going on; arguments as for `RobotLink.pace`."""
        self._periods_ns[SHOWN] = TURN_NS if is_watched or is_moving else 2 * TURN_NS
        self._periods_ns[POSED] = 0 if is_posing else self._periods_ns[SHOWN]

    def due(self, now_ns: int, *, is_everyones: bool) -> list[bool]:
        """Return for each class whether its turn is in this poll."""
        before_ns, self._polled_ns = self._polled_ns, now_ns
        if is_everyones or now_ns - before_ns > LATE_NS:
            return [True] * len(self._periods_ns)
        return [not period_ns or now_ns // period_ns != before_ns // period_ns for period_ns in self._periods_ns]
