"""What the setpoint streams of an arm have in common, in joint space and in pose space: from the seed on without a gap.

What moves the setpoint is the reference (`motion.py`); this class says when a setpoint is due and of
which kind it is: ECHO while it only repeats where the arm was found, MOTION while the owner's path or targets move it, WALK
while a held reference is led back to the arm, BRAKE while it comes to rest, HOLD while it repeats itself.
"""

from __future__ import annotations

from typing import Any

from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.motion.gap import Gap, gap
from gateway.core.motion.motion import Reference, ReferenceMode
from gateway.core.motion.space import Course
from gateway.core.motion.tracker import Tracker
from gateway.core.streams.grid import Grid
from gateway.core.streams.stream import SentLog
from gateway.values import Space, Vector

__all__ = ["SetpointStream"]


class SetpointStream:
    """Setpoints of one arm, out of a reference; `tracking` bounds their distance from the measured arm."""

    def __init__(self, topic: str, space: Space, reference: Reference[Any], rate_hz: float, tracking: Gap) -> None:
        self.reference = reference
        self.topic = topic
        self.space = space
        self.log = SentLog()
        self.tracking = tracking
        self.running = False
        """Whether frames are being sent."""
        self.epoch = 0
        """Lease epoch under which the latest motion was commanded; 0 when none was since the start."""
        self._grid = Grid(rate_hz)
        self._is_first = False
        self._is_echoing = False
        self._is_walking = False

    def start(self, values: Vector, now_ns: int) -> None:
        """Begin to echo a measured setpoint; the only way in which the setpoint may jump.

        Raises:
            PlanFailed: It is not inside the limits; nothing has changed.
        """
        self.reference.seed(values)
        self.epoch = 0
        self.running, self._is_first, self._is_echoing, self._is_walking = True, True, True, False
        self.log.end()
        self._grid.start(now_ns)

    def stay_with(self, values: Vector) -> None:
        """Repeat where an arm is that nobody drives, from the next frame on; the frames go on in their time.

        Raises:
            PlanFailed: It is not inside the limits; nothing has changed.
        """
        self.reference.seed(values)
        self.epoch = 0
        self._is_first, self._is_walking = True, False
        self.log.begin_anew()

    @property
    def is_repeating(self) -> bool:
        """Whether nothing moves the setpoint, now or later, until somebody asks."""
        return self.reference.mode is ReferenceMode.HOLD

    def enter(self, values: Vector, rates: Vector, forces: Vector, now_ns: int) -> None:
        """Go on where another process's stream was interrupted: brake from its last setpoint, then hold.

        Raises:
            PlanFailed: It cannot brake inside the limits; nothing has changed.
        """
        self.reference.enter(values, rates, forces)
        self.epoch = 0
        self.running, self._is_first, self._is_echoing, self._is_walking = True, False, False, False
        self.log.end()
        self._grid.start(now_ns)

    def stop(self) -> None:
        """Go silent."""
        self.running = self._is_echoing = self._is_walking = False
        self.log.end()

    def go_live(self) -> None:
        """The robot follows now: what was an echo is a held reference from here on."""
        self._is_echoing = False

    def follow_path(self, path: Course, epoch: int) -> None:
        """Follow this arm's part of a path planned from its reference, for the owner of `epoch`."""
        self.reference.start(path)
        self._own(epoch)

    def follow_target(self, values: Vector, speed: float, epoch: int) -> None:
        """Follow a streamed target for the owner of `epoch`."""
        self.reference.follow(values, speed)
        self._own(epoch)

    def follow_chunk(self, tracker: Tracker[Any], epoch: int) -> None:
        """Follow this arm's part of a trajectory, for the owner of `epoch`."""
        self.reference.track(tracker)
        self._own(epoch)

    def _own(self, epoch: int) -> None:
        """What moves it from now on is the owner's of `epoch`."""
        self.epoch, self._is_walking = epoch, False

    def walk(self, path: Course) -> None:
        """Lead the held reference back to the measured arm; nobody's motion."""
        self.reference.start(path)
        self.epoch, self._is_walking = 0, True

    def brake(self) -> None:
        """Come to rest inside the limits, then hold."""
        self._is_walking = False
        self.reference.brake()

    @property
    def values(self) -> Vector:
        """The last setpoint."""
        return self.reference.values

    @property
    def rates(self) -> Vector:
        """Its velocity."""
        return self.reference.rates

    @property
    def period_s(self) -> float:
        """Time between setpoints [s]."""
        return self.reference.period_s

    @property
    def is_at_rest(self) -> bool:
        """Whether the setpoint stands still; a path or a target may be pending."""
        return self.reference.is_at_rest

    @property
    def is_walking(self) -> bool:
        """Whether the reference is being led back to the arm."""
        return self._is_walking and self.reference.mode is ReferenceMode.PATH

    def distance(self, measured: Vector) -> Gap:
        """Return how far the setpoint is from where the arm is measured, in this space."""
        return gap(self.space, self.reference.values, measured)

    def next_due_ns(self) -> int | None:
        """Return the next instant of the grid [ns]; None when silent."""
        return self._grid.next_ns() if self.running else None

    def _kind(self) -> FrameKind:
        if self._is_first:
            return FrameKind.ECHO
        mode = self.reference.mode
        if mode is ReferenceMode.BRAKE:
            return FrameKind.BRAKE
        if mode is ReferenceMode.HOLD:
            return FrameKind.ECHO if self._is_echoing else FrameKind.HOLD
        return FrameKind.WALK if self._is_walking else FrameKind.MOTION

    def frame(self, now_ns: int) -> Frame | None:
        """Return the setpoint that is due now, or None. The reference advances one nominal period per frame."""
        if not self.running:
            return None
        due_ns = self._grid.due(now_ns)
        if due_ns is None:
            return None
        kind = self._kind()
        self._is_first = False
        return Frame(topic=self.topic, values=self.reference.step(), kind=kind, epoch=self.epoch, due_ns=due_ns)
