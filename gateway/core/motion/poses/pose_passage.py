"""Pose passage: an end effector's way along a trajectory of poses, as `passage.py` is an arm's along one of joints.

The poses are *followed*: each setpoint is one of `pose_follower.py` towards where the trajectory will be a little later,
by as much as the follower lags (which its acceleration and jerk limits set, and the speed). So every limit, the reach
and the unbroken motion are the follower's, whatever the arm did before and whatever replaces what; the price is that
corners are rounded, by some millimetres, about 15 at full speed and acceleration. A trajectory must ask for no more than
is followed (`pose_follower.followed`), or the arm falls behind by centimetres. Ends are those of `passage.py`: at rest at
the last pose, or at speed, after which the arm has to brake when no other trajectory follows.
"""

from __future__ import annotations

import math

from gateway.core.motion.joints.passage import Outcome
from gateway.core.motion.poses.pose_follower import PoseFollower
from gateway.core.motion.poses.pose_state import AxisLimits, PoseDynamics, PoseState
from gateway.core.motion.poses.pose_trajectory import PoseTrajectory
from gateway.core.motion.poses.quaternion import angle_rad
from gateway.values import Vector

__all__ = ["PosePassage"]

JOINED_M = 0.005
JOINED_RAD = 0.03
"""An end effector that near to the trajectory has joined it."""

JOINED_S = 1.0
"""After so long it counts as joined wherever it is, so that a path tolerance is not waited for for ever [s]."""

ROUNDING_S = 1e-9
"""Rounding of a sum of periods [s]."""


class PosePassage:
    """Leads one end effector along one trajectory.

    Args:
        dynamics: Its limits, period and stops.
        trajectory: Inside the reach, and no faster than is followed.
        start_s: Time on the trajectory at which the arm is now [s]; negative when it begins in the future.
        rests: Whether it ends at rest at the last pose; else it ends at speed.
        lead: What the arm follows until this one begins; None when it follows nothing.
    """

    def __init__(
        self,
        dynamics: PoseDynamics,
        trajectory: PoseTrajectory,
        start_s: float,
        *,
        rests: bool,
        lead: PosePassage | None = None,
    ) -> None:
        self.trajectory = trajectory
        self.rests = rests
        self.outcome: Outcome | None = None
        """How it ended; None while it goes on."""
        self.has_joined = False
        """Whether the end effector has been on the trajectory."""
        self._dynamics = dynamics
        self._start_s = start_s
        self._steps = 0
        self._lead = lead
        self._pause: Vector | None = None
        """Where the arm waits when it follows nothing."""
        self._follower = PoseFollower(dynamics)
        self._follower.begin()

    @property
    def time_s(self) -> float:
        """Time on the trajectory [s]; negative before it begins."""
        return self._start_s + self._steps * self._dynamics.period_s

    @property
    def is_waiting(self) -> bool:
        """Whether it has not begun."""
        return self.time_s + self._dynamics.period_s <= 0.0

    @property
    def progress(self) -> float:
        """Part of the trajectory's duration that is behind us, 0..1; 1 only when the arm rests at its end."""
        if self.outcome is Outcome.DONE:
            return 1.0
        return min(max(self.time_s / self.trajectory.duration_s, 0.0), 1.0 - 1e-6)

    @property
    def under_way(self) -> PosePassage | None:
        """What leads the arm now: this one, or while it waits the one before it; None when nothing does."""
        return self._lead if self.is_waiting else self

    def origin(self, now: Vector, rest: Vector) -> Vector:
        """Return the pose at which the arm will be when this one begins.

        Args:
            now: Where it is now.
            rest: Where it would come to rest if it braked now.
        """
        if not self.is_waiting:
            return now
        return rest if self._lead is None else self._lead.place_in(-self.time_s)

    def place_in(self, time_s: float) -> Vector:
        """Return the pose of the trajectory a time from now; at its ends before and after them."""
        return self.trajectory.at(self.time_s + time_s)[0]

    def step(self, now: PoseState) -> PoseState | None:
        """Return the state one period after `now`; None when it has ended and the arm has to brake."""
        if self.outcome is not None:
            return now if self.outcome is Outcome.DONE else None
        if self.is_waiting:
            state = self._wait(now)
            self._steps += 1
            return state
        self._lead = None
        left_s = self.trajectory.duration_s - self.time_s
        if not self.rests and left_s < self._dynamics.period_s - ROUNDING_S:
            self.outcome = Outcome.UNDERRUN
            return None
        self._steps += 1
        self._aim(now)
        state = self._follower.follow(now)
        self._note(state)
        return state

    def _wait(self, now: PoseState) -> PoseState:
        state = self._lead.step(now) if self._lead is not None else None
        if state is not None:
            return state
        self._lead = None
        if self._pause is None:
            stop = self._dynamics.stop(now)
            self._pause = (stop[-1] if stop else now).values
        self._follower.aim(self._pause[:3], self._pause[3:], 1.0, now)
        return self._follower.follow(now)

    def _aim(self, now: PoseState) -> None:
        """Aim at where the trajectory will be by the time at which the follower gets there, axis by axis."""
        _, speeds, turning = self.trajectory.at(self.time_s)
        linear, angular = self._dynamics.linear, self._dynamics.angular
        place = [self.place_in(_lag_s(abs(speed), linear))[n] for n, speed in enumerate(speeds)]
        reach_m = math.hypot(*place)
        if reach_m > self._dynamics.limits.reach_m:
            place = [x * self._dynamics.limits.reach_m / reach_m * (1.0 - 1e-9) for x in place]
        quat = self.place_in(_lag_s(turning, angular))[3:]
        self._follower.aim(tuple(place), quat, 1.0, now)

    def _note(self, state: PoseState) -> None:
        """Take note of where the end effector is now."""
        wanted = self.place_in(0.0)
        off_m, off_rad = math.dist(wanted[:3], state.p_m), angle_rad(wanted[3:], state.quat_xyzw)
        is_near = off_m <= JOINED_M and off_rad <= JOINED_RAD
        self.has_joined = self.has_joined or is_near or self.time_s - max(self._start_s, 0.0) >= JOINED_S
        is_over = self.time_s >= self.trajectory.duration_s - ROUNDING_S
        if self.rests and is_over and state.is_at_rest and state.values == self._follower.target:
            self.outcome = Outcome.DONE


def _lag_s(speed: float, limits: AxisLimits) -> float:
    """Return how far an axis lags behind a target that moves at a speed: the way to stop from it, divided by it [s]."""
    if speed * limits.j >= limits.a * limits.a:
        return 0.5 * (speed / limits.a + limits.a / limits.j)
    return math.sqrt(speed / limits.j)
