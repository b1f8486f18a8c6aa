"""Stop frames of chassis and lift, repeated for a while (manual §1.4, §4.5, §4.6).

`fsm/enable 0.0` stops the arms only, so every explicit stop also sends chassis zeros for at least 1 s, and [0,1] to the
lift where there is one; an e-stop ends with [0,0], which takes the lift's servo off after it has stopped.
"""

from __future__ import annotations

from gateway import robot
from gateway.core.events import Frame, FrameKind
from gateway.core.streams.grid import Grid
from gateway.core.streams.stream import SentLog
from gateway.values import Vector

__all__ = ["LIFT_OFF", "StopRepeater"]

S = 1_000_000_000
REPEAT_NS = 1 * S
"""First and last stop frame are at least this far apart [ns] (the robot's chassis watchdog, manual §4.5)."""

LIFT_OFF: Vector = (0.0, 0.0)
"""Lift: stop, then servo off (manual §4.6)."""


class StopRepeater:
    """Repeats a group's stop frame at its rate for a second, sends the end that was asked for, and falls silent.

    Args:
        topic: Command topic of the chassis or the lift.
    """

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.log = SentLog()
        self._spec = robot.TOPICS[topic]
        self._grid = Grid(self._spec.rate_hz)
        self.running = False
        """Whether frames are being sent; it ends an instant of the grid after the last one."""
        self._until_ns: int | None = None
        self._last: Vector | None = None

    def stop(self, now_ns: int) -> None:
        """Repeat the stop frame from now on, the first at once. An end that was asked for before still comes."""
        self.running = True
        self._until_ns = now_ns + REPEAT_NS
        self._grid.start(now_ns)

    def then(self, values: Vector) -> None:
        """End the repetition with one frame of `values`."""
        self._last = values

    def next_due_ns(self) -> int | None:
        """Return the next instant of the grid [ns]; None when silent."""
        return self._grid.next_ns() if self.running else None

    def frame(self, now_ns: int) -> Frame | None:
        """Return the stop frame that is due now, or None.

        Args:
            now_ns: Monotonic time [ns].
        """
        due_ns = self._grid.due(now_ns) if self.running else None
        if due_ns is None:
            return None
        values = self._spec.stop_frame
        if self._until_ns is not None:
            if now_ns >= self._until_ns:
                self._until_ns = None
        elif self._last is not None:
            values, self._last = self._last, None
        else:
            self.running = False
            self.log.end()
            return None
        return Frame(topic=self.topic, values=values, kind=FrameKind.STOP, epoch=0, due_ns=due_ns)
