"""Pose follower: the next setpoint towards a streamed pose, planned anew for each, the six axes independent of one another.

As for joints (`follower.py`) the target counts as at rest, and ruckig plans from the state it reached itself. What it
does not see to, and this module does:

* Norms. Each axis gets a share of the speed, most of it the one that has furthest to go; an axis keeps what it already
  has until its target makes it slower, so that the shares always add up (`pose_state.share`).
* A speed limit below the present speed, from which ruckig takes its braking acceleration back too late: such an axis
  ramps down to the limit, unless it must stop for its target before.
* The reach. Where the stop from the next state would leave it, a target nearer to the shoulder is followed for that
  setpoint; the shoulder itself is always inward. Where none will do, the stop is taken.
* The way round. A target half a turn away may be reached either way; one that is followed keeps its way while the target
  moves a little beyond half a turn, so that noise cannot make the arm waver.

This module knows no mode, no path and no clock.
"""

from __future__ import annotations

import math

from ruckig import InputParameter, Ruckig, Synchronization, Trajectory

from gateway.core.motion.joints.braking import OVER_RATIO, ROUNDING_RAD, TINY_RATIO, advance, duration, ramp
from gateway.core.motion.joints.solver import LONGEST_S, NoPlan, solve
from gateway.core.motion.poses.pose_state import REST6, PoseDynamics, PoseState, carry, share
from gateway.core.motion.poses.quaternion import aligned, conjugate, long_log, multiply
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

LIMITED_S = 0.3
LIMITED_RATIO = 1.2
"""As in `follower.py`: averaging time [s], and the remaining time, in multiples of v/a + a/j, that tells of lateness."""


def followed(dynamics: PoseDynamics) -> tuple[float, float, float, float, float]:
    """Return what a moving target may ask for in any direction; the arm falls behind one that asks for more.

    Args:
        dynamics: Limits of the end effector.

    Returns:
        Distance from the shoulder [m], linear speed [m/s] and acceleration [m/s²], angular speed [rad/s] and acceleration
        [rad/s²].
    """
    linear, angular = dynamics.linear, dynamics.angular
    return dynamics.limits.reach_m, AXIS_RATIO * linear.speed, linear.a, AXIS_RATIO * angular.speed, angular.a


class PoseFollower:
    """Leads one end effector to its latest target.

    Args:
        dynamics: Its limits and its stops.
    """

    def __init__(self, dynamics: PoseDynamics) -> None:
        self.last_fault = ""
        """What ruckig complained of last; that setpoint was one of the stop. Empty when it never did."""
        self.faults = 0
        """How many setpoints had to do without ruckig."""
        self._dynamics = dynamics
        self._speed = self._bound = 1.0
        self._force = 1.0
        """Factor on the acceleration: that of the speed from rest on."""
        self._p_m: Vector = (0.0, 0.0, 0.0)
        self._quat: Vector = (0.0, 0.0, 0.0, 1.0)
        self._has_target = False
        self._lateness = 0.0
        tiny = []
        for group in (dynamics.linear, dynamics.angular):
            x = max(TINY_RATIO * group.j * dynamics.period_s**3, ROUNDING_RAD)
            tiny.append((x, x / dynamics.period_s, x / dynamics.period_s**2))
        self._tiny = tuple(tiny[n // 3] for n in AXES)
        """Per axis distance, velocity and acceleration that a setpoint may drop without counting against any limit."""
        self._entry = InputParameter(6)
        self._entry.synchronization = Synchronization.No
        self._entry.max_jerk = [dynamics.axis(n).j for n in AXES]
        self._planner = Ruckig(6)
        self._trajectory = Trajectory(6)

    @property
    def speed(self) -> float:
        """Factor of the stream on the velocity limits."""
        return self._speed

    @property
    def is_limited(self) -> bool:
        """Whether the arm is late for its targets because they ask for more than the limits allow."""
        return self._lateness > LIMITED_RATIO

    @property
    def target(self) -> Vector:
        """The latest target, in the sign in which it is reached; shape (7,)."""
        return self._p_m + self._quat

    def begin(self) -> None:
        """Begin a stream: the next target is reached on the shorter way."""
        self._has_target, self._force, self._lateness = False, 1.0, 0.0
        self._bound = 1.0

    def bound(self, speed: float) -> None:
        """Bound the velocity beside the stream's own factor, from the next setpoint on; above it an axis ramps down to it.

        Args:
            speed: Factor on the velocity limits, 0 < speed <= 1; 1 for no bound. A new stream begins without one.
        """
        self._bound = speed

    def wish(self, now: PoseState) -> Vector:
        """Return with what velocity it will go to its target from rest, shape (6,) [m/s, rad/s]; 0 where it is there.

        Args:
            now: The present state.
        """
        if not self._has_target:
            return REST6
        linear = tuple([x - x0 for x, x0 in zip(self._p_m, now.p_m, strict=True)])
        parts: list[float] = []
        for way, group in ((linear, self._dynamics.linear), (self._way(now.quat_xyzw), self._dynamics.angular)):
            length = math.hypot(*way)
            parts += [x * min(1.0 / NEAR_S, group.speed / length) if length else 0.0 for x in way]
        return tuple(parts)

    def aim(self, p_m: Vector, quat_xyzw: Vector, speed: float, now: PoseState) -> None:
        """Take a target.

        Args:
            p_m: Position inside the reach [m].
            quat_xyzw: Orientation, unit norm, in either sign.
            speed: Factor on the velocity limits, 0 < speed <= 1; on the accelerations too from rest on.
            now: The present state.
        """
        self._p_m = p_m
        self._quat = aligned(quat_xyzw, self._quat if self._has_target else now.quat_xyzw)
        self._speed, self._has_target = speed, True

    def follow(self, now: PoseState) -> PoseState:
        """Return the state one period after `now`, towards the target."""
        way = self._way(now.quat_xyzw)
        if now.is_at_rest:
            if now.values == self.target:
                self._note_remaining(0.0)
                return now
            self._force = self._speed
        for pull in PULLS:
            planned = self._planned(now, tuple(pull * x for x in self._p_m) + way)
            if planned is None:
                break
            if self._dynamics.can_stop(planned):
                return planned
        # From here on the acceleration may be any within the limits, and ruckig must not plan below it.
        self._force = 1.0
        return next(iter(self._dynamics.stop(now)), now)

    def _way(self, quat: Vector) -> Vector:
        """Return the rotation vector from an orientation to the target [rad]; shape (3,)."""
        way = long_log(multiply(self._quat, conjugate(quat)))
        if math.hypot(*way) > math.pi + LONGER_RAD:
            self._quat = tuple(-c for c in self._quat)
            way = long_log(multiply(self._quat, conjugate(quat)))
        return way

    def _planned(self, now: PoseState, target: Vector) -> PoseState | None:
        """Return where ruckig would be in one period; None where it finds no plan.

        Args:
            now: The present state.
            target: Position [m], and rotation vector from the present orientation [rad].
        """
        dynamics, entry = self._dynamics, self._entry
        start = (*now.p_m, 0.0, 0.0, 0.0)
        forces = [max(self._force * dynamics.axis(n).a, abs(a)) for n, a in enumerate(now.a)]
        peaks, speeds = self._speeds(now, start, target)
        entry.current_position, entry.current_velocity, entry.current_acceleration = start, now.v, now.a
        entry.target_position = [
            min(max(x, x0 - v * LONGEST_S), x0 + v * LONGEST_S) for x, x0, v in zip(target, start, speeds, strict=True)
        ]
        entry.max_velocity = [max(v, p) for v, p in zip(speeds, peaks, strict=True)]
        entry.max_acceleration = forces
        try:
            solve(self._planner, entry, self._trajectory)
        except NoPlan as none:
            self.last_fault = str(none)
            self.faults += 1
            return None
        self._note_remaining(self._trajectory.duration / self._longest_s)
        axes = []
        for n, (x, v, a) in enumerate(zip(*self._trajectory.at_time(dynamics.period_s), strict=True)):
            tiny_x, tiny_v, tiny_a = self._tiny[n]
            if peaks[n] > speeds[n] * OVER_RATIO:
                x, v, a = self._slowed(n, (start[n], now.v[n], now.a[n]), speeds[n], target[n], (x, v, a))
            if abs(x - target[n]) <= tiny_x and abs(v) <= tiny_v and abs(a) <= tiny_a:
                x, v, a = target[n], 0.0, 0.0
            axes.append((x, v, a))
        place, rates, forces_then = (tuple(column) for column in zip(*axes, strict=True))
        state = carry(now.quat_xyzw, place, rates, forces_then)
        if place[3:] == target[3:] and not any(rates[3:]) and not any(forces_then[3:]):
            state = state._replace(quat_xyzw=self._quat)
        return state

    def _speeds(self, now: PoseState, start: Vector, target: Vector) -> tuple[list[float], list[float]]:
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

    def _note_remaining(self, ratio: float) -> None:
        self._lateness += (ratio - self._lateness) * min(self._dynamics.period_s / LIMITED_S, 1.0)

    def forget_lateness(self) -> None:
        """Average anew."""
        self._lateness = 0.0
