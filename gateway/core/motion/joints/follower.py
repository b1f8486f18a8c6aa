"""Joint follower: the next setpoint of an arm's joints towards a streamed target (`motion/follower.py`).

Where the next state of a joint would not be stoppable (`braking.py`; a target that flips at speed near a limit), or ruckig
finds no plan, that joint takes one step of its stop instead, which always is. A stop ends at rest, and from rest ruckig only
moves towards the target, so that this ends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from gateway.core.motion.follower import Follower
from gateway.core.motion.joints.braking import REST, Braking, advance
from gateway.core.motion.solver import LONGEST_S
from gateway.core.motion.space import State
from gateway.values import ARM_DOF, Vector

__all__ = ["JointFollower"]

JOINTS = range(ARM_DOF)

UNPLANNED = ((math.nan,) * ARM_DOF,) * 3
"""Stands for the next state where ruckig finds none: it is not stoppable, so every joint takes a step of its stop."""


class JointFollower(Follower):
    """Leads the joints of one arm to their latest target."""

    def __init__(self, braking: Braking) -> None:
        super().__init__((braking.limits.j_radps3,) * ARM_DOF, braking.period_s)
        self._braking = braking
        self._limits = braking.limits
        self._pace = 1.0
        """The lower of both factors on the velocity limit."""
        self._may_be_over = False
        """Whether a joint may be faster than the stream's velocity limit."""
        self._is_slow = False
        """Whether a target may be farther away than ruckig can plan."""
        tiny = braking.tiny_rad
        self._tiny = (tiny, tiny / braking.period_s, tiny / braking.period_s**2)
        """Distance, velocity and acceleration that a setpoint may drop without counting against any limit."""

    def begin(self) -> None:
        """Begin a stream, without a bound."""
        super().begin()
        self._pace = math.nan  # whatever comes is another pace

    def aim(self, target: Vector, speed: float, now: State) -> None:
        """Take a target; the arguments are those of `Follower.aim`."""
        super().aim(target, speed, now)
        self._set_pace()

    def bound(self, speed: float) -> None:
        """Bound the velocity beside the stream's own factor, as `Follower.bound` says."""
        super().bound(speed)
        self._set_pace()

    def _set_pace(self) -> None:
        pace = min(self._speed, self._bound)
        if pace == self._pace:
            return
        self._pace, self._may_be_over = pace, True
        self.disturb()
        spans = zip(self._limits.lower_rad, self._limits.upper_rad, strict=True)
        self._is_slow = pace * self._limits.v_radps * LONGEST_S < max(upper - lower for lower, upper in spans)

    def follow(self, now: State) -> State:
        """Return the state one period after `now`, towards the target."""
        if now[1] == REST and now[2] == REST:
            if now[0] == self.target:
                self._note_remaining(0.0)
                return now
            self._force = self._pace
        v_max = self._pace * self._limits.v_radps
        over = self._over(now, v_max) if self._may_be_over else ()
        tiny_q, tiny_v, tiny_a = self._tiny
        can_stop = self._braking.can_stop
        joints = []
        for n, (q, v, a, target) in enumerate(zip(*self._planned(now, v_max), self.target, strict=True)):
            if n in over:
                q, v, a = self._slowed(n, now, v_max, (q, v, a))
            if abs(q - target) <= tiny_q and abs(v) <= tiny_v and abs(a) <= tiny_a:
                q, v, a = target, 0.0, 0.0
            elif not can_stop(n, q, v, a):
                q, v, a = self._stopped(n, now)
            joints.append((q, v, a))
        return State(*zip(*joints, strict=True))

    def _planned(self, now: State, v_max: float) -> Sequence[Sequence[float]]:
        """Return where ruckig would be in one period, with velocities and accelerations."""
        entry, a_max = self._entry, self._force * self._limits.a_radps2
        entry.current_position, entry.current_velocity, entry.current_acceleration = now
        entry.target_position = self._nearer(now[0]) if self._is_slow else self.target
        entry.max_velocity = (v_max,) * ARM_DOF
        entry.max_acceleration = (a_max,) * ARM_DOF
        plan = self._plan(v_max / a_max + a_max / self._limits.j_radps3)
        return UNPLANNED if plan is None else plan.at_time(self._braking.period_s)

    def _nearer(self, q_rad: Vector) -> Vector:
        """Return the target, or what lies on the way to it where it is farther than ruckig can plan."""
        reach_rad = self._pace * self._limits.v_radps * LONGEST_S
        joints = zip(q_rad, self.target, strict=True)
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
        is_before_target = (self.target[n] - self._braking.rest(*slowed)) * course[4] >= 0.0
        return slowed if is_before_target else planned

    def _stopped(self, n: int, now: State) -> tuple[float, ...]:
        """Return the next state of a joint that stops."""
        self.disturb()  # ruckig must not plan below the acceleration of a stop
        q, v, a = now[0][n], now[1][n], now[2][n]
        return advance(q, v, a, self._braking.stop(v, a), self._braking.period_s)
