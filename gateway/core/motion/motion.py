"""Motion: one arm's reference, the generator of its setpoints. Its state is the last setpoint it handed out.

Whatever is asked of it, in whatever order, the reference is one continuous motion: position, velocity and
acceleration never jump (but by `seed` and `enter`, while the stream is silent), and the jerk keeps its limit. Setpoints are
samples of that motion at one period, so their finite differences, being averages of its derivatives, keep the limits
as well: v·dt, a·dt², j·dt³. A motion that ends between two samples ends at rest: what follows joins without a step.
Each new plan starts from the exact state of the last setpoint, never from a measured one.

In joints the limits hold for each joint, in poses for the vectors of position and orientation, and the sign of the quaternion
never flips (`space.py`). It never leaves the position limits, or the reach: every setpoint is *stoppable*, that is, braking
from it ends inside. Why that is enough stands in `joints/braking.py` and `poses/pose_state.py`; how it is kept, in the
planners for paths, in the followers for targets and in the trackers for trajectories.

A reference knows no clock: each `step` is one nominal period, so a late tick delays the motion and never makes it
jump.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from typing import Any, Generic

from gateway.core.motion.follower import Follower
from gateway.core.motion.joints.braking import Braking, JointLimits
from gateway.core.motion.joints.follower import JointFollower
from gateway.core.motion.joints.path import Path
from gateway.core.motion.joints.planner import plan_paths
from gateway.core.motion.joints.tracker import JointTracker
from gateway.core.motion.joints.trajectory import Trajectory
from gateway.core.motion.poses.pose_follower import PoseFollower
from gateway.core.motion.poses.pose_path import PosePath, plan_pose_paths
from gateway.core.motion.poses.pose_state import PoseDynamics
from gateway.core.motion.poses.pose_tracker import PoseTracker
from gateway.core.motion.poses.pose_trajectory import PoseTrajectory
from gateway.core.motion.space import Course, PlanFailed, SpaceT, Start, State, check_speed
from gateway.core.motion.tracker import Outcome, Tracker
from gateway.settings.settings import PoseSettings
from gateway.values import Side, Vector

__all__ = [
    "JointLimits",
    "JointReference",
    "Path",
    "PlanFailed",
    "PosePath",
    "PoseReference",
    "Reference",
    "ReferenceMode",
    "plan",
    "plan_poses",
]


class ReferenceMode(str, Enum):
    """What moves the reference."""

    HOLD = "hold"
    PATH = "path"
    FOLLOW = "follow"
    CHUNK = "chunk"
    BRAKE = "brake"


class Reference(Generic[SpaceT]):
    """One arm's setpoint generator."""

    def __init__(self, space: SpaceT, follower: Follower, tracker: Callable[..., Tracker[Any]]) -> None:
        self.space = space
        self.period_s = space.period_s
        """Time between setpoints [s]."""
        self.mode = ReferenceMode.HOLD
        """What moves it."""
        self.state = space.home
        """Where it is: the last setpoint, its velocity and its acceleration."""
        self._follower = follower
        self._make_passage = tracker
        self._course: Course | None = None
        """What PATH and BRAKE sample."""
        self._steps = 0
        """Setpoints handed out of it."""
        self.tracker: Tracker[Any] | None = None
        """What CHUNK follows, and how it ended; None once something else was asked for."""
        self._ahead: State | None = None
        """State of the next setpoint where somebody looked at it before it was handed out."""

    # ------------------------------------------------------------------------------------------------ what is seen

    @property
    def values(self) -> Vector:
        """The last setpoint, shape (7,): joints [rad], or x, y, z [m], qx, qy, qz, qw."""
        return self.state.values

    @property
    def rates(self) -> Vector:
        """Its velocity: of joints [rad/s], or linear [m/s], then angular about the frame's axes [rad/s], shape (6,)."""
        return self.state.v

    @property
    def forces(self) -> Vector:
        """Its acceleration, likewise [rad/s²], [m/s², rad/s²]."""
        return self.state.a

    @property
    def is_at_rest(self) -> bool:
        """Whether nothing moves now; a path or a target may still be pending."""
        return self.state.is_at_rest

    @property
    def progress(self) -> float:
        """Part of the path's (or trajectory's) duration that has been handed out, 0..1; 1 when there is none."""
        if self.mode is ReferenceMode.CHUNK and self.tracker is not None:
            return self.tracker.progress
        if self._course is None or self.mode is not ReferenceMode.PATH:
            return 1.0
        return min(self._steps * self.period_s / self._course.duration_s, 1.0)

    @property
    def is_limited(self) -> bool:
        """Whether the reference is late because the followed targets ask for more than the limits allow (`follower.py`)."""
        return self._follower.is_limited

    @property
    def here(self) -> Start[SpaceT]:
        """Where a plan would begin now."""
        return Start(self.state, self.space)

    def rest_values(self) -> Vector:
        """Return where it would come to rest if it braked now."""
        return self.space.halted(self.state)

    def end_values(self) -> Vector:
        """Return where its path ends; without one where it would come to rest if it braked now."""
        if self._course is None or self.mode is not ReferenceMode.PATH:
            return self.rest_values()
        return self._course.at(self._course.duration_s).values

    def aim_values(self) -> Vector:
        """Return where what it follows leads it, its target or its path's end; else where it would rest."""
        return self._follower.target if self.mode is ReferenceMode.FOLLOW else self.end_values()

    # ------------------------------------------------------------------------------------------------ what is asked

    def seed(self, values: Sequence[float]) -> None:
        """Begin anew at rest: the only way to jump, for a stream that is silent.

        Raises:
            PlanFailed: With what is to blame, value and bound; nothing has changed.
        """
        self.state = self.space.check_place("start", values)
        self.tracker = None
        self._enter(ReferenceMode.HOLD, None)

    def enter(self, values: Sequence[float], rates: Sequence[float], forces: Sequence[float]) -> None:
        """Go on where another reference was interrupted, and brake: for a stream that another process had.

        Raises:
            PlanFailed: It is outside the limits, or cannot brake inside them; nothing has changed.
        """
        self.state = self.space.check_entry(values, rates, forces)
        self._enter(ReferenceMode.HOLD, None)
        self.brake()

    def start(self, course: Course) -> None:
        """Follow a path, or whatever else is a course inside the limits.

        Raises:
            PlanFailed: It begins in another state; nothing has changed.
        """
        if course.start != self.state:
            raise PlanFailed("the path begins in another state than the reference is in: plan it anew")
        self.tracker = None
        if course.duration_s > 0.0:
            self._enter(ReferenceMode.PATH, course)
        else:
            self._enter(ReferenceMode.HOLD, None)

    def follow(self, values: Sequence[float], speed: float = 1.0) -> None:
        """Follow a target, planned anew for each setpoint; the latest one counts.

        Args:
            values: Target, inside the limits.
            speed: Factor on the velocity limits, 0 < speed <= 1; on the accelerations too when it starts at rest.

        Raises:
            PlanFailed: With what is to blame, value and bound; nothing has changed.
        """
        target = self.space.check_place("target", values).values
        check_speed(speed)
        if self.mode is not ReferenceMode.FOLLOW:
            self._follower.begin()
            self._enter(ReferenceMode.FOLLOW, None)
        self._follower.aim(target, speed, self.state)
        self.tracker = self._ahead = None

    def bound(self, speed: float) -> None:
        """Bound the velocity of the followed stream, beside its own factor, from the next plan on.

        Args:
            speed: Factor on the velocity limits, 0 < speed <= 1; 1 for no bound. A new stream begins without one.
        """
        self._follower.bound(speed)

    def prepare(self, trajectory: Trajectory | PoseTrajectory, start_s: float, *, rests: bool) -> Tracker[Any]:
        """Return the way along a trajectory, to be judged and then taken with `track`; nothing changes yet.

        A negative `start_s` begins in the future: until then the arm goes on with the trajectory it follows, or
        brakes. `rests` says whether it ends at rest at its last point.
        """
        lead = None
        if self.mode is ReferenceMode.CHUNK and self.tracker is not None:
            lead = self.tracker.under_way
        return self._make_passage(self.space, trajectory, start_s, rests=rests, lead=lead)

    def origin(self, tracker: Tracker[Any]) -> Vector:
        """Return where the arm will be when a tracker begins."""
        return tracker.origin(self.values, self.rest_values())

    def begin(self, tracker: Tracker[Any]) -> bool:
        """Let a tracker plan its way from the present state, unless it waits; return whether there is one."""
        return tracker.is_sound and (tracker.is_waiting or tracker.begin(self.state))

    def track(self, tracker: Tracker[Any]) -> None:
        """Take the way along a trajectory, begun or waiting at the present state."""
        self._enter(ReferenceMode.CHUNK, None)
        self.tracker = tracker

    def brake(self) -> None:
        """Come to rest as quickly as the limits allow; then hold."""
        self.tracker = None
        if self.is_at_rest:
            self._enter(ReferenceMode.HOLD, None)
        elif self.mode is not ReferenceMode.BRAKE:
            self._enter(ReferenceMode.BRAKE, self.space.halt(self.state))

    def _enter(self, mode: ReferenceMode, course: Course | None) -> None:
        self.mode = mode
        self._course = course
        self._steps = 0
        self._ahead = None
        self._follower.forget_lateness()

    # ------------------------------------------------------------------------------------------------ one period

    def ahead(self) -> State:
        """Return the state of the next setpoint: `step` takes it, unless something else is asked for before. Never raises."""
        if self._ahead is None:
            self._ahead = self._next()
        return self._ahead

    def stop_ahead(self) -> State:
        """Return the state of the next setpoint if it took a step of its stop, whatever moves it now."""
        return self.space.halt(self.state).at(self.period_s)

    def lead(self, state: State) -> None:
        """Have the next `step` take this state instead of the one ahead, while a target is followed.

        Args:
            state: For joints, of each either the one ahead or the one of its stop.
        """
        self._ahead = state
        self._follower.disturb()

    def step(self) -> Vector:
        """Advance by one period and return the setpoint. Never raises."""
        if self.mode is not ReferenceMode.HOLD:
            self.state = self.space.settle(self.ahead(), self.state)
            self._ahead = None
            if self._course is not None:
                self._steps += 1
                if self._steps * self.period_s >= self._course.duration_s:
                    self._enter(ReferenceMode.HOLD, None)
            elif self.mode is ReferenceMode.CHUNK and self.tracker is not None and self.tracker.outcome is Outcome.DONE:
                self._enter(ReferenceMode.HOLD, None)
        return self.state.values

    def _next(self) -> State:
        if self._course is not None:
            return self._course.at((self._steps + 1) * self.period_s)
        if self.mode is ReferenceMode.FOLLOW:
            return self._follower.follow(self.state)
        if self.mode is ReferenceMode.CHUNK and self.tracker is not None:
            tracker = self.tracker
            state = tracker.step(self.state)
            if state is None:
                self.brake()
                self.tracker = tracker
                return self._next()
            return state
        return self.state


class JointReference(Reference[Braking]):
    """One arm's generator of joint setpoints."""

    def __init__(self, limits: JointLimits, period_s: float) -> None:
        braking = Braking(limits, period_s)
        super().__init__(braking, JointFollower(braking), JointTracker)


class PoseReference(Reference[PoseDynamics]):
    """One arm's generator of poses of its end effector."""

    def __init__(self, limits: PoseSettings, period_s: float) -> None:
        dynamics = PoseDynamics(limits, period_s)
        self._leader = PoseFollower(dynamics)
        super().__init__(dynamics, self._leader, PoseTracker)

    def wish(self) -> Vector:
        """Return with what velocity it will go to the followed target from rest, shape (6,) [m/s, rad/s]."""
        return self._leader.wish(self.state)


def plan(
    references: Mapping[Side, JointReference], goals: Mapping[Side, Sequence[float]], speed: float = 1.0
) -> dict[Side, Path]:
    """Plan one motion of all given arms, all joints of all arms ending together.

    Nothing moves, and nothing may have moved, until each arm `start`s its path.

    Args:
        references: Arms that take part; they may be moving.
        goals: For the same arms where it shall rest, shape (7,) each [rad].
        speed: Factor on the velocity limit, 0 < speed <= 1; on the acceleration limit too for an arm at rest.

    Raises:
        PlanFailed: An input is bad, or ruckig finds no plan; with joint, value and bound where one is to blame.
    """
    return plan_paths({side: reference.here for side, reference in references.items()}, goals, speed)


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
    return plan_pose_paths({side: reference.here for side, reference in references.items()}, goals, speed)
