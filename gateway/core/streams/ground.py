"""Stop frames of chassis and lift, repeated for a while (manual §1.4, §4.5, §4.6), and what their two streams share.

`fsm/enable 0.0` stops the arms only, so every explicit stop also sends chassis zeros for at least 1 s, and [0,1] to the
lift where there is one; an e-stop ends with [0,0], which takes the lift's servo off after it has stopped.

A *drive* is a run of velocities of one owner. It has a number; a velocity that names the number of a drive that has ended
is refused with the code that ended it, so that nobody who only keeps his drive alive undoes a stop. Another drive may begin at
once, in the very tick of a stop: one stop frame leaves before it, so that the robot hears what the velocities begin from.
A drive of which no velocity has left yet ends without a word: the group may be somebody else's, not ours to stop. So may one
whose drive the robot has ended itself, in an outage longer than its watchdog.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

from gateway.codes import Code
from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.streams.grid import Grid
from gateway.core.streams.stream import SentLog
from gateway.robot.topics import TOPICS
from gateway.values import Vector

__all__ = ["LIFT_OFF", "GroundStream"]

S = 1_000_000_000
REPEAT_NS = 1 * S
"""First and last stop frame are at least this far apart [ns] (the robot's chassis watchdog, manual §4.5)."""

LIFT_OFF: Vector = (0.0, 0.0)
"""Lift: stop, then servo off (manual §4.6)."""


class GroundStream(ABC):
    """Sends an owner's velocities; else repeats the stop frame for a second, sends the end asked for, and falls silent."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.log = SentLog()
        self._spec = TOPICS[topic]
        self._grid = Grid(self._spec.rate_hz)
        self.running = False
        """Whether frames are being sent; it ends an instant of the grid after the last one."""
        self.is_driven = False
        """Whether an owner's velocity is being sent."""
        self.drive_id = 0
        """Number of the latest drive; 0 before the first."""
        self.code: Code | None = None
        """Why it ended; None while it goes on."""
        self.epoch = 0
        """Lease epoch under which it was commanded."""
        self._expires_ns: int | None = None
        self._is_kept = False
        self._lost_ns: int | None = None
        self._is_new = False
        self._owes_stop = False
        """Whether a stop was asked for of which no frame has left."""
        self._is_unsent = False
        """Whether a drive has begun of which no frame has left."""
        self._until_ns: int | None = None
        self._last: Vector | None = None
        self._repeated = self._spec.stop_frame

    # ------------------------------------------------------------------------------------------------ driving

    def renew(self, epoch: int, expires_ns: int, now_ns: int, drive_id: int) -> Code | None:
        """Begin a drive, or go on with one; return why the named one is over (nothing has changed then), None when it goes on.

        Drive 0 is a new one, any other number the one to go on with; its velocity counts until `expires_ns`.
        """
        if drive_id == 0:
            self.drive_id += 1
        elif drive_id != self.drive_id:
            return Code.SUPERSEDED if 0 < drive_id < self.drive_id else Code.UNKNOWN_STREAM
        elif self.code is not None:
            return self.code
        self.code, self.epoch, self._expires_ns = None, epoch, expires_ns
        if not self.running:
            self.running = self._is_unsent = True
            self._grid.start(now_ns)
        self.is_driven, self._is_new, self._until_ns, self._last = True, False, None, None
        return None

    def end(self, code: Code) -> None:
        """Whatever drives the group is over: who goes on with it is told why. The first reason counts."""
        if self.drive_id and self.code is None:
            self.code = code

    def cut(self, code: Code, now_ns: int) -> None:
        """End the drive and stop what is being driven; a group that nobody drives is left alone."""
        self.end(code)
        if self.is_driven and self._is_unsent:
            self._withdraw()
        elif self.is_driven:
            self.stop(now_ns)

    def expire(self, now_ns: int) -> bool:
        """Let a velocity without a successor run out; return whether that has just ended a motion."""
        if not self.is_driven or self._expires_ns is None or now_ns < self._expires_ns:
            return False
        self._expires_ns = None
        was_motion = self._run_out()
        if self._is_unsent:
            self._withdraw()
        return was_motion

    def _withdraw(self) -> None:
        """Be silent again: nothing of the drive has left."""
        self._rest()
        self.running = self._is_kept = self._is_new = False

    @abstractmethod
    def _run_out(self) -> bool:
        """Begin to come to rest; return whether there was a motion to end."""

    @abstractmethod
    def _driven(self) -> Vector | None:
        """Return the velocity to send; None, and stop frames follow, when it has come to rest."""

    def left_ns(self, now_ns: int) -> int | None:
        """Return how long the velocity still counts [ns]; None while none does."""
        return max(self._expires_ns - now_ns, 0) if self.is_driven and self._expires_ns is not None else None

    @property
    def is_on_wire(self) -> bool:
        """Whether frames of it have left, or stop frames are owed; a drive that still waits for its turn is neither."""
        return self.running and not self._is_unsent

    # ------------------------------------------------------------------------------------------------ stopping

    @property
    def is_stopping(self) -> bool:
        """Whether the next frame is a stop frame."""
        return self._owes_stop or not self.is_driven

    def stop(self, now_ns: int) -> None:
        """Repeat the stop frame from now on, the first at once. An end that was asked for before still comes."""
        self.running, self._owes_stop, self._is_unsent = True, True, False
        self._grid.start(now_ns)
        self._rest()

    def _rest(self) -> None:
        """Go over to stop frames, from the next instant of the grid on."""
        self.is_driven, self._repeated, self._is_new = False, self._spec.stop_frame, True

    def then(self, values: Vector) -> None:
        """End the repetition with one frame of `values`."""
        self._last, self._is_kept = values, False

    def lose(self, now_ns: int) -> None:
        """The transport is gone: what is under way does not arrive."""
        self._lost_ns = now_ns if self.running else None

    def find(self, now_ns: int) -> None:
        """The transport is back: stop frames that may not have arrived are sent again, unless the robot's watchdog acted."""
        if self._lost_ns is not None and now_ns - self._lost_ns < (self._spec.watchdog_ns or 0):
            self.stop(now_ns)
        self._lost_ns = None

    # ------------------------------------------------------------------------------------------------ frames

    def next_due_ns(self) -> int | None:
        """Return the next instant of the grid [ns]; None when silent."""
        return self._grid.next_ns() if self.running else None

    def frame(self, now_ns: int) -> Frame | None:
        """Return the frame that is due now, or None."""
        due_ns = self._grid.due(now_ns) if self.running else None
        if due_ns is None:
            return None
        is_stop_owed, self._owes_stop, self._is_unsent = self._owes_stop, False, False
        if self.is_driven and is_stop_owed:
            return Frame(topic=self.topic, values=self._repeated, kind=FrameKind.STOP, epoch=0, due_ns=due_ns)
        values = self._driven() if self.is_driven else None
        if values is not None:
            return Frame(topic=self.topic, values=values, kind=FrameKind.MOTION, epoch=self.epoch, due_ns=due_ns)
        values = self._repeated
        if self._is_new:  # the second is counted from the first frame that leaves, not from when it was asked for
            self._is_new, self._until_ns = False, now_ns + REPEAT_NS
        if self._until_ns is not None:
            if now_ns >= self._until_ns:
                self._until_ns = None
        elif self._last is not None:
            values = self._repeated = self._last  # a stop that comes before it falls silent begins from here
            self._last = None
        elif not self._is_kept:
            self.running = False
            self.log.end()
            return None
        return Frame(topic=self.topic, values=values, kind=FrameKind.STOP, epoch=0, due_ns=due_ns)
