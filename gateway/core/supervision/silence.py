"""How long somebody was not heard, and how much of that a pause of this process explains. For the owner and stop endpoints.

A late tick is a pause of this process: signs of life that came in it may still wait to be read. So a silence may be longer
by one pause, the longest in it. Not by their sum: between two pauses there was time to read, and a process that is always
late would never find out. What a pause explains is no sign of life yet: whoever is silent for 100 ms beyond the bound is
*doubted*, whatever explains it.
"""

from __future__ import annotations

__all__ = ["DOUBT_NS", "LATE_NS", "Silence"]

LATE_NS = 20_000_000
"""A tick later than this is a pause of this process; less is ordinary jitter and grants nobody anything [ns]."""
DOUBT_NS = 100_000_000
"""Who is silent for longer than this beyond his bound is doubted [ns]."""


class Silence:
    """The time since somebody's last sign of life."""

    __slots__ = ("_pause_ns", "heard_ns", "now_ns")

    def __init__(self, heard_ns: int = 0) -> None:
        self.heard_ns = heard_ns
        """The last sign of life [ns]."""
        self.now_ns = heard_ns
        """The latest look [ns]."""
        self._pause_ns = 0, 0  # first and last instant of the pause that explains most of the silence

    def look(self, now_ns: int, late_ns: int) -> None:
        """Let time pass until a tick that is `late_ns` late [ns]."""
        self.now_ns = now_ns
        pause_ns = now_ns - late_ns, now_ns
        if late_ns > LATE_NS and self._explained_ns(pause_ns) >= self._explained_ns(self._pause_ns):
            self._pause_ns = pause_ns

    @property
    def ns(self) -> int:
        """How long it lasted at the latest look [ns]."""
        return self.now_ns - self.heard_ns

    def patience_ns(self, bound_ns: int) -> int:
        """Return how long it may last [ns]: the bound, and what one pause explains."""
        return bound_ns + self._explained_ns(self._pause_ns)

    def is_doubted(self, bound_ns: int) -> bool:
        """Return whether it lasts for so long that nothing may move any more, whatever explains it."""
        return self.ns > bound_ns + DOUBT_NS

    def _explained_ns(self, pause_ns: tuple[int, int]) -> int:
        first_ns, last_ns = pause_ns
        return max(0, last_ns - max(first_ns, self.heard_ns))
