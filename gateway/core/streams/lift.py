"""The lift: an owner's velocity at 20 Hz, then [0,1], and [0,0] at the end of its use (manual §4.6).

* [0,1] stops the lift and keeps its servo on. It is repeated for as long as somebody owns or holds the robot, because
  after 3 s of silence the robot takes the servo off by itself; [0,0] then ends the use.
* No ramp: the manual asks for none, its own example (§6.7) commands steps, and the servo's controller brakes by itself, at
  a stop and before its position limits. A ramp here would only delay a stop.
* Where the lift is nobody knows: the robot publishes no position of it (manual §4.12).
"""

from __future__ import annotations

from gateway.codes import Code
from gateway.core.streams.ground import LIFT_OFF, GroundStream
from gateway.robot.topics import LIFT_COMMAND
from gateway.values import Vector

__all__ = ["LiftStream"]


class LiftStream(GroundStream):
    """Velocities of the lift, -1 (down) to 1 (up)."""

    def __init__(self) -> None:
        super().__init__(LIFT_COMMAND)
        self._velocity = 0.0

    @property
    def commanded(self) -> float:
        """The velocity that is being sent, -1 to 1."""
        return self._velocity if self.is_driven else 0.0

    @property
    def is_in_use(self) -> bool:
        """Whether the servo was asked to be on, by a drive, and not to be off since."""
        return self._is_kept

    def drive(self, velocity: float, *, epoch: int, expires_ns: int, now_ns: int, drive_id: int = 0) -> Code | None:
        """Go up or down; see `GroundStream.renew`.

        `velocity` is -1 (down) to 1 (up), finite; drive and expiry are as for `renew`.
        """
        code = self.renew(epoch, expires_ns, now_ns, drive_id)
        if code is None:
            self._velocity, self._is_kept = velocity, True
        return code

    def stop(self, now_ns: int) -> None:
        """Stop; where [0,0] is being sent already that goes on, since it stops the lift, too, and arms nothing anew."""
        is_off = self.running and not self.is_driven and self._repeated == LIFT_OFF
        super().stop(now_ns)
        if is_off:
            self._repeated = LIFT_OFF

    def keep(self, now_ns: int) -> None:
        """Go on in another process's place: stopped, with its servo on, until the use ends."""
        super().stop(now_ns)
        self._is_kept = True

    def let_go(self) -> None:
        """The use ends without a word: the robot is somebody else's. Stop frames still have their second."""
        self._is_kept = False

    def find(self, now_ns: int) -> None:
        """The transport is back: the use is over. [0,0] stops the lift, too, and arms nothing anew."""
        if self._lost_ns is not None:
            super().find(now_ns)
            self._repeated, self._last, self._is_kept = LIFT_OFF, None, False

    def _run_out(self) -> bool:
        was_moving = self._velocity != 0.0
        self._rest()
        return was_moving

    def _driven(self) -> Vector:
        return (self._velocity, 1.0)
