"""What the robot sees of its command streams: rates, gaps, and how hard they drive the arms.

Pure bookkeeping over arrival times that are passed in. The figures serve tests and the demo; the robot's behaviour
does not depend on them.
"""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.sim.manual import ARM_WATCHDOG_NS, MS, S

__all__ = ["MotionMeter", "SetpointMeter", "StreamMeter"]

Array = NDArray[np.float64]

_KEPT_INTERVALS: Final = 20_000
ALIVE_NS: Final = 1 * S
"""A longer silence ends a stream; what follows is a new one and its interval is no gap."""

_WINDOW_NS: Final = 50 * MS


class StreamMeter:
    """Arrivals on one command topic."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.count = 0
        self.streams = 0
        self.worst_gap_alive_ns = 0
        self.gaps_over_100_ms = 0
        self.gaps_over_150_ms = 0
        self.first_ns: int | None = None
        self.last_ns: int | None = None
        self.last_value: object = None
        self._intervals_ns: deque[int] = deque(maxlen=_KEPT_INTERVALS)

    def add(self, now_ns: int, value: object) -> None:
        """Count one message.

        Args:
            now_ns: Arrival [ns].
            value: A JSON-able form of its content.
        """
        self.count += 1
        self.last_value = value
        if self.last_ns is None or now_ns - self.last_ns > ALIVE_NS:
            self.streams += 1
        else:
            gap_ns = now_ns - self.last_ns
            self._intervals_ns.append(gap_ns)
            self.worst_gap_alive_ns = max(self.worst_gap_alive_ns, gap_ns)
            self.gaps_over_100_ms += gap_ns > 100 * MS
            self.gaps_over_150_ms += gap_ns > 150 * MS
        if self.first_ns is None:
            self.first_ns = now_ns
        self.last_ns = now_ns

    def as_dict(self, now_ns: int) -> dict[str, object]:
        """Return the figures in milliseconds and hertz, over the life of the streams since the last reset."""
        intervals = np.fromiter(self._intervals_ns, dtype=np.float64) / MS
        known = intervals.size > 0
        return {
            "count": self.count,
            "streams": self.streams,
            "rate_hz": round(1e3 * intervals.size / float(intervals.sum()), 3) if known and intervals.sum() else None,
            "p50_ms": round(float(np.percentile(intervals, 50)), 3) if known else None,
            "p99_ms": round(float(np.percentile(intervals, 99)), 3) if known else None,
            "max_ms": round(float(intervals.max()), 3) if known else None,
            "worst_gap_alive_ms": round(self.worst_gap_alive_ns / MS, 3),
            "gaps_over_100_ms": self.gaps_over_100_ms,
            "gaps_over_150_ms": self.gaps_over_150_ms,
            "age_ms": None if self.last_ns is None else round((now_ns - self.last_ns) / MS, 3),
            "last": self.last_value,
        }


class MotionMeter:
    """Peak speed and acceleration of an arm, by finite differences over 50 ms of its own time line."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.peak_radps = np.zeros(7)
        self.peak_radps2 = np.zeros(7)
        self.break_off()

    def break_off(self) -> None:
        """Begin a new time line: the next sample is not compared with earlier ones."""
        self._positions: deque[tuple[int, Array]] = deque()
        self._velocities: deque[tuple[int, Array]] = deque()

    def add(self, time_ns: int, q_rad: Array) -> None:
        """Take the positions at a time of the time line, which must grow.

        Args:
            time_ns: Time [ns].
            q_rad: Positions, shape (7,) [rad].
        """
        velocity = _difference(self._positions, time_ns, q_rad)
        if velocity is None:
            return
        np.maximum(self.peak_radps, np.abs(velocity), out=self.peak_radps)
        acceleration = _difference(self._velocities, time_ns, velocity)
        if acceleration is not None:
            np.maximum(self.peak_radps2, np.abs(acceleration), out=self.peak_radps2)

    def as_dict(self) -> dict[str, object]:
        """Return the peaks per joint [rad/s, rad/s²]."""
        return {
            "peak_radps": [round(value, 4) for value in self.peak_radps.tolist()],
            "peak_radps2": [round(value, 4) for value in self.peak_radps2.tolist()],
        }


def _difference(history: deque[tuple[int, Array]], time_ns: int, value: Array) -> Array | None:
    """Append a sample and return the mean slope over the last window [1/s], or None while it is not filled."""
    history.append((time_ns, value))
    while len(history) > 2 and time_ns - history[1][0] >= _WINDOW_NS:
        history.popleft()
    begin_ns, begin = history[0]
    if time_ns - begin_ns < _WINDOW_NS:
        return None
    return np.asarray((value - begin) * (S / (time_ns - begin_ns)))


class SetpointMeter:
    """Steps, peak speed and acceleration of the setpoints of one arm as they were meant.

    The sender's time line is rebuilt from the median interval: a setpoint that arrives late is still one period after
    the one before it, and network jitter does not look like acceleration.
    """

    def __init__(self) -> None:
        self.motion = MotionMeter()
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.motion.reset()
        self.max_step_rad = 0.0
        self._intervals_ns: deque[int] = deque(maxlen=63)
        self._period_ns = 0
        self._time_ns = 0
        self._last: tuple[int, Array] | None = None
        self._until_median = 0

    def add(self, now_ns: int, q_rad: Array) -> None:
        """Take an accepted setpoint.

        Args:
            now_ns: Arrival [ns].
            q_rad: Target positions, shape (7,) [rad].
        """
        if self._last is None or now_ns - self._last[0] > ARM_WATCHDOG_NS:
            self.motion.break_off()
            self._intervals_ns.clear()
            self._period_ns = self._until_median = 0
        else:
            self.max_step_rad = max(self.max_step_rad, float(np.max(np.abs(q_rad - self._last[1]))))
            self._intervals_ns.append(now_ns - self._last[0])
            self._until_median -= 1
            if self._until_median <= 0 and len(self._intervals_ns) >= 15:
                self._period_ns = sorted(self._intervals_ns)[len(self._intervals_ns) // 2]
                self._until_median = 16
        self._last = (now_ns, q_rad)
        if self._period_ns:
            self._time_ns += self._period_ns
            self.motion.add(self._time_ns, q_rad)

    def as_dict(self) -> dict[str, object]:
        """Return the largest step of one message [rad] and the peaks per joint."""
        return {"max_step_rad": round(self.max_step_rad, 6), **self.motion.as_dict()}
