"""Pose follower: the next setpoint of an end effector towards a streamed pose, on six axes (`motion/follower.py`).

What it sees to beside:

* Norms. Each axis gets a share of the speed, most of it the one that has furthest to go; an axis keeps what it already
  has until its target makes it slower, so that the shares always add up (`pose_state.share`).
* The reach. Where the stop from the next state would leave it, a target nearer to the shoulder is followed for that
  setpoint; the shoulder itself is always inward. Where none will do, the stop is taken.
* The way round. A target half a turn away may be reached either way; one that is followed keeps its way while the target
  moves a little beyond half a turn, so that noise cannot make the arm waver.
"""

from __future__ import annotations

import math

from gateway.core.motion.follower import Follower
from gateway.core.motion.joints.braking import OVER_RATIO, ROUNDING_RAD, TINY_RATIO, advance, duration, ramp
from gateway.core.motion.poses.pose_state import REST6, PoseDynamics, carry, share
from gateway.core.motion.poses.quaternion import aligned, conjugate, long_log, multiply
from gateway.core.motion.solver import LONGEST_S
from gateway.core.motion.space import State
from gateway.values import Vector

__all__ = ["PoseFollower", "followed"]

AXES = range(6)

PULLS = (1.0, 0.9, 0.7, 0.4, 0.0)
"""Parts of the target's distance from the shoulder to try near the end of the reach."""

EVEN = 0.25
"""Part of the squared speed that is divided evenly among the axes; the rest goes where the way is."""

AXIS_RATIO = math.sqrt(1.0 - EVEN + EVEN / 3.0)
"""Part of the speed with which a target along one axis is followed; in every other direction it is more."""

LONGER_RAD = 0.3
"""A target may move so far beyond half a turn before the other way is taken [rad]."""

NEAR_S = 0.1
"""What is nearer than full speed takes it in this time is not gone for at full speed [s]."""


def followed(dynamics: PoseDynamics, speed: float = 1.0) -> tuple[float, float, float, float, float]:
    """Return what a moving target may ask for in any direction; the arm falls behind one that asks for more.

    Args:
        dynamics: The limits.
        speed: Factor on those of velocity, 0 < speed <= 1.

    Returns:
        Distance from the shoulder [m], linear speed [m/s] and acceleration [m/s²], angular speed [rad/s] and acceleration
        [rad/s²].
    """
    linear, angular = dynamics.linear, dynamics.angular
    ratio = AXIS_RATIO * speed
    return dynamics.limits.reach_m, ratio * linear.speed, linear.a, ratio * angular.speed, angular.a


class PoseFollower(Follower):
    """Leads one end effector to its latest target."""

    def __init__(self, dynamics: PoseDynamics) -> None:
        super().__init__([dynamics.axis(n).j for n in AXES], dynamics.period_s)
        self._dynamics = dynamics
        tiny = []
        for group in (dynamics.linear, dynamics.angular):
            x = max(TINY_RATIO * group.j * dynamics.period_s**3, ROUNDING_RAD)
            tiny.append((x, x / dynamics.period_s, x / dynamics.period_s**2))
        self._tiny = tuple(tiny[n // 3] for n in AXES)
        """Per axis distance, velocity and acceleration that a setpoint may drop without counting against any limit."""

    def wish(self, now: State) -> Vector:
        """Return with what velocity it will go to its target from rest, shape (6,) [m/s, rad/s]; 0 where it is there."""
        if not self.target:
            return REST6
        linear = tuple([x - x0 for x, x0 in zip(self.target[:3], now.values[:3], strict=True)])
        parts: list[float] = []
        for way, group in ((linear, self._dynamics.linear), (self._way(now.values[3:]), self._dynamics.angular)):
            length = math.hypot(*way)
            parts += [x * min(1.0 / NEAR_S, group.speed / length) if length else 0.0 for x in way]
        return tuple(parts)

    def aim(self, target: Vector, speed: float, now: State) -> None:
        """Take a target, its orientation in either sign; the first one of a stream is reached on the shorter way."""
        quat = aligned(target[3:], (self.target or now.values)[3:])
        super().aim(target[:3] + quat, speed, now)

    def follow(self, now: State) -> State:
        """Return the state one period after `now`, towards the target."""
        way = self._way(now.values[3:])
        if now.is_at_rest:
            if now.values == self.target:
                self._note_remaining(0.0)
                return now
            self._force = self._speed
        for pull in PULLS:
            planned = self._planned(now, tuple([pull * x for x in self.target[:3]]) + way)
            if planned is None:
                break
            if self._dynamics.can_stop(planned):
                return planned
        self.disturb()  # ruckig must not plan below the acceleration of a stop
        return self._dynamics.halt(now).at(self._dynamics.period_s)

    def _way(self, quat: Vector) -> Vector:
        """Return the rotation vector from an orientation to the target [rad]; shape (3,)."""
        way = long_log(multiply(self.target[3:], conjugate(quat)))
        if math.hypot(*way) > math.pi + LONGER_RAD:
            self.target = self.target[:3] + tuple(-c for c in self.target[3:])
            way = long_log(multiply(self.target[3:], conjugate(quat)))
        return way

    def _planned(self, now: State, target: Vector) -> State | None:
        """Return where ruckig would be in one period; None where it finds no plan.

        Args:
            now: The present state.
            target: Position [m], and rotation vector from the present orientation [rad].
        """
        dynamics, entry = self._dynamics, self._entry
        start = (*now.values[:3], 0.0, 0.0, 0.0)
        forces = [max(self._force * dynamics.axis(n).a, abs(a)) for n, a in enumerate(now.a)]
        peaks, speeds = self._speeds(now, start, target)
        entry.current_position, entry.current_velocity, entry.current_acceleration = start, now.v, now.a
        entry.target_position = [
            min(max(x, x0 - v * LONGEST_S), x0 + v * LONGEST_S) for x, x0, v in zip(target, start, speeds, strict=True)
        ]
        entry.max_velocity = [max(v, p) for v, p in zip(speeds, peaks, strict=True)]
        entry.max_acceleration = forces
        plan = self._plan(self._longest_s)
        if plan is None:
            return None
        axes = []
        for n, (x, v, a) in enumerate(zip(*plan.at_time(dynamics.period_s), strict=True)):
            tiny_x, tiny_v, tiny_a = self._tiny[n]
            if peaks[n] > speeds[n] * OVER_RATIO:
                x, v, a = self._slowed(n, (start[n], now.v[n], now.a[n]), speeds[n], target[n], (x, v, a))
            if abs(x - target[n]) <= tiny_x and abs(v) <= tiny_v and abs(a) <= tiny_a:
                x, v, a = target[n], 0.0, 0.0
            axes.append((x, v, a))
        place, rates, forces_then = (tuple(column) for column in zip(*axes, strict=True))
        state = carry(now.values[3:], place, rates, forces_then)
        if place[3:] == target[3:] and not any(rates[3:]) and not any(forces_then[3:]):
            state = state._replace(values=state.values[:3] + self.target[3:])
        return state

    def _speeds(self, now: State, start: Vector, target: Vector) -> tuple[list[float], list[float]]:
        """Return per axis the speed that it has or is bound for, and the one that it may have."""
        dynamics = self._dynamics
        peaks: list[float] = []
        for n, (v, a) in enumerate(zip(now.v, now.a, strict=True)):
            peaks.append(max(abs(v), abs(v + a * abs(a) / (2.0 * dynamics.axis(n).j))))
        speeds: list[float] = []
        for first, group in ((0, dynamics.linear), (3, dynamics.angular)):
            axes = slice(first, first + 3)
            total = min(self._speed, self._bound) * group.speed
            way = [x - x0 for x, x0 in zip(target[axes], start[axes], strict=True)]
            length = math.hypot(*way)
            parts = [(x / length) ** 2 if length else 1.0 / 3.0 for x in way]
            want = tuple(total * math.sqrt((1.0 - EVEN) * part + EVEN / 3.0) for part in parts)
            speeds += share(tuple(peaks[axes]), want, total)
        return peaks, speeds

    def _slowed(
        self, n: int, now: tuple[float, float, float], limit: float, target: float, planned: tuple[float, float, float]
    ) -> tuple[float, float, float]:
        """Return the next state of an axis that is above its speed limit: down to it, unless its target comes before."""
        x, v, a = now
        force, jerk = max(self._dynamics.axis(n).a, abs(a)), self._dynamics.axis(n).j
        bound_for = v + a * abs(a) / (2.0 * jerk)
        course = ramp(v, a, min(max(bound_for, -limit), limit), force, jerk)
        slowed = advance(x, v, a, course, self._dynamics.period_s)
        stop = ramp(slowed[1], slowed[2], 0.0, max(force, abs(slowed[2])), jerk)
        rest = advance(*slowed, stop, duration(stop))[0]
        return slowed if (target - rest) * course[4] >= 0.0 else planned

    @property
    def _longest_s(self) -> float:
        """Time that the slower of position and orientation takes to come to rest from full speed [s]."""
        groups = (self._dynamics.linear, self._dynamics.angular)
        return max(self._speed * g.speed / (self._force * g.a) + self._force * g.a / g.j for g in groups)
