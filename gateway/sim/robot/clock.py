"""The robot's clock, which stamps what it publishes: its host's wall clock, unless that of this robot is off or runs wrong.

Pure: told the time that the robot is stepped with, and how that lies to the wall clock.
"""

from __future__ import annotations

from typing import Final

__all__ = ["VIRTUAL_EPOCH_NS", "RobotClock"]

VIRTUAL_EPOCH_NS: Final = 1_790_000_000_123_456_789
"""The wall clock at stepping time 0 where there is none, in virtual time [ns since 1970] (choice): no round number."""


class RobotClock:
    """Tells the robot's time at any stepping time.

    What a drift has made of it stays when the drift ends: nobody sets a clock only because it runs right again.

    Attributes:
        epoch_ns: The wall clock minus stepping time [ns]. Who steps in real time keeps it true when his host's clock is set.
    """

    def __init__(self, epoch_ns: int, start_ns: int) -> None:
        """Begin with a clock that is right.

        Args:
            epoch_ns: The wall clock minus stepping time [ns].
            start_ns: Stepping time [ns].
        """
        self.epoch_ns = epoch_ns
        self._since_ns = start_ns
        self._offset_ns = self._drifted_ns = 0
        self._drift_ppm = 0.0

    def mistune(self, now_ns: int, offset_ns: int, drift_ppm: float) -> None:
        """Let the clock be off and run wrong from now on.

        Args:
            now_ns: Stepping time [ns].
            offset_ns: How far it is ahead of the wall clock [ns], beside what it has drifted; instead of the offset so far.
            drift_ppm: How much faster than the wall clock it runs [ppm]; instead of the drift so far.
        """
        self._drifted_ns += self._drift_ns(now_ns)
        self._since_ns, self._offset_ns, self._drift_ppm = now_ns, offset_ns, drift_ppm

    def stamp_ns(self, now_ns: int) -> int:
        """Return the robot's time [ns since 1970]."""
        return now_ns + self.epoch_ns + self._offset_ns + self._drifted_ns + self._drift_ns(now_ns)

    def _drift_ns(self, now_ns: int) -> int:
        """What the present drift has made up to now [ns]."""
        return round((now_ns - self._since_ns) * self._drift_ppm * 1e-6)
