"""Motion: one arm's reference, the generator of its setpoints. Its state is the last setpoint it handed out.

Whatever is asked of it, in whatever order, the reference is one continuous motion: position, velocity and
acceleration never jump (but by `seed` and `enter`, while the stream is silent), and the jerk keeps its limit. Setpoints are
samples of that motion at one period, so their finite differences, being averages of its derivatives, keep the limits
as well: v·dt, a·dt², j·dt³. A motion that ends between two samples ends at rest: what follows joins without a step.
 Each new plan starts from the exact state of the last setpoint, never from a
measured one.

It never leaves the position limits: every setpoint is *stoppable*, that is, braking from it ends inside. Why that is
enough stands in `braking.py`; how it is kept, in `planner.py` for paths, in `follower.py` for targets and in
`passage.py` for trajectories.

A reference knows no clock: each `step` is one nominal period, so a late tick delays the motion and never makes it
jump.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import Enum

from gateway.core.motion.joints.braking import Braking, JointLimits
from gateway.core.motion.joints.follower import Follower
from gateway.core.motion.joints.passage import Outcome, Passage
from gateway.core.motion.joints.path import (
    REST,
    Path,
    PlanFailed,
    Slowing,
    Start,
    State,
    check_entry,
    check_goal,
    check_speed,
)
from gateway.core.motion.joints.planner import plan_paths
from gateway.core.motion.joints.trajectory import Trajectory
from gateway.core.motion.lines.line_path import LinePath
from gateway.values import Side, Vector

__all__ = ["JointLimits", "JointReference", "Path", "PlanFailed", "ReferenceMode", "plan"]


class ReferenceMode(str, Enum):
    """What moves the reference."""

    HOLD = "hold"
    PATH = "path"
    FOLLOW = "follow"
    CHUNK = "chunk"
    BRAKE = "brake"


class JointReference:
    """One arm's setpoint generator.

    Args:
        limits: Limits of the arm's joints; they always hold.
        period_s: Time between setpoints [s].
    """

    def __init__(self, limits: JointLimits, period_s: float) -> None:
        self.limits = limits
        self.period_s = period_s
        self.mode = ReferenceMode.HOLD
        """What moves it."""
        self._braking = Braking(limits, period_s)
        self._follower = Follower(self._braking)
        self._q: Vector = self._braking.land(REST, REST)
        self._v = self._a = REST
        self._course: Path | LinePath | Slowing | None = None
        """What PATH and BRAKE sample."""
        self._steps = 0
        """Setpoints handed out of it."""
        self.passage: Passage | None = None
        """What CHUNK follows, and how it ended; None once something else was asked for."""
        self._ahead: State | None = None
        """State of the next setpoint where somebody looked at it before it was handed out."""
        self._speed = self._bound = 1.0
        """Factors on the velocity limit: of the followed stream, and of whoever keeps parts of the body apart."""

    # ------------------------------------------------------------------------------------------------ what is seen

    @property
    def q_rad(self) -> Vector:
        """The last setpoint, shape (7,) [rad]."""
        return self._q

    @property
    def dq_radps(self) -> Vector:
        """Its velocity, shape (7,) [rad/s]."""
        return self._v

    @property
    def ddq_radps2(self) -> Vector:
        """Its acceleration, shape (7,) [rad/s²]."""
        return self._a

    @property
    def values(self) -> Vector:
        """The last setpoint, by the name that it has in every space."""
        return self._q

    @property
    def rates(self) -> Vector:
        """Its velocity, by the name that it has in every space."""
        return self._v

    @property
    def forces(self) -> Vector:
        """Its acceleration, by the name that it has in every space."""
        return self._a

    @property
    def is_at_rest(self) -> bool:
        """Whether nothing moves now; a path or a target may still be pending."""
        return not any(self._v) and not any(self._a)

    @property
    def progress(self) -> float:
        """Part of the path's (or trajectory's) duration that has been handed out, 0..1; 1 when there is none."""
        if self.mode is ReferenceMode.CHUNK and self.passage is not None:
            return self.passage.progress
        if self._course is None or self.mode is not ReferenceMode.PATH:
            return 1.0
        return min(self._steps * self.period_s / self._course.duration_s, 1.0)

    @property
    def is_limited(self) -> bool:
        """Whether the reference is late because the followed targets ask for more than the limits allow (`follower.py`)."""
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
    def state(self) -> Start:
        """Where a path would begin now."""
        return Start(q_rad=self._q, dq_radps=self._v, ddq_radps2=self._a, braking=self._braking)

    @property
    def place(self) -> State:
        """Position [rad], velocity [rad/s] and acceleration [rad/s²] now."""
        return self._q, self._v, self._a

    def rest_q_rad(self) -> Vector:
        """Return where it would come to rest if it braked now, shape (7,) [rad]."""
        rest = [self._braking.rest(q, v, a) for q, v, a in zip(self._q, self._v, self._a, strict=True)]
        return self._braking.land(rest, rest)

    def end_q_rad(self) -> Vector:
        """Return where its path ends; without one where it would come to rest if it braked now, shape (7,) [rad]."""
        if self._course is None or isinstance(self._course, Slowing):
            return self.rest_q_rad()
        return self._course.end_rad

    def aim_q_rad(self) -> Vector:
        """Return where what it follows leads it, its target or its path's end; else where it would rest, shape (7,) [rad]."""
        return self._follower.target_rad if self.mode is ReferenceMode.FOLLOW else self.end_q_rad()

    # ------------------------------------------------------------------------------------------------ what is asked

    def seed(self, q_rad: Sequence[float]) -> None:
        """Begin anew at rest: the only way to jump, for a stream that is silent.

        Args:
            q_rad: Where, shape (7,) [rad], inside the limits.

        Raises:
            PlanFailed: With joint, value and bound; nothing has changed.
        """
        self._q = check_goal("start", q_rad, self.limits)
        self._v = self._a = REST
        self.passage = None
        self._enter(ReferenceMode.HOLD, None)

    def enter(self, q_rad: Sequence[float], dq_radps: Sequence[float], ddq_radps2: Sequence[float]) -> None:
        """Go on where another reference was interrupted, and brake: for a stream that another process had.

        Args:
            q_rad: Its last setpoint, shape (7,) [rad], inside the limits.
            dq_radps: Velocity of that setpoint, shape (7,) [rad/s].
            ddq_radps2: Its acceleration, shape (7,) [rad/s²].

        Raises:
            PlanFailed: It is outside the limits, or cannot brake inside them; nothing has changed.
        """
        self._q, self._v, self._a = check_entry(q_rad, dq_radps, ddq_radps2, self._braking)
        self._enter(ReferenceMode.HOLD, None)
        self.brake()

    def start(self, path: Path | LinePath) -> None:
        """Follow a path.

        Args:
            path: Planned from the present state.

        Raises:
            PlanFailed: It begins in another state; nothing has changed.
        """
        if path.start != self.state:
            raise PlanFailed("the path begins in another state than the reference is in: plan it anew")
        self.passage = None
        if path.duration_s > 0.0:
            self._enter(ReferenceMode.PATH, path)
        else:
            self._enter(ReferenceMode.HOLD, None)

    def follow(self, q_rad: Sequence[float], speed: float = 1.0) -> None:
        """Follow a target, planned anew for each setpoint; the latest one counts.

        Args:
            q_rad: Target, shape (7,) [rad], inside the limits.
            speed: Factor on the velocity limit, 0 < speed <= 1; on the acceleration limit too when it starts at rest.

        Raises:
            PlanFailed: With joint, value and bound; nothing has changed.
        """
        target = check_goal("target", q_rad, self.limits)
        self._speed = check_speed(speed)
        if self.mode is not ReferenceMode.FOLLOW:
            self._bound = 1.0
            self._follower.begin(speed)
            self._enter(ReferenceMode.FOLLOW, None)
        self._pace()
        self.passage = self._ahead = None
        self._follower.target_rad = target

    def bound(self, speed: float) -> None:
        """Bound the velocity of the followed stream, beside its own factor, from the next plan on.

        Args:
            speed: Factor on the velocity limit, 0 < speed <= 1; 1 for no bound. A new stream begins without one.
        """
        self._bound = speed
        self._pace()

    def _pace(self) -> None:
        speed = min(self._speed, self._bound)
        if speed != self._follower.speed:
            self._follower.begin(speed)

    def prepare(self, trajectory: Trajectory, start_s: float, *, rests: bool) -> Passage:
        """Return the way along a trajectory, to be judged and then taken with `track`; nothing changes yet.

        Args:
            trajectory: Inside the limits of position, velocity and acceleration.
            start_s: Time on it that is now [s]; negative when it begins in the future: until then the arm goes on with
                the trajectory it follows, or brakes.
            rests: Whether it ends at rest at its last point.
        """
        lead = None
        if self.mode is ReferenceMode.CHUNK and self.passage is not None:
            lead = self.passage.under_way
        return Passage(self._braking, trajectory, start_s, rests=rests, lead=lead)

    def origin(self, passage: Passage) -> Vector:
        """Return where the arm will be when a passage begins [rad]."""
        return passage.origin(self._q, self.rest_q_rad())

    def begin(self, passage: Passage) -> bool:
        """Let a passage plan its way from the present state, unless it waits; return whether there is one."""
        return passage.is_sound and (passage.is_waiting or passage.begin(self.place))

    def track(self, passage: Passage) -> None:
        """Take the way along a trajectory, begun or waiting at the present state."""
        self._enter(ReferenceMode.CHUNK, None)
        self.passage = passage

    def brake(self) -> None:
        """Come to rest as quickly as the limits allow, each joint on its own; then hold."""
        self.passage = None
        if self.is_at_rest:
            self._enter(ReferenceMode.HOLD, None)
        elif self.mode is not ReferenceMode.BRAKE:
            self._enter(ReferenceMode.BRAKE, self.state.slow(0.0))

    def _enter(self, mode: ReferenceMode, course: Path | LinePath | Slowing | None) -> None:
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
        """Return the state of the next setpoint if each joint took a step of its stop, whatever moves it now."""
        return self.state.slow(0.0).at(self.period_s)

    def lead(self, state: State) -> None:
        """Have the next `step` take this state instead of the one ahead, while a target is followed.

        Args:
            state: Of each joint either the one ahead or the one of its stop.
        """
        self._ahead = state
        self._follower.disturb()

    def step(self) -> Vector:
        """Advance by one period and return the setpoint, shape (7,) [rad]. Never raises."""
        state = self.ahead()
        self._ahead = None
        self._take(state)
        if self._course is not None:
            self._steps += 1
            if self._steps * self.period_s >= self._course.duration_s:
                self._enter(ReferenceMode.HOLD, None)
        elif self.mode is ReferenceMode.CHUNK and self.passage is not None and self.passage.outcome is Outcome.DONE:
            self._enter(ReferenceMode.HOLD, None)
        return self._q

    def _next(self) -> State:
        if self._course is not None:
            return self._course.at((self._steps + 1) * self.period_s)
        if self.mode is ReferenceMode.FOLLOW:
            return self._follower.follow(self.place)
        if self.mode is ReferenceMode.CHUNK and self.passage is not None:
            passage = self.passage
            state = passage.step(self.place)
            if state is None:
                self.brake()
                self.passage = passage
                return self._next()
            return state
        return self.place

    def _take(self, state: State) -> None:
        """Take a state; what rounding put beyond a position limit is put on it."""
        q_rad, self._v, self._a = state
        for q, lower, upper in zip(q_rad, self.limits.lower_rad, self.limits.upper_rad, strict=True):
            if not lower <= q <= upper:
                q_rad = self._braking.land(q_rad, q_rad)
                break
        self._q = q_rad


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
    return plan_paths({side: reference.state for side, reference in references.items()}, goals, speed)
