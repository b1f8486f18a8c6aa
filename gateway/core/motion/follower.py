"""Follower: the next setpoint towards a streamed target, planned anew for each, the axes independent of one another.

The target counts as at rest, as measured best for noisy streams: smooth, with a lag that the acceleration and jerk
limits set. ruckig plans (`Synchronization.No`) from the state it reached itself. What it does not see to, and a follower
does, in any space:

* A velocity limit below the present velocity, from which ruckig takes its braking acceleration back too late: such an
  axis ramps down to the limit, unless it must stop for its target before.
* An acceleration limit below the present acceleration, with which ruckig runs away: a `speed` factor lowers the
  acceleration only from rest on.

That every setpoint can stop inside the limits is seen to by `joints/follower.py` and `poses/pose_follower.py`. None of them
knows a mode, a path or a clock.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

from ruckig import InputParameter, Ruckig, Synchronization, Trajectory

from gateway.core.motion.solver import NoPlan, Plan, solve
from gateway.core.motion.space import State
from gateway.values import Vector

__all__ = ["Follower"]

LIMITED_S = 0.3
"""Time constant over which the remaining time is averaged [s]."""

LIMITED_RATIO = 1.2
"""A remaining time above so many times v/a + a/j means that the limits are what the arm lags for.

Measured with sines of 0.1 to 2 Hz: 0.3 to 1.0 times when they can be followed, 1.5 to 2.4 when the limits do not allow.
"""


class Follower(ABC):
    """Leads one arm to its latest target."""

    def __init__(self, jerks: Sequence[float], period_s: float) -> None:
        self.target: Vector = ()
        """Latest target, inside the limits; empty before the first one of a stream."""
        self.faults = 0
        """How many setpoints had to do without ruckig; the arm braked for them."""
        self._speed = self._bound = 1.0
        """Factors on the velocity limits: of the stream, and of whoever bounds it beside."""
        self._force = 1.0
        """Factor on the acceleration limits of the plans, never below the present acceleration."""
        self._lateness = 0.0
        """Averaged time that the arm would need to rest at the target, in multiples of v/a + a/j."""
        self._gain = min(period_s / LIMITED_S, 1.0)
        self._entry = InputParameter(len(jerks))
        self._entry.synchronization = Synchronization.No
        self._entry.max_jerk = jerks
        self._ruckig = Ruckig(len(jerks))
        self._trajectory = Plan(len(jerks))

    @property
    def is_limited(self) -> bool:
        """Whether the arm is late for its targets because they ask for more than the limits allow.

        That is: resting at the target would take more than 1.2 times as long as stopping from full speed does (v/a + a/j),
        on average over 0.3 s. A target that moves within the limits is followed more closely; a single far one is not.
        """
        return self._lateness > LIMITED_RATIO

    def begin(self) -> None:
        """Begin a stream, without a bound."""
        self.target = ()
        self._bound = self._force = 1.0
        self.forget_lateness()

    def aim(self, target: Vector, speed: float, now: State) -> None:
        """Take a target.

        The target is inside the limits; `speed` is a factor on the velocity limits, 0 < speed <= 1, on the
        accelerations too from rest on.
        """
        self.target, self._speed = target, speed

    def bound(self, speed: float) -> None:
        """Bound the velocity beside the stream's own factor, from the next setpoint on; above it an axis ramps down to it.

        Args:
            speed: Factor on the velocity limits, 0 < speed <= 1; 1 for no bound. A new stream begins without one.
        """
        self._bound = speed

    def disturb(self) -> None:
        """Take note that the arm goes on otherwise than was planned: with any acceleration within the limits."""
        self._force = 1.0

    def forget_lateness(self) -> None:
        """Average anew."""
        self._lateness = 0.0

    @abstractmethod
    def follow(self, now: State) -> State:
        """Return the state one period after `now`, towards the target."""

    def _plan(self, stop_s: float) -> Trajectory | None:
        """Return ruckig's plan of the entry; None where it finds none.

        Args:
            stop_s: Time that a stop from full speed takes, v/a + a/j [s].
        """
        try:
            solve(self._ruckig, self._entry, self._trajectory)
        except NoPlan:
            self.faults += 1
            return None
        self._note_remaining(self._trajectory.duration / stop_s)
        return self._trajectory

    def _note_remaining(self, ratio: float) -> None:
        self._lateness += (ratio - self._lateness) * self._gain
