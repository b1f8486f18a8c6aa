"""What the robot sees of its command streams: rates, gaps, and how hard they drive the arms.

Pure bookkeeping over arrival times that are passed in. The figures serve tests and the demo; the robot's behaviour
does not depend on them.
"""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.sim.robot.manual import ARM_WATCHDOG_NS, DOF, MS, S

__all__ = ["MotionMeter", "SetpointMeter", "StreamMeter"]

Array = NDArray[np.float64]

SILENCE_NS: Final = 50 * MS
"""A longer silence between setpoints is none of the network's usual."""
_KEPT_INTERVALS: Final = 20_000
ALIVE_NS: Final = 1 * S
"""A longer silence ends a stream; what follows is a new one and its interval is no gap."""

LATE_NS: Final = 100 * MS
"""A setpoint that is older than this when it arrives waited somewhere on the way."""

_WINDOW_NS: Final = 50 * MS
_BLOCK: Final = 512


class StreamMeter:
    """Arrivals on one command topic.

    How old a stamped message is when it arrives is counted from the quickest one so far: sender and robot need not have
    the same clock.
    """

    def __init__(self) -> None:
        self._quickest_ns: int | None = None
        self.reset()

    def reset(self) -> None:
        """Forget everything but how far away the sender's clock is."""
        self.count = 0
        self.streams = 0
        self.oldest_ns: int | None = None
        self.late = 0
        self.worst_gap_alive_ns = 0
        self.gaps_over_100_ms = 0
        self.gaps_over_150_ms = 0
        self.first_ns: int | None = None
        self.last_ns: int | None = None
        self.last_value: object = None
        self._intervals_ns: deque[int] = deque(maxlen=_KEPT_INTERVALS)

    def add(self, now_ns: int, value: object, stamp_ns: int | None = None) -> None:
        """Count one message.

        Args:
            now_ns: Arrival [ns].
            value: A JSON-able form of its content.
            stamp_ns: When it was sent, by the sender's clock [ns]; None where the type has no stamp.
        """
        self.count += 1
        if stamp_ns:
            self._date(now_ns - stamp_ns)
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

    def _date(self, behind_ns: int) -> None:
        if self._quickest_ns is None or behind_ns < self._quickest_ns:
            self._quickest_ns = behind_ns
        age_ns = behind_ns - self._quickest_ns
        self.oldest_ns = max(self.oldest_ns or 0, age_ns)
        self.late += age_ns > LATE_NS

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
            "oldest_ms": None if self.oldest_ns is None else round(self.oldest_ns / MS, 3),
            "late": self.late,
            "age_ms": None if self.last_ns is None else round((now_ns - self.last_ns) / MS, 3),
            "last": self.last_value,
        }


class MotionMeter:
    """Peak step, speed and acceleration of an arm, by finite differences over 50 ms of its own time line.

    Samples are only stored; they are evaluated in blocks, so that watching costs next to nothing.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._peaks = np.zeros((3, DOF))
        self._times_ns: list[int] = []
        self._positions: list[Array] = []

    def break_off(self) -> None:
        """Begin a new time line: the next sample is not compared with earlier ones."""
        self._fold()
        self._times_ns, self._positions = [], []

    def go_on(self, q_rad: Array) -> None:
        """Begin a new time line behind a silence in which one sample may have been lost: the way over it is two steps.

        Args:
            q_rad: Positions of the next sample, shape (7,) [rad].
        """
        if self._positions:
            np.maximum(self._peaks[0], np.abs(q_rad - self._positions[-1]) / 2.0, out=self._peaks[0])
        self.break_off()

    def add(self, time_ns: int, q_rad: Array) -> None:
        """Take the positions at a time of the time line, which must grow.

        Args:
            time_ns: Time [ns].
            q_rad: Positions, shape (7,) [rad]; kept, so it must not be changed afterwards.
        """
        self._times_ns.append(time_ns)
        self._positions.append(q_rad)
        if len(self._times_ns) >= _BLOCK:
            self._fold()

    def _fold(self) -> None:
        """Evaluate what is stored and keep only what the next samples must be compared with."""
        if len(self._times_ns) < 2:
            return
        times_ns = np.array(self._times_ns)
        q_rad = np.stack(self._positions)
        steps = np.abs(np.diff(q_rad, axis=0))
        velocities, from_ns = _slopes(times_ns, q_rad)
        accelerations, _ = _slopes(from_ns, velocities)
        for row, values in enumerate((steps, np.abs(velocities), np.abs(accelerations))):
            if len(values):
                np.maximum(self._peaks[row], values.max(axis=0), out=self._peaks[row])
        kept = int(np.searchsorted(times_ns, times_ns[-1] - 3 * _WINDOW_NS))
        self._times_ns, self._positions = self._times_ns[kept:], self._positions[kept:]

    def as_dict(self) -> dict[str, object]:
        """Return the peaks per joint: step from sample to sample [rad], speed [rad/s], acceleration [rad/s²]."""
        self._fold()
        step, speed, acceleration = ([round(value, 6) for value in row] for row in self._peaks.tolist())
        return {"peak_step_rad": step, "peak_radps": speed, "peak_radps2": acceleration}


def _slopes(times_ns: NDArray[np.int64], values: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return the mean slope over the window before each sample that has one [1/s], and those samples' times [ns]."""
    begins = np.searchsorted(times_ns, times_ns - _WINDOW_NS, side="right") - 1
    known = begins >= 0
    begins = begins[known]
    elapsed_s = (times_ns[known] - times_ns[begins]) / S
    return (values[known] - values[begins]) / elapsed_s[:, None], times_ns[known]


class SetpointMeter:
    """Steps, peak speed and acceleration of the setpoints of one arm as they were meant.

    A silence of more than 50 ms ends the time line: whoever sent stood still or died, its last setpoint may never have
    left, and how fast setpoints were meant to go over it nobody can say. The sender's time line is rebuilt from the mean
    interval without the outliers, the long ones and the short ones that follow them when setpoints have piled up: a
    setpoint that arrives late is still one period after the one before it, and network jitter does not look like
    acceleration.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._motion = MotionMeter()
        self._intervals_ns: deque[int] = deque(maxlen=255)
        self._period_ns = 0
        self._time_ns = 0
        self._last_ns: int | None = None
        self._until_median = 0
        self._early: list[Array] = []

    def add(self, now_ns: int, q_rad: Array) -> None:
        """Take an accepted setpoint.

        Args:
            now_ns: Arrival [ns].
            q_rad: Target positions, shape (7,) [rad].
        """
        if self._last_ns is None or now_ns - self._last_ns > ARM_WATCHDOG_NS:
            self._motion.break_off()
            self._intervals_ns.clear()
            self._period_ns = self._until_median = 0
            self._early = []
        else:
            if self._period_ns and now_ns - self._last_ns > SILENCE_NS:
                self._motion.go_on(q_rad)
            self._intervals_ns.append(max(now_ns - self._last_ns, 1))
            self._until_median -= 1
            if self._until_median <= 0 and len(self._intervals_ns) >= 15:
                median_ns = sorted(self._intervals_ns)[len(self._intervals_ns) // 2]
                usual = [ns for ns in self._intervals_ns if median_ns <= 3 * ns <= 9 * median_ns]
                self._period_ns = sum(usual) // len(usual)
                self._until_median = 16
        self._last_ns = now_ns
        self._early.append(q_rad)
        if self._period_ns:
            for early in self._early:
                self._time_ns += self._period_ns
                self._motion.add(self._time_ns, early)
            self._early = []

    def as_dict(self) -> dict[str, object]:
        """Return the peaks per joint, as `MotionMeter` does."""
        return self._motion.as_dict()
