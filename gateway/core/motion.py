"""Motion: one arm's reference, the generator of its setpoints. Its state is the last setpoint it handed out.

Whatever is asked of it, in whatever order, the reference is one continuous motion: position, velocity and
acceleration never jump (but by `seed`, while the stream is silent), and the jerk keeps its limit. Setpoints are
samples of that motion at one period, so their finite differences, being averages of its derivatives, keep the limits
as well: v·dt, a·dt², j·dt³. A motion that ends between two samples ends at rest: what follows joins without a step.
 Each new plan starts from the exact state of the last setpoint, never from a
measured one.

It never leaves the position limits: every setpoint is *stoppable*, that is, braking from it ends inside. Why that is
enough stands in `braking.py`; how it is kept, in `planner.py` for paths and in `follower.py` for targets.

A reference knows no clock: each `step` is one nominal period, so a late tick delays the motion and never makes it
jump.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import Enum

from gateway.core.braking import Braking, JointLimits
from gateway.core.follower import Follower
from gateway.core.path import REST, Path, PlanFailed, Slowing, Start, State, check_goal, check_speed
from gateway.core.planner import plan_paths
from gateway.values import Side, Vector

__all__ = ["JointLimits", "JointReference", "Path", "PlanFailed", "ReferenceMode", "plan"]


class ReferenceMode(str, Enum):
    """What moves the reference."""

    HOLD = "hold"
    PATH = "path"
    FOLLOW = "follow"
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
        self._course: Path | Slowing | None = None
        """What PATH and BRAKE sample."""
        self._steps = 0
        """Setpoints handed out of it."""

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
    def is_at_rest(self) -> bool:
        """Whether nothing moves now; a path or a target may still be pending."""
        return not any(self._v) and not any(self._a)

    @property
    def progress(self) -> float:
        """Part of the path's duration that has been handed out, 0..1; 1 when there is no path."""
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

    def rest_q_rad(self) -> Vector:
        """Return where it would come to rest if it braked now, shape (7,) [rad]."""
        rest = [self._braking.rest(q, v, a) for q, v, a in zip(self._q, self._v, self._a, strict=True)]
        return self._braking.land(rest, rest)

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
        self._enter(ReferenceMode.HOLD, None)

    def start(self, path: Path) -> None:
        """Follow a path.

        Args:
            path: Planned from the present state.

        Raises:
            PlanFailed: It begins in another state; nothing has changed.
        """
        if path.start != self.state:
            raise PlanFailed("the path begins in another state than the reference is in: plan it anew")
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
        if check_speed(speed) != self._follower.speed or self.mode is not ReferenceMode.FOLLOW:
            self._follower.begin(speed)
        if self.mode is not ReferenceMode.FOLLOW:
            self._enter(ReferenceMode.FOLLOW, None)
        self._follower.target_rad = target

    def brake(self) -> None:
        """Come to rest as quickly as the limits allow, each joint on its own; then hold."""
        if self.is_at_rest:
            self._enter(ReferenceMode.HOLD, None)
        elif self.mode is not ReferenceMode.BRAKE:
            self._enter(ReferenceMode.BRAKE, self.state.slow(0.0))

    def _enter(self, mode: ReferenceMode, course: Path | Slowing | None) -> None:
        self.mode = mode
        self._course = course
        self._steps = 0
        self._follower.forget_lateness()

    # ------------------------------------------------------------------------------------------------ one period

    def step(self) -> Vector:
        """Advance by one period and return the setpoint, shape (7,) [rad]. Never raises."""
        if self._course is not None:
            self._steps += 1
            time_s = self._steps * self.period_s
            self._take(self._course.at(time_s))
            if time_s >= self._course.duration_s:
                self._enter(ReferenceMode.HOLD, None)
        elif self.mode is ReferenceMode.FOLLOW:
            self._take(self._follower.follow((self._q, self._v, self._a)))
        return self._q

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
