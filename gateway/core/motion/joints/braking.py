"""Braking: how quickly a joint can change its velocity within the limits, and where it would come to rest.

A *ramp* is the quickest change of one joint's velocity (v -> v_end, a -> 0) in three phases of constant jerk. It is
closed form and cannot fail, so it is what everything else falls back on. A *stop* is the ramp to standstill.

Stops are what keeps a joint inside its position limits. Call a state *stoppable* when its stop stays inside them.

1. A point on the stop of a stoppable state is stoppable: its own stop is the rest of that stop.
2. A point on a motion that keeps the limits, only moves one way (v >= 0) and ends at rest inside, is stoppable: its
   stop ends no later. For where the motion's velocity came to fall below the stop's, its acceleration would be the
   smaller one too; the stop's then rises as fast as the jerk limit allows; so the motion would reach v < 0 before
   the stop ends.
3. So a reference that moves on to stoppable states only, and takes its stop where the next would not be one, never
   leaves the position limits.

A motion that turns back is not covered by 2: it may rely on decelerating through v = 0, which a stop does not do.
Whoever plans such a one asks `can_stop` about its states. `Braking` is the space in which joints move (`space.py`). This
module knows no ruckig, no path and no target.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from msgspec import Struct

from gateway.core.motion.space import PlanFailed, State, check_finite
from gateway.values import ARM_DOF, Vector, require_finite

__all__ = ["OVER_RATIO", "REST", "Braking", "JointLimits", "Ramp", "Slowing", "advance", "duration", "ramp"]

REST: Vector = (0.0,) * ARM_DOF
"""Velocities or accelerations of an arm at rest."""

TINY_RATIO = 2e-8
"""A setpoint may be moved by this part of j·dt³: the third difference, of four, changes by less than 1e-6."""

OVER_RATIO = 1.0 + 1e-6
"""A joint is above a velocity limit only when it is above it by more than this: plans touch their limit."""

ROUNDING_RAD = 1e-15
"""Rounding of a joint position [rad]: a few units in the last place of 2 rad."""


class JointLimits(Struct, frozen=True, kw_only=True):
    """Limits of one arm's joints; velocity, acceleration and jerk are the same for all seven.

    Attributes:
        v_radps: Velocity [rad/s].
        a_radps2: Acceleration [rad/s²].
        j_radps3: Jerk [rad/s³].
        lower_rad: Lower position limits, shape (7,) [rad].
        upper_rad: Upper position limits, shape (7,) [rad].
    """

    v_radps: float
    a_radps2: float
    j_radps3: float
    lower_rad: Vector
    upper_rad: Vector

    def __post_init__(self) -> None:
        """Refuse limits that leave no motion; ruckig takes a zero without a word and fails later."""
        for name in ("v_radps", "a_radps2", "j_radps3"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"joint limit {name} is {value}, a finite number above 0 is needed")
        require_finite("lower_rad", self.lower_rad, ARM_DOF)
        require_finite("upper_rad", self.upper_rad, ARM_DOF)
        for index, (lower, upper) in enumerate(zip(self.lower_rad, self.upper_rad, strict=True)):
            if lower >= upper:
                raise ValueError(f"joint {index + 1}: lower limit {lower} rad is not below upper limit {upper} rad")


Ramp = tuple[float, float, float, float, float]
"""Durations of the three phases [s], jerk of the first one [rad/s³], and the velocity from the end on [rad/s].

The second phase has no jerk, the third the opposite of the first. (A bare tuple: seven of them are made per setpoint.)
"""


def ramp(v: float, a: float, v_end: float, a_max: float, j_max: float) -> Ramp:
    """Return the quickest change of velocity from (v, a) to (v_end, 0).

    Args:
        v: Present velocity [rad/s].
        a: Present acceleration [rad/s²], at most `a_max` in size.
        v_end: Velocity wanted [rad/s].
        a_max: Acceleration limit [rad/s²].
        j_max: Jerk limit [rad/s³].
    """
    missing = v - v_end
    jerk = -j_max
    # The velocity that is left over when the acceleration is taken to 0 at once decides the direction.
    if missing + a * abs(a) / (2.0 * j_max) < 0.0:
        missing, a, jerk = -missing, -a, j_max
    half = 0.5 * a * a
    peak = math.sqrt(max(j_max * missing + half, 0.0))
    if peak <= a_max:
        return max((a + peak) / j_max, 0.0), 0.0, peak / j_max, jerk, v_end
    hold_s = (missing + (half - a_max * a_max) / j_max) / a_max
    return max((a + a_max) / j_max, 0.0), max(hold_s, 0.0), a_max / j_max, jerk, v_end


def duration(course: Ramp) -> float:
    """Return the time until the velocity is constant [s], rounded as `advance` does."""
    return course[0] + course[1] + course[2]


def advance(q: float, v: float, a: float, course: Ramp, time_s: float) -> tuple[float, float, float]:
    """Return the (q, v, a) of a joint `time_s` after it entered the ramp; exactly (v_end, 0) once that is over."""
    t1_s, t2_s, t3_s, jerk, v_end = course
    over_s = time_s - (t1_s + t2_s + t3_s)
    t = time_s if time_s < t1_s else t1_s
    q += t * (v + t * (0.5 * a + t * jerk / 6.0))
    v += t * (a + 0.5 * t * jerk)
    a += t * jerk
    if time_s < t1_s:
        return q, v, a
    time_s -= t1_s
    t = time_s if time_s < t2_s else t2_s
    q += t * (v + 0.5 * t * a)
    v += t * a
    if time_s < t2_s:
        return q, v, a
    t = time_s - t2_s if over_s < 0.0 else t3_s
    q += t * (v + t * (0.5 * a - t * jerk / 6.0))
    if over_s < 0.0:
        return q, v + t * (a - 0.5 * t * jerk), a - t * jerk
    return q + v_end * over_s, v_end, 0.0


class Slowing(Struct, frozen=True, kw_only=True):
    """One arm becomes slower or stops, each joint on its own.

    Attributes:
        start: The state at time 0.
        ramps: One per joint.
        duration_s: Time until all velocities are constant [s].
    """

    start: State
    ramps: tuple[Ramp, ...]
    duration_s: float

    def at(self, time_s: float) -> State:
        """Return the state `time_s` after the start."""
        states = [advance(q, v, a, course, time_s) for q, v, a, course in zip(*self.start, self.ramps, strict=True)]
        return State(*zip(*states, strict=True))


class Braking:
    """What the brakes of one arm can do."""

    __slots__ = ("_inner_lower", "_inner_upper", "_lower", "_upper", "limits", "period_s", "tiny_rad")

    def __init__(self, limits: JointLimits, period_s: float) -> None:
        if not (math.isfinite(period_s) and period_s > 0.0):
            raise ValueError(f"the period is {period_s} s, a finite number above 0 is needed")
        self.limits = limits
        self.period_s = period_s
        self.tiny_rad = max(TINY_RATIO * limits.j_radps3 * period_s**3, ROUNDING_RAD)
        """A change of a setpoint too small to count against any limit [rad]."""
        v, a, j = limits.v_radps, limits.a_radps2, limits.j_radps3
        # No stop is longer: at most v while the acceleration goes to 0 (a/j), then the mean v/2 over at most v/a + a/j.
        longest_rad = v * a / j + 0.5 * v * (v / a + a / j)
        self._inner_lower = tuple(x + longest_rad for x in limits.lower_rad)
        self._inner_upper = tuple(x - longest_rad for x in limits.upper_rad)
        self._lower = tuple(x - self.tiny_rad for x in limits.lower_rad)
        self._upper = tuple(x + self.tiny_rad for x in limits.upper_rad)

    def stop(self, v: float, a: float) -> Ramp:
        """Return the stop of a joint that moves with (v, a)."""
        return ramp(v, a, 0.0, self.limits.a_radps2, self.limits.j_radps3)

    def slow(self, v: float, a: float, v_max: float) -> Ramp:
        """Return the ramp of a joint to the velocity it is bound for, or to `v_max` in size where that is less."""
        v_end = v + a * abs(a) / (2.0 * self.limits.j_radps3)
        return ramp(v, a, min(max(v_end, -v_max), v_max), self.limits.a_radps2, self.limits.j_radps3)

    def is_over(self, v: float, a: float, v_max: float) -> bool:
        """Whether a joint is faster than `v_max`, or will be before its acceleration can be taken back."""
        bound = v_max * OVER_RATIO
        return abs(v) > bound or abs(v + a * abs(a) / (2.0 * self.limits.j_radps3)) > bound

    def rest(self, q: float, v: float, a: float) -> float:
        """Return where a joint would come to rest if it stopped now [rad]."""
        return _rest(q, v, a, self.stop(v, a))

    def land(self, end: Sequence[float], goal: Sequence[float]) -> Vector:
        """Return the end of a motion [rad]: inside the limits, and exactly the goal when it is as good as there."""
        bounds = zip(end, goal, self.limits.lower_rad, self.limits.upper_rad, strict=True)
        return tuple(min(max(g if abs(q - g) <= self.tiny_rad else q, low), high) for q, g, low, high in bounds)

    # ------------------------------------------------------------------------------------------------ the whole arm

    @property
    def home(self) -> State:
        """At rest where all joints are 0, or at the limit beyond which that is."""
        return State(self.land(REST, REST), REST, REST)

    def check_place(self, name: str, values: Sequence[float]) -> State:
        """Return the state at rest there when there are seven finite positions inside the limits.

        Args:
            name: Whose, e.g. `left arm`.
            values: Positions to check [rad].

        Raises:
            PlanFailed: With joint, value and bound.
        """
        goal = check_finite(f"{name} position", values, ARM_DOF)
        for index, (q, lower, upper) in enumerate(zip(goal, self.limits.lower_rad, self.limits.upper_rad, strict=True)):
            if not lower <= q <= upper:
                joint, bound = f"{name} joint {index + 1}", f"[{lower}, {upper}]"
                raise PlanFailed(f"{joint}: {q} rad is outside {bound} rad", joint=joint, value=q, bound=bound)
        return State(goal, REST, REST)

    def check_entry(self, values: Sequence[float], rates: Sequence[float], forces: Sequence[float]) -> State:
        """Return a state when it is inside all limits and stays inside them while it brakes.

        Args:
            values: Positions [rad].
            rates: Velocities [rad/s].
            forces: Accelerations [rad/s²].

        Raises:
            PlanFailed: With joint, value and bound.
        """
        q = self.check_place("entry", values).values
        v, a = check_finite("entry velocity", rates, ARM_DOF), check_finite("entry acceleration", forces, ARM_DOF)
        limits = self.limits
        for index in range(ARM_DOF):
            joint = f"entry joint {index + 1}"
            if self.is_over(v[index], 0.0, limits.v_radps):
                raise PlanFailed(f"{joint}: too fast", joint=joint, value=v[index], bound=f"{limits.v_radps} rad/s")
            if abs(a[index]) > limits.a_radps2 * OVER_RATIO:
                bound = f"{limits.a_radps2} rad/s²"
                raise PlanFailed(f"{joint}: accelerates", joint=joint, value=a[index], bound=bound)
            if not self.can_stop(index, q[index], v[index], a[index]):
                bound = f"[{limits.lower_rad[index]}, {limits.upper_rad[index]}]"
                raise PlanFailed(f"{joint}: cannot stop inside {bound} rad", joint=joint, value=q[index], bound=bound)
        return State(q, v, a)

    def slowing(self, state: State, v_radps: float) -> Slowing:
        """Return the quickest way to constant velocities of at most `v_radps`."""
        ramps = tuple([self.slow(v, a, v_radps) for v, a in zip(state.v, state.a, strict=True)])
        return Slowing(start=state, ramps=ramps, duration_s=max(map(duration, ramps)))

    def halt(self, state: State) -> Slowing:
        """Return the quickest way to rest, each joint on its own."""
        return self.slowing(state, 0.0)

    def halted(self, state: State) -> Vector:
        """Return where that ends [rad]."""
        rest = [self.rest(q, v, a) for q, v, a in zip(*state, strict=True)]
        return self.land(rest, rest)

    def settle(self, state: State, last: State) -> State:
        """Return a state with what rounding put beyond a position limit on it."""
        for q, lower, upper in zip(state.values, self.limits.lower_rad, self.limits.upper_rad, strict=True):
            if not lower <= q <= upper:
                return State(self.land(state.values, state.values), state.v, state.a)
        return state

    # ------------------------------------------------------------------------------------------------ one joint

    def is_far(self, index: int, low: float, high: float) -> bool:
        """Whether joint `index` stays so far from its position limits that it can stop there at any speed."""
        return self._inner_lower[index] <= low and high <= self._inner_upper[index]

    def can_stop(self, index: int, q: float, v: float, a: float) -> bool:
        """Whether the stop of joint `index` from (q, v, a) stays inside its position limits; never with a NaN."""
        if self._inner_lower[index] <= q <= self._inner_upper[index]:
            return True
        lower, upper = self._lower[index], self._upper[index]
        if not lower <= q <= upper:
            return False
        if v == 0.0 and a == 0.0:
            return True
        stop = self.stop(v, a)
        if not lower <= _rest(q, v, a, stop) <= upper:
            return False
        jerk = stop[3]
        if v * jerk <= 0.0:
            return True
        # Moving one way and accelerating the other already: this stop turns back, in its first phase.
        j = abs(jerk)
        t = (abs(a) - math.sqrt(max(a * a - 2.0 * j * abs(v), 0.0))) / j
        return lower <= q + t * (v + t * (0.5 * a + t * jerk / 6.0)) <= upper


def _rest(q: float, v: float, a: float, stop: Ramp) -> float:
    """Return where a stop from (q, v, a) ends [rad]: its last two phases are counted backwards, from standstill."""
    t1_s, t2_s, t3_s, jerk, _ = stop
    forward = t1_s * (v + t1_s * (0.5 * a + t1_s * jerk / 6.0))
    backward = t3_s * jerk * (t3_s * (t3_s / 6.0 + 0.5 * t2_s) + 0.5 * t2_s * t2_s)
    return q + forward - backward
