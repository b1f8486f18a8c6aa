"""What the motion of an end effector is made of: its limits, its state, one period of it, and its stop.

Limits are norms of vectors: nothing here depends on how the frame lies. Plans are made axis by axis, so each axis gets
1/√3 of the acceleration and jerk (`PoseDynamics.axis`), and a share of the velocity (`share`); whatever three axes do
inside their shares, the norms keep the limits. Paths along one line use the share of one axis as well: so each of their
states is one that three axes can take over.

Orientation is planned in a chart: rotation vectors, about the axes of the pose's own frame, from the present orientation,
laid anew for each setpoint. At its origin velocity and acceleration are those of the body, and one period (1.5 rad/s at
50 Hz: 0.03 rad) leaves it so little that only the jerk is felt: by ½·ω·α at most, which is taken off its share.
`carry` turns a state of the chart into one of the body, exactly. ω never gets faster by it: the Jacobian only shortens.

A *stop* is the way to rest: where velocity and acceleration lie on one line (which is how paths move), along that line,
as quickly as no axis exceeds its share; else axis by axis. Three axes that happen to move along a line may need all three
shares to take their acceleration back below the speed limit: where the line would not do, they stop axis by axis as well.
A stop is closed form and cannot fail.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from msgspec import Struct

from gateway.core.motion.joints.braking import OVER_RATIO, Ramp, advance, duration, ramp
from gateway.core.motion.poses.quaternion import aligned, dot, exp, multiply, unit
from gateway.core.motion.space import PlanFailed, State, check_finite
from gateway.settings.settings import PoseSettings
from gateway.values import Vector

__all__ = ["NORM_TOLERANCE", "REST6", "AxisLimits", "PoseDynamics", "PoseStop", "carry", "share"]

REST6: Vector = (0.0,) * 6
"""Velocity or acceleration of an end effector at rest."""

V_RATIO = 0.999
"""Part of the velocity limit that plans use: the chart's rounding stays inside."""
A_RATIO = 0.97
"""Part of the acceleration limit that plans use: room for what one period leaves of the chart."""
J_RATIO = 0.99
"""Part of the jerk limit that plans use."""

ON_A_LINE = 1e-9
"""Velocity and acceleration lie on one line when the sine of their angle is below this."""

REACH_SLACK_M = 1e-10
"""Rounding of a position at the end of the reach [m]."""

NORM_TOLERANCE = 1e-3
"""How far the norm of a goal's quaternion may be from 1: rounding of a user's. It is normalised."""

ENTRY_RATIO = 1.0 + 1e-3
"""A motion taken over from another process may exceed a limit by this, for its rounding."""


class PoseStop(Struct, frozen=True, kw_only=True):
    """The way to rest, setpoint by setpoint.

    Attributes:
        start: The state at time 0.
        states: One for each period; none when it rests already.
        period_s: Time between them [s].
    """

    start: State
    states: tuple[State, ...]
    period_s: float

    @property
    def duration_s(self) -> float:
        """Time until it rests [s]."""
        return len(self.states) * self.period_s

    @property
    def end(self) -> State:
        """Where it rests."""
        return self.states[-1] if self.states else self.start

    def at(self, time_s: float) -> State:
        """Return the state of the latest setpoint then; at rest from `duration_s` on."""
        step = min(round(time_s / self.period_s), len(self.states))
        return self.states[step - 1] if step > 0 else self.start


class AxisLimits(NamedTuple):
    """What plans may use of position or of orientation: the speed as a norm, acceleration and jerk per axis."""

    speed: float
    a: float
    j: float


class PoseDynamics:
    """Limits in the form in which plans use them, and stops within them."""

    __slots__ = ("_longest_m", "angular", "limits", "linear", "period_s")

    def __init__(self, limits: PoseSettings, period_s: float) -> None:
        if not (math.isfinite(period_s) and period_s > 0.0):
            raise ValueError(f"the period is {period_s} s, a finite number above 0 is needed")
        self.limits = limits
        self.period_s = period_s
        root = math.sqrt(3.0)
        self.linear = AxisLimits(V_RATIO * limits.v_mps, A_RATIO * limits.a_mps2 / root, J_RATIO * limits.j_mps3 / root)
        self.angular = AxisLimits(
            V_RATIO * limits.w_radps,
            (A_RATIO * limits.dw_radps2 - limits.w_radps**3 * period_s / 3.0) / root,
            (J_RATIO * limits.ddw_radps3 - 0.5 * limits.w_radps * limits.dw_radps2) / root,
        )
        v, a, j = limits.v_mps, self.linear.a, self.linear.j
        # No stop of an axis is longer: at most v while a goes to 0, then the mean v/2 over at most v/a + a/j.
        self._longest_m = root * (v * a / j + 0.5 * v * (v / a + a / j))

    def axis(self, index: int) -> AxisLimits:
        """Return the shares of axis 0 to 5."""
        return self.linear if index < 3 else self.angular

    @property
    def home(self) -> State:
        """At rest at the shoulder."""
        return State((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), REST6, REST6)

    def check_place(self, name: str, values: Sequence[float], slack_m: float = 0.0) -> State:
        """Return the state at rest there when it is finite, of unit norm (to be normalised) and inside the reach.

        Args:
            name: Whose, e.g. `left arm`.
            values: x, y, z [m], qx, qy, qz, qw.
            slack_m: How far beyond the reach it may be [m]: for setpoints, which are rounded.

        Raises:
            PlanFailed: With what is to blame, value and bound.
        """
        pose = check_finite(f"{name} pose", values, 7)
        far_m, norm, reach_m = math.hypot(*pose[:3]), math.hypot(*pose[3:]), self.limits.reach_m
        if far_m > reach_m + slack_m:
            bound = f"[0, {reach_m}]"
            message = f"{name}: {far_m} m from the shoulder is outside {bound} m"
            raise PlanFailed(message, joint=f"{name} reach", value=far_m, bound=bound)
        if abs(norm - 1.0) > NORM_TOLERANCE:
            bound = f"[{1.0 - NORM_TOLERANCE}, {1.0 + NORM_TOLERANCE}]"
            message = f"{name}: the quaternion has norm {norm}, outside {bound} (xyzw)"
            raise PlanFailed(message, joint=f"{name} orientation", value=norm, bound=bound)
        return State(pose[:3] + unit(pose[3:]), REST6, REST6)

    def check_entry(self, values: Sequence[float], rates: Sequence[float], forces: Sequence[float]) -> State:
        """Return a state when it is inside all limits and stays inside the reach while it brakes.

        Values are x, y, z [m], qx, qy, qz, qw; rates and forces are linear, then angular.

        Raises:
            PlanFailed: With what is to blame, value and bound.
        """
        place = self.check_place("setpoint", values, 10.0 * REACH_SLACK_M).values
        v, a = check_finite("velocity", rates, 6), check_finite("acceleration", forces, 6)
        bounds = (
            ("linear velocity", v[:3], self.limits.v_mps, "m/s"),
            ("angular velocity", v[3:], self.limits.w_radps, "rad/s"),
            ("linear acceleration", a[:3], self.limits.a_mps2, "m/s²"),
            ("angular acceleration", a[3:], self.limits.dw_radps2, "rad/s²"),
        )
        for name, vector, bound, unit_name in bounds:
            size = math.hypot(*vector)
            if size > bound * ENTRY_RATIO:
                message = f"{name} {size} {unit_name} is above {bound} {unit_name}"
                raise PlanFailed(message, joint=name, value=size, bound=str(bound))
        # What is held must be repeated to the last bit: normalising anew would round it.
        given = tuple(values)
        state = State(given if abs(math.hypot(*given[3:]) - 1.0) < 1e-9 else place, v, a)
        if not self.can_stop(state._replace(values=tuple([x * (1.0 - 1e-8) for x in place[:3]]))):
            raise PlanFailed(f"it cannot stop within {self.limits.reach_m} m of the shoulder", joint="reach")
        return state

    def can_stop(self, state: State) -> bool:
        """Whether every setpoint of the stop from here is inside the reach."""
        reach_m, p_m = self.limits.reach_m, state.values[:3]
        if math.hypot(*p_m) + self._longest_m <= reach_m:
            return True
        courses = _courses(state.v[:3], state.a[:3], self.linear)
        steps = math.ceil(max((duration(course) for *_, course in courses), default=0.0) / self.period_s)
        places = (_along(p_m, courses, step * self.period_s)[0] for step in range(steps + 1))
        return all(math.hypot(*place) <= reach_m + REACH_SLACK_M for place in places)

    def halt(self, state: State) -> PoseStop:
        """Return the way to rest."""
        linear = _courses(state.v[:3], state.a[:3], self.linear)
        states: list[State] = []
        now = state
        while not now.is_at_rest:
            p_m, v, a = _along(state.values[:3], linear, (len(states) + 1) * self.period_s)
            turning = _courses(now.v[3:], now.a[3:], self.angular)
            r, dr, ddr = _along((0.0, 0.0, 0.0), turning, self.period_s)
            now = carry(now.values[3:], p_m + r, v + dr, a + ddr)
            states.append(now)
        return PoseStop(start=state, states=tuple(states), period_s=self.period_s)

    def halted(self, state: State) -> Vector:
        """Return where that ends."""
        return self.halt(state).end.values

    def settle(self, state: State, last: State) -> State:
        """Return a state with its quaternion in the sign that goes on from the last one."""
        quat = state.values[3:]
        near = aligned(quat, last.values[3:])
        return state if near is quat else State(state.values[:3] + near, state.v, state.a)


AXES: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Directions of the three axes."""

_Course = tuple[Vector, float, float, Ramp]


def _courses(v: Vector, a: Vector, limits: AxisLimits) -> tuple[_Course, ...]:
    """Return the stop as motions along lines, each with its direction, its v and a along that, and its ramp."""
    speed, force = math.hypot(*v), math.hypot(*a)
    if speed == 0.0 == force:
        return ()
    cross = (v[1] * a[2] - v[2] * a[1], v[2] * a[0] - v[0] * a[2], v[0] * a[1] - v[1] * a[0])
    if math.hypot(*cross) <= ON_A_LINE * speed * force:
        size, along = (speed, v) if speed else (force, a)
        direction = tuple(c / size for c in along)
        steepest = max(map(abs, direction))
        a_max, j_max = limits.a / steepest, limits.j / steepest
        x, y = speed, dot(direction, a)
        if abs(x + y * abs(y) / (2.0 * j_max)) <= limits.speed * OVER_RATIO:
            return ((direction, x, y, ramp(x, y, 0.0, max(a_max, abs(y)), j_max)),)
    return tuple(
        (d, x, y, ramp(x, y, 0.0, max(limits.a, abs(y)), limits.j)) for d, x, y in zip(AXES, v, a, strict=True)
    )


def _along(start: Vector, courses: tuple[_Course, ...], time_s: float) -> tuple[Vector, Vector, Vector]:
    """Return position, velocity and acceleration `time_s` after the start."""
    place, v, a = [*start], [0.0] * 3, [0.0] * 3
    for direction, speed, force, course in courses:
        moved, speed, force = advance(0.0, speed, force, course, time_s)
        for n, part in enumerate(direction):
            place[n] += part * moved
            v[n] += part * speed
            a[n] += part * force
    return tuple(place), tuple(v), tuple(a)


def share(need: Vector, want: Vector, total: float) -> tuple[float, ...]:
    """Divide a norm among axes: the squares of the shares add up to at most its square.

    Args:
        need: What each axis has already, and cannot give back at once.
        want: What each would like; the squares add up to at most `total`².
        total: The norm to divide.

    Returns:
        Per axis at least what it needs, as long as the needs fit in; else the needs, all reduced alike.
    """
    wish = [max(n, w) for n, w in zip(need, want, strict=True)]
    if dot(tuple(wish), tuple(wish)) <= total * total:
        return tuple(wish)
    used = dot(need, need)
    if used >= total * total:
        factor = total / math.sqrt(used)
        return tuple(n * factor for n in need)
    # Between the needs and the wishes, squares in proportion: that the sum is the total is linear in the part.
    part = (total * total - used) / (sum(w * w for w in wish) - used)
    return tuple(math.sqrt(n * n + part * (w * w - n * n)) for n, w in zip(need, wish, strict=True))


def carry(quat_xyzw: Vector, place: Vector, v: Vector, a: Vector) -> State:
    """Turn a state of the chart around an orientation into a state of the body.

    `place` is position [m] and rotation vector from the orientation [rad], at most 0.1 rad long, shape (6,); `v` and
    `a` are its derivatives.
    """
    r, dr, ddr = place[3:], v[3:], a[3:]
    if not any(r):
        return State(place[:3] + quat_xyzw, v, a)
    square, rate = dot(r, r), dot(r, dr)
    # The left Jacobian is I + b[r]× + c[r]×²; db, dc are the rates of b and c. All exact to 1e-12 below 0.1 rad.
    b = 0.5 - square / 24.0 + square * square / 720.0
    c = 1.0 / 6.0 - square / 120.0 + square * square / 5040.0
    db = rate * (-1.0 / 12.0 + square / 180.0)
    dc = rate * (-1.0 / 60.0 + square / 1260.0)
    r_dr, r_ddr = _cross(r, dr), _cross(r, ddr)
    r_r_dr, r_r_ddr, dr_r_dr = _cross(r, r_dr), _cross(r, r_ddr), _cross(dr, r_dr)
    w = [dr[n] + b * r_dr[n] + c * r_r_dr[n] for n in range(3)]
    dw = [ddr[n] + b * r_ddr[n] + c * r_r_ddr[n] + db * r_dr[n] + dc * r_r_dr[n] + c * dr_r_dr[n] for n in range(3)]
    return State(place[:3] + unit(multiply(exp(r), quat_xyzw)), (*v[:3], *w), (*a[:3], *dw))


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
