"""Pose motion: the reference of an arm in end-effector mode, as `motion.py` is that of one in joint mode.

Whatever is asked of it, in whatever order, the setpoints are samples of one continuous motion in position and
orientation; linear and angular velocity, acceleration and jerk keep their limits as vectors, and the sign of the
quaternion never flips. It never leaves the reach: every setpoint is *stoppable* (`pose_state.py`), and the stop is what is
taken where nothing else will do. Each `step` is one nominal period: a late tick delays the motion.

What it follows is a *course*: a function of time that begins in the exact state of the reference. Paths are courses
(`pose_path.py`); so is whatever else has `start`, `duration_s` and `at`, keeps the limits of `PoseDynamics.axis` as norms
and the reach, and ends at rest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Protocol

from gateway.core.motion.joints.passage import Outcome
from gateway.core.motion.joints.path import PlanFailed, check_speed
from gateway.core.motion.motion import ReferenceMode
from gateway.core.motion.poses.pose_follower import PoseFollower
from gateway.core.motion.poses.pose_passage import PosePassage
from gateway.core.motion.poses.pose_path import PosePath, PoseStart, check_pose, plan_pose_paths
from gateway.core.motion.poses.pose_state import REACH_SLACK_M, PoseDynamics, PoseLimits, PoseState
from gateway.core.motion.poses.pose_trajectory import PoseTrajectory
from gateway.core.motion.poses.quaternion import aligned
from gateway.values import Side, ValueRefused, Vector, require_finite

__all__ = ["Course", "PoseLimits", "PosePath", "PoseReference", "plan_poses"]

HOME: PoseState = PoseState((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
"""What a reference holds before it is seeded."""

ENTRY_RATIO = 1.0 + 1e-3
"""A motion taken over from another process may exceed a limit by this, for its rounding."""


class Course(Protocol):
    """What a reference can follow: the state as a function of the course's own time."""

    @property
    def start(self) -> PoseState:
        """The state at time 0."""
        ...

    @property
    def duration_s(self) -> float:
        """Time until it rests [s]."""
        ...

    def at(self, time_s: float) -> PoseState:
        """Return the state then; asked at multiples of the period."""
        ...


class PoseReference:
    """One arm's generator of poses.

    Args:
        limits: Limits of the end effector; they always hold.
        period_s: Time between setpoints [s].
    """

    def __init__(self, limits: PoseLimits, period_s: float) -> None:
        self.limits = limits
        self.period_s = period_s
        self.mode = ReferenceMode.HOLD
        """What moves it."""
        self._dynamics = PoseDynamics(limits, period_s)
        self._follower = PoseFollower(self._dynamics)
        self._state = HOME
        self._course: Course | None = None
        self._stop: tuple[PoseState, ...] = ()
        self._steps = 0
        """Setpoints handed out of the course or the stop."""
        self.passage: PosePassage | None = None
        """What CHUNK follows, and how it ended; None once something else was asked for."""

    # ------------------------------------------------------------------------------------------------ what is seen

    @property
    def values(self) -> Vector:
        """The last setpoint: x, y, z [m], qx, qy, qz, qw."""
        return self._state.values

    @property
    def rates(self) -> Vector:
        """Its velocity: linear [m/s], then angular about the frame's axes [rad/s]; shape (6,)."""
        return self._state.v

    @property
    def forces(self) -> Vector:
        """Its acceleration: linear [m/s²], then angular [rad/s²]; shape (6,)."""
        return self._state.a

    @property
    def is_at_rest(self) -> bool:
        """Whether nothing moves now; a path or a target may still be pending."""
        return self._state.is_at_rest

    @property
    def progress(self) -> float:
        """Part of the path's duration that has been handed out, 0..1; 1 when there is no path."""
        if self.mode is ReferenceMode.CHUNK and self.passage is not None:
            return self.passage.progress
        if self._course is None:
            return 1.0
        return min(self._steps * self.period_s / self._course.duration_s, 1.0)

    @property
    def is_limited(self) -> bool:
        """Whether the reference is late because the followed targets ask for more than the limits allow."""
        return self._follower.is_limited

    @property
    def last_fault(self) -> str:
        """What ruckig complained of last while following; the arm braked for that setpoint. Empty when it never did."""
        return self._follower.last_fault

    @property
    def faults(self) -> int:
        """How many setpoints had to do without ruckig."""
        return self._follower.faults

    @property
    def state(self) -> PoseState:
        """Where a course would begin now."""
        return self._state

    @property
    def dynamics(self) -> PoseDynamics:
        """Limits in the form in which plans use them."""
        return self._dynamics

    def rest_values(self) -> Vector:
        """Return where it would come to rest if it braked now."""
        stop = self._dynamics.stop(self._state)
        return (stop[-1] if stop else self._state).values

    # ------------------------------------------------------------------------------------------------ what is asked

    def seed(self, values: Sequence[float]) -> None:
        """Begin anew at rest: the only way to jump, for a stream that is silent.

        Args:
            values: Where: x, y, z [m], qx, qy, qz, qw; inside the reach.

        Raises:
            PlanFailed: With value and bound; nothing has changed.
        """
        self._state = PoseState(*check_pose("start", values, self.limits))
        self.passage = None
        self._enter(ReferenceMode.HOLD)

    def enter(self, values: Sequence[float], rates: Sequence[float], forces: Sequence[float]) -> None:
        """Take over a motion that another process began, from its last setpoint on, and brake.

        Args:
            values: The last setpoint: x, y, z [m], qx, qy, qz, qw.
            rates: Its velocity, as `rates` gives it.
            forces: Its acceleration, as `forces` gives it.

        Raises:
            PlanFailed: It is not finite, or no motion inside the limits; nothing has changed.
        """
        p_m, quat = check_pose("setpoint", values, self.limits, 10.0 * REACH_SLACK_M)
        v, a = tuple(rates), tuple(forces)
        try:
            require_finite("velocity", v, 6)
            require_finite("acceleration", a, 6)
        except ValueRefused as refused:
            raise PlanFailed(str(refused)) from refused
        bounds = (
            ("linear velocity", v[:3], self.limits.v_mps, "m/s"),
            ("angular velocity", v[3:], self.limits.w_radps, "rad/s"),
            ("linear acceleration", a[:3], self.limits.a_mps2, "m/s²"),
            ("angular acceleration", a[3:], self.limits.dw_radps2, "rad/s²"),
        )
        for name, vector, bound, unit in bounds:
            size = math.hypot(*vector)
            if size > bound * ENTRY_RATIO:
                raise PlanFailed(
                    f"{name} {size} {unit} is above {bound} {unit}", joint=name, value=size, bound=str(bound)
                )
        given = tuple(values)[3:]
        # What is held must be repeated to the last bit: normalising anew would round it.
        state = PoseState(p_m, given if abs(math.hypot(*given) - 1.0) < 1e-9 else quat, v, a)
        if not self._dynamics.can_stop(state._replace(p_m=tuple(x * (1.0 - 1e-8) for x in p_m))):
            raise PlanFailed(f"it cannot stop within {self.limits.reach_m} m of the shoulder", joint="reach")
        self._state = state
        self._enter(ReferenceMode.HOLD)
        self.brake()

    def start(self, course: Course) -> None:
        """Follow a course.

        Args:
            course: Planned from the present state.

        Raises:
            PlanFailed: It begins in another state; nothing has changed.
        """
        if course.start != self._state:
            raise PlanFailed("the path begins in another state than the reference is in: plan it anew")
        self.passage = None
        if course.duration_s > 0.0:
            self._enter(ReferenceMode.PATH)
            self._course = course
        else:
            self._enter(ReferenceMode.HOLD)

    def follow(self, values: Sequence[float], speed: float = 1.0) -> None:
        """Follow a target, planned anew for each setpoint; the latest one counts.

        Args:
            values: Target: x, y, z [m], qx, qy, qz, qw; inside the reach.
            speed: Factor on the velocity limits, 0 < speed <= 1; on the accelerations too when it starts at rest.

        Raises:
            PlanFailed: With value and bound; nothing has changed.
        """
        p_m, quat = check_pose("target", values, self.limits)
        check_speed(speed)
        self.passage = None
        if self.mode is not ReferenceMode.FOLLOW:
            self._follower.begin()
            self._enter(ReferenceMode.FOLLOW)
        self._follower.aim(p_m, quat, speed, self._state)

    def bound(self, speed: float) -> None:
        """Bound the velocity of the followed stream, beside its own factor, from the next setpoint on.

        Args:
            speed: Factor on the velocity limits, 0 < speed <= 1; 1 for no bound. A new stream begins without one.
        """
        self._follower.bound(speed)

    def wish(self) -> Vector:
        """Return with what velocity it will go to the followed target from rest, shape (6,) [m/s, rad/s]."""
        return self._follower.wish(self._state)

    def prepare(self, trajectory: PoseTrajectory, start_s: float, *, rests: bool) -> PosePassage:
        """Return the way along a trajectory, to be judged and then taken with `track`; nothing changes yet.

        Args:
            trajectory: Inside the reach, and no faster than is followed (`pose_follower.followed`).
            start_s: Time on it that is now [s]; negative when it begins in the future: until then the arm goes on with
                the trajectory it follows, or brakes.
            rests: Whether it ends at rest at its last pose.
        """
        lead = None
        if self.mode is ReferenceMode.CHUNK and self.passage is not None:
            lead = self.passage.under_way
        return PosePassage(self._dynamics, trajectory, start_s, rests=rests, lead=lead)

    def origin(self, passage: PosePassage) -> Vector:
        """Return the pose at which the arm will be when a passage begins."""
        return passage.origin(self.values, self.rest_values())

    def track(self, passage: PosePassage) -> None:
        """Take the way along a trajectory."""
        self._enter(ReferenceMode.CHUNK)
        self.passage = passage

    def brake(self) -> None:
        """Come to rest as quickly as the plans' limits allow, then hold."""
        self.passage = None
        if self.is_at_rest:
            self._enter(ReferenceMode.HOLD)
        elif self.mode is not ReferenceMode.BRAKE:
            self._enter(ReferenceMode.BRAKE)
            self._stop = self._dynamics.stop(self._state)

    def _enter(self, mode: ReferenceMode) -> None:
        self.mode = mode
        self._course = None
        self._stop = ()
        self._steps = 0
        self._follower.forget_lateness()

    # ------------------------------------------------------------------------------------------------ one period

    def step(self) -> Vector:
        """Advance by one period and return the setpoint. Never raises."""
        if self._course is not None:
            self._steps += 1
            time_s = self._steps * self.period_s
            self._take(self._course.at(time_s))
            if time_s >= self._course.duration_s:
                self._enter(ReferenceMode.HOLD)
        elif self.mode is ReferenceMode.BRAKE:
            self._steps += 1
            self._take(self._stop[self._steps - 1])
            if self._steps == len(self._stop):
                self._enter(ReferenceMode.HOLD)
        elif self.mode is ReferenceMode.FOLLOW:
            self._take(self._follower.follow(self._state))
        elif self.mode is ReferenceMode.CHUNK and self.passage is not None:
            self._track(self.passage)
        return self.values

    def _track(self, passage: PosePassage) -> None:
        state = passage.step(self._state)
        if state is not None:
            self._take(state)
        if passage.outcome is Outcome.DONE:
            self._enter(ReferenceMode.HOLD)
        elif state is None:
            self.brake()
            self.passage = passage
            self.step()

    def _take(self, state: PoseState) -> None:
        """Take a state, its quaternion in the sign that goes on from the last one."""
        self._state = state._replace(quat_xyzw=aligned(state.quat_xyzw, self._state.quat_xyzw))


def plan_poses(
    references: Mapping[Side, PoseReference], goals: Mapping[Side, Sequence[float]], speed: float = 1.0
) -> dict[Side, PosePath]:
    """Plan one motion of all given arms, position and orientation of all of them ending together.

    Nothing moves, and nothing may have moved, until each arm `start`s its path.

    Args:
        references: Arms that take part; they may be moving.
        goals: For the same arms where it shall rest: x, y, z [m], qx, qy, qz, qw.
        speed: Factor on the velocity limits, 0 < speed <= 1; on the accelerations too when all start at rest.

    Raises:
        PlanFailed: An input is bad, or ruckig finds no plan; with what is to blame where it is one value.
    """
    starts = {
        side: PoseStart(state=reference.state, dynamics=reference.dynamics) for side, reference in references.items()
    }
    return plan_pose_paths(starts, goals, speed)
