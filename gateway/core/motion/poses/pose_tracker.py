"""Pose tracker: an end effector's way along a trajectory of poses (`motion/tracker.py`).

The poses are *followed*: each setpoint is one of `pose_follower.py` towards where the trajectory will be a little later,
by as much as the follower lags (which its acceleration and jerk limits set, and the speed). So every limit, the reach
and the unbroken motion are the follower's, whatever the arm did before and whatever replaces what; the price is that
corners are rounded, by some millimetres, about 15 at full speed and acceleration. A trajectory must ask for no more than
is followed (`pose_follower.followed`), or the arm falls behind by centimetres.
"""

from __future__ import annotations

import math

from gateway.core.motion.poses.pose_follower import PoseFollower
from gateway.core.motion.poses.pose_state import AxisLimits, PoseDynamics
from gateway.core.motion.poses.pose_trajectory import PoseTrajectory
from gateway.core.motion.poses.quaternion import angle_rad
from gateway.core.motion.space import State
from gateway.core.motion.tracker import ROUNDING_S, Outcome, Tracker
from gateway.values import Vector

__all__ = ["PoseTracker", "lag_s"]

JOINED_M = 0.005
JOINED_RAD = 0.03
"""An end effector that near to the trajectory has joined it."""

JOINED_S = 1.0
"""After so long it counts as joined wherever it is, so that a path tolerance is not waited for for ever [s]."""


class PoseTracker(Tracker[PoseTrajectory]):
    """Leads one end effector along one trajectory, inside the reach and no faster than is followed."""

    def __init__(
        self,
        dynamics: PoseDynamics,
        trajectory: PoseTrajectory,
        start_s: float,
        *,
        rests: bool,
        lead: Tracker[PoseTrajectory] | None = None,
    ) -> None:
        super().__init__(dynamics.period_s, trajectory, start_s, rests=rests, lead=lead)
        self._dynamics = dynamics
        self._rest: Vector | None = None
        """Where the arm waits when it follows nothing."""
        self._follower = PoseFollower(dynamics)

    @property
    def is_waiting(self) -> bool:
        """Whether it has not begun."""
        return (
            self.time_s + self._period_s <= 0.0
        )  # rounded otherwise than for joints: a start in whole periods shows it

    def _go_on(self, now: State) -> State | None:
        left_s = self.trajectory.duration_s - self.time_s
        if not self.rests and left_s < self._period_s - ROUNDING_S:
            self.outcome = Outcome.UNDERRUN
            return None
        self._steps += 1
        self._aim(now)
        state = self._follower.follow(now)
        self._note(state)
        return state

    def _pause(self, now: State) -> State:
        if self._rest is None:
            self._rest = self._dynamics.halted(now)
        self._follower.aim(self._rest, 1.0, now)
        return self._follower.follow(now)

    def _aim(self, now: State) -> None:
        """Aim at where the trajectory will be by the time at which the follower gets there, axis by axis."""
        _, speeds, turning = self.trajectory.at(self.time_s)
        linear, angular = self._dynamics.linear, self._dynamics.angular
        place = [self.place_in(lag_s(abs(speed), linear))[n] for n, speed in enumerate(speeds)]
        reach_m = math.hypot(*place)
        if reach_m > self._dynamics.limits.reach_m:
            place = [x * self._dynamics.limits.reach_m / reach_m * (1.0 - 1e-9) for x in place]
        quat = self.place_in(lag_s(turning, angular))[3:]
        self._follower.aim((*place, *quat), 1.0, now)

    def _note(self, state: State) -> None:
        """Take note of where the end effector is now."""
        wanted = self.place_in(0.0)
        off_m, off_rad = math.dist(wanted[:3], state.values[:3]), angle_rad(wanted[3:], state.values[3:])
        is_near = off_m <= JOINED_M and off_rad <= JOINED_RAD
        self.has_joined = self.has_joined or is_near or self.time_s - max(self._start_s, 0.0) >= JOINED_S
        is_over = self.time_s >= self.trajectory.duration_s - ROUNDING_S
        if self.rests and is_over and state.is_at_rest and state.values == self._follower.target:
            self.outcome = Outcome.DONE


def lag_s(speed: float, limits: AxisLimits) -> float:
    """Return how far an axis lags behind a target that moves at a speed: the way to stop from it, divided by it [s]."""
    if speed * limits.j >= limits.a * limits.a:
        return 0.5 * (speed / limits.a + limits.a / limits.j)
    return math.sqrt(speed / limits.j)
