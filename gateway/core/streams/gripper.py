"""A gripper's stream: its force input at 50 Hz, for as long as its arm is streamed (manual §4.4).

The robot keeps the last input and applies its torque while the arm's stream lives; 100 ms without the arm, and the grip is
lost. So this stream runs exactly while its arm's does: it needs no end of its own, and ends nothing.

* It starts before the first setpoint of its arm, with 0.10 (no torque): the robot may still hold an older input.
* The owner's value is kept through holding, pausing, a takeover and a short stall, until a later one or a new start.
* A value that did not leave before a cut never leaves: the one that was sent last stays.
"""

from __future__ import annotations

from collections.abc import Callable

from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.streams.grid import Grid
from gateway.core.streams.stream import SentLog
from gateway.robot.limits import GRIPPER_RELAXED
from gateway.robot.topics import TOPICS, gripper_command
from gateway.values import Side

__all__ = ["GripperStream"]


class GripperStream:
    """Force inputs of one gripper, 0 (opens most) to 1 (closes most)."""

    def __init__(self, side: Side, is_arm_streamed: Callable[[], bool]) -> None:
        self.topic = gripper_command(side)
        self.log = SentLog()
        self.raw = GRIPPER_RELAXED
        """What was sent last, or is about to be when it starts."""
        self.is_holding: bool | None = None
        """Whether something seems to be held (`grip.py`); None when nobody can tell."""
        self._is_arm_streamed = is_arm_streamed
        self._grid = Grid(TOPICS[self.topic].rate_hz)
        self._is_started = False
        self._is_first = False
        self._wanted: tuple[float, int] | None = None

    @property
    def running(self) -> bool:
        """Whether frames are being sent."""
        return self._is_started and self._is_arm_streamed()

    @property
    def wanted(self) -> float:
        """What the owner asked for last, whether it has left or not."""
        return self.raw if self._wanted is None else self._wanted[0]

    def start(self, now_ns: int, *, is_kept: bool) -> None:
        """Begin, before the first setpoint of the arm; one that runs goes on as it is.

        Args:
            now_ns: Monotonic time [ns].
            is_kept: Whether the value of before goes on: a short stall is over, and the grip with it is not.
        """
        if self.running:
            return
        if not is_kept:
            self.raw = GRIPPER_RELAXED
        self._is_started = self._is_first = True
        self._wanted = None
        self.log.end()
        self._grid.start(now_ns)

    def enter(self, raw: float, now_ns: int) -> None:
        """Go on where another process has sent `raw` last."""
        self.raw, self._wanted = raw, None
        self._is_started, self._is_first = True, False
        self._grid.start(now_ns)

    def command(self, raw: float, epoch: int) -> None:
        """Send a value of the owner of `epoch` from the next instant of the grid on."""
        self._wanted = (raw, epoch)

    def cancel(self) -> None:
        """Forget a value that has not left."""
        self._wanted = None

    def next_due_ns(self) -> int | None:
        """Return the next instant of the grid [ns]; None when silent."""
        return self._grid.next_ns() if self.running else None

    def frame(self, now_ns: int) -> Frame | None:
        """Return the input that is due now, or None."""
        due_ns = self._grid.due(now_ns) if self.running else None
        if due_ns is None:
            return None
        kind, epoch = FrameKind.HOLD, 0
        if self._is_first:
            kind, self._is_first = FrameKind.ECHO, False
        elif self._wanted is not None:
            kind, (self.raw, epoch), self._wanted = FrameKind.MOTION, self._wanted, None
        return Frame(topic=self.topic, values=(self.raw,), kind=kind, epoch=epoch, due_ns=due_ns)
