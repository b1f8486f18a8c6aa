"""When to wake the commander of a stream so that his next target is just in time for a setpoint of the daemon.

The daemon tells how long before its setpoint a target came (`TargetView.lead_ns`). The instant of the wake that led to this
target, plus that lead, is the latest wake that would have done, but for whole periods of the setpoints. So no clocks are
compared, which may be those of two hosts, and whatever lies between is in it: a late wake-up, the caller's own work from
`tick` to `set`, the way to the daemon.

Rules
    * The margin is what would have served the last seconds best: the earlier the wake, the fewer targets miss their setpoint,
      and the longer all others wait. One that misses counts as `MISS_COST` periods of waiting. A little is added.
    * The average rate is the caller's. One that divides the rate of the setpoints keeps one place in their grid; any other is
      woken at the instant nearest to its own grid, and never twice for one setpoint.
    * Without a word of the daemon for a second, and above the rate of the setpoints, the caller keeps his own grid.
"""

from __future__ import annotations

from collections import deque

__all__ = ["Phase"]

KEPT = 256
"""So many targets are remembered; five seconds at 50 Hz."""

MISS_COST = 3
"""So many periods may the other targets wait together for one not to miss its setpoint: each 0.6 ms of 10 for one in 50."""

SPARE_NS = 500_000
"""Added to the margin [ns]: what the next target may be later than those that were seen."""

OLD_NS = 1_000_000_000
"""Without a word of the daemon for so long, its phase is not known any more [ns]."""

FORGOTTEN_NS = 5_000_000_000
"""What is older is no guide [ns]: clocks of two hosts drift, by some 50 us in a second."""


class Phase:
    """What one stream knows of the phase of its setpoints. All times are of the caller's clock."""

    def __init__(self, tick_ns: int) -> None:
        self._tick_ns = tick_ns
        self._setpoint_ns = tick_ns
        self._woken_ns: int | None = None
        self._sent: deque[tuple[int, int]] = deque(maxlen=KEPT)
        """Sequence numbers of targets, with the wake that led to them [ns]."""
        self._latest: deque[tuple[int, int]] = deque(maxlen=KEPT)
        """When the daemon told of a target [ns], and the latest wake that would have done for it [ns]."""
        self._usual_ns = 0
        """The median of these, but for whole periods [ns]."""

    def sent(self, seq: int, now_ns: int) -> None:
        """Learn that a target was sent; one that took longer than a tick does not say what a tick needs."""
        if self._woken_ns is not None and now_ns - self._woken_ns < self._tick_ns:
            self._sent.append((seq, self._woken_ns))

    def hear(self, seq: int, lead_ns: int, setpoint_ns: int, now_ns: int) -> None:
        """Learn how much earlier than its setpoint a target came."""
        self._setpoint_ns = setpoint_ns
        while self._sent and self._sent[0][0] <= seq:
            number, woken_ns = self._sent.popleft()
            if number == seq:
                self._latest.append((now_ns, woken_ns + lead_ns))

    def wake(self, due_ns: int, now_ns: int) -> tuple[int, int]:
        """Return when to wake the caller, and where his grid is from now on [ns].

        Args:
            due_ns: The instant of his own grid, not before `now_ns` [ns].
            now_ns: Now [ns].
        """
        before_ns, self._woken_ns = self._woken_ns, due_ns
        period_ns = self._setpoint_ns
        if self._tick_ns < period_ns or not self._latest or now_ns - self._latest[-1][0] > OLD_NS:
            return due_ns, due_ns
        woken_ns = due_ns + _wrapped(self._in_time_ns(now_ns) - due_ns, period_ns)
        earliest_ns = now_ns if before_ns is None else max(now_ns, before_ns + period_ns // 2)
        while woken_ns < earliest_ns:
            woken_ns += period_ns
        self._woken_ns = woken_ns
        setpoints = round(self._tick_ns / period_ns)
        divides = abs(self._tick_ns - setpoints * period_ns) <= setpoints  # but for the rounding of both periods
        return woken_ns, woken_ns if divides else due_ns

    def _in_time_ns(self, now_ns: int) -> int:
        """Return a wake that is just in time, but for whole periods [ns]."""
        while len(self._latest) > 1 and now_ns - self._latest[0][0] > FORGOTTEN_NS:
            self._latest.popleft()
        period_ns, base_ns = self._setpoint_ns, self._usual_ns - self._setpoint_ns // 2
        late_first_ns = sorted([(latest_ns - base_ns) % period_ns for _, latest_ns in self._latest])
        half = len(late_first_ns) // 2
        self._usual_ns = base_ns + late_first_ns[half]
        cost_ns = MISS_COST * period_ns / len(late_first_ns)
        _, best_ns = min([(missed * cost_ns - at_ns, at_ns) for missed, at_ns in enumerate(late_first_ns[: half + 1])])
        return base_ns + best_ns - SPARE_NS


def _wrapped(off_ns: int, period_ns: int) -> int:
    """Return how far off something is from the nearest multiple of the period [ns]."""
    return (off_ns + period_ns // 2) % period_ns - period_ns // 2
