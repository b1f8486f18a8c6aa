"""Follower: the next setpoint towards a streamed target, planned anew for each, the joints independent of one another.

The target counts as at rest, as measured best for noisy streams: smooth, with a lag that the acceleration and jerk
limits set. ruckig plans (`Synchronization.No`) from the state it reached itself. What it does not see to, and this
module does:

* Position limits. Where the next state of a joint would not be stoppable (`braking.py`; a target that flips at speed
  near a limit), or ruckig finds no plan, that joint takes one step of its stop instead, which always is. A stop ends
  at rest, and from rest ruckig only moves towards the target, so that this ends.
* A velocity limit below the present velocity, from which ruckig takes its braking acceleration back too late: such a
  joint ramps down to the limit, unless it must stop for its target before.
* An acceleration limit below the present acceleration, with which ruckig runs away: a `speed` factor lowers the
  acceleration only from rest on.

This module knows no mode, no path and no clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from ruckig import InputParameter, Ruckig, Synchronization, Trajectory

from gateway.core.motion.joints.braking import Braking, advance
from gateway.core.motion.joints.path import REST, State
from gateway.core.motion.joints.solver import LONGEST_S, NoPlan, solve
from gateway.values import ARM_DOF, Vector

__all__ = ["Follower"]

JOINTS = range(ARM_DOF)

LIMITED_S = 0.3
"""Time constant over which the remaining time is averaged [s]."""

LIMITED_RATIO = 1.2
"""A remaining time above so many times v/a + a/j means that the limits are what the arm lags for.

Measured with sines of 0.1 to 2 Hz: 0.3 to 1.0 times when they can be followed, 1.5 to 2.4 when the limits do not allow.
"""

UNPLANNED: State = ((math.nan,) * ARM_DOF,) * 3
"""Stands for the next state where ruckig finds none: it is not stoppable, so every joint takes a step of its stop."""


class Follower:
    """Leads one arm to its latest target.

    Args:
        braking: The arm's limits, period and brakes.
    """

    def __init__(self, braking: Braking) -> None:
        self.target_rad: Vector = REST
        """Latest target, inside the limits [rad]."""
        self.last_fault = ""
        """What ruckig complained of last; the arm braked for that setpoint. Empty when it never did."""
        self.faults = 0
        """How many setpoints had to do without ruckig."""
        self._braking = braking
        self._limits = braking.limits
        self._speed = 1.0
        self._a_max = braking.limits.a_radps2
        """Acceleration limit of the plans [rad/s²], never below the present acceleration."""
        self._may_be_over = False
        """Whether a joint may be faster than the stream's velocity limit."""
        self._is_slow = False
        """Whether a target may be farther away than ruckig can plan."""
        self._lateness = 0.0
        """Averaged time that the arm would need to rest at the target, in multiples of v/a + a/j."""
        tiny = braking.tiny_rad
        self._tiny = (tiny, tiny / braking.period_s, tiny / braking.period_s**2)
        """Distance, velocity and acceleration that a setpoint may drop without counting against any limit."""
        self._entry = InputParameter(ARM_DOF)
        self._entry.synchronization = Synchronization.No
        self._entry.max_jerk = (braking.limits.j_radps3,) * ARM_DOF
        self._planner = Ruckig(ARM_DOF)
        self._trajectory = Trajectory(ARM_DOF)

    @property
    def speed(self) -> float:
        """Factor of the stream on the velocity limit."""
        return self._speed

    @property
    def is_limited(self) -> bool:
        """Whether the arm is late for its targets because they ask for more than the limits allow.

        That is: resting at the target would take more than 1.2 times as long as stopping from full speed does (v/a + a/j),
        on average over 0.3 s. A target that moves within the limits is followed more closely; a single far one is not.
        """
        return self._lateness > LIMITED_RATIO

    def begin(self, speed: float) -> None:
        """Begin a stream, or go on with another factor.

        Args:
            speed: Factor on the velocity limit, 0 < speed <= 1; on the acceleration limit too from rest on.
        """
        self._speed = speed
        self._a_max = self._limits.a_radps2
        self._may_be_over = True
        spans = zip(self._limits.lower_rad, self._limits.upper_rad, strict=True)
        self._is_slow = speed * self._limits.v_radps * LONGEST_S < max(upper - lower for lower, upper in spans)

    def disturb(self) -> None:
        """Take note that the arm goes on otherwise than was planned: with any acceleration within the limits."""
        self._a_max = self._limits.a_radps2

    def forget_lateness(self) -> None:
        """Average anew."""
        self._lateness = 0.0

    def follow(self, now: State) -> State:
        """Return the state one period after `now`, towards the target."""
        if now[1] == REST and now[2] == REST:
            if now[0] == self.target_rad:
                self._note_remaining(0.0)
                return now
            self._a_max = self._speed * self._limits.a_radps2
        v_max = self._speed * self._limits.v_radps
        over = self._over(now, v_max) if self._may_be_over else ()
        tiny_q, tiny_v, tiny_a = self._tiny
        can_stop = self._braking.can_stop
        joints = []
        for n, (q, v, a, target) in enumerate(zip(*self._planned(now, v_max), self.target_rad, strict=True)):
            if n in over:
                q, v, a = self._slowed(n, now, v_max, (q, v, a))
            if abs(q - target) <= tiny_q and abs(v) <= tiny_v and abs(a) <= tiny_a:
                q, v, a = target, 0.0, 0.0
            elif not can_stop(n, q, v, a):
                q, v, a = self._stopped(n, now)
            joints.append((q, v, a))
        q_rad, dq_radps, ddq_radps2 = zip(*joints, strict=True)
        return q_rad, dq_radps, ddq_radps2

    def _planned(self, now: State, v_max: float) -> State:
        """Return where ruckig would be in one period."""
        entry = self._entry
        entry.current_position, entry.current_velocity, entry.current_acceleration = now
        entry.target_position = self._nearer(now[0]) if self._is_slow else self.target_rad
        entry.max_velocity = (v_max,) * ARM_DOF
        entry.max_acceleration = (self._a_max,) * ARM_DOF
        try:
            solve(self._planner, entry, self._trajectory)
        except NoPlan as none:
            self.last_fault = str(none)
            self.faults += 1
            return UNPLANNED
        self._note_remaining(self._trajectory.duration / (v_max / self._a_max + self._a_max / self._limits.j_radps3))
        state: State = self._trajectory.at_time(self._braking.period_s)
        return state

    def _nearer(self, q_rad: Vector) -> Vector:
        """Return the target, or what lies on the way to it where it is farther than ruckig can plan."""
        reach_rad = self._speed * self._limits.v_radps * LONGEST_S
        joints = zip(q_rad, self.target_rad, strict=True)
        return tuple(min(max(target, q - reach_rad), q + reach_rad) for q, target in joints)

    def _over(self, now: State, v_max: float) -> Sequence[int]:
        """Return the joints that are faster than the stream's velocity limit: it began, or became slower, in motion."""
        over = [n for n in JOINTS if self._braking.is_over(now[1][n], now[2][n], v_max)]
        self._may_be_over = bool(over)
        return over

    def _slowed(self, n: int, now: State, v_max: float, planned: tuple[float, ...]) -> tuple[float, ...]:
        """Return the next state of a joint that is above its velocity limit.

        It ramps down to the limit as long as it can stop at its target after that; else what ruckig plans stands: to
        brake as hard as it can.
        """
        q, v, a = now[0][n], now[1][n], now[2][n]
        course = self._braking.slow(v, a, v_max)
        slowed = advance(q, v, a, course, self._braking.period_s)
        is_before_target = (self.target_rad[n] - self._braking.rest(*slowed)) * course[4] >= 0.0
        return slowed if is_before_target else planned

    def _stopped(self, n: int, now: State) -> tuple[float, ...]:
        """Return the next state of a joint that stops."""
        self.disturb()  # ruckig must not plan below the acceleration of a stop
        q, v, a = now[0][n], now[1][n], now[2][n]
        return advance(q, v, a, self._braking.stop(v, a), self._braking.period_s)

    def _note_remaining(self, ratio: float) -> None:
        self._lateness += (ratio - self._lateness) * min(self._braking.period_s / LIMITED_S, 1.0)
