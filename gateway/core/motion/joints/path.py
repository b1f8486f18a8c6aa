"""Path: one arm's part of a planned motion, and the slowing of one arm: its state as a function of the path's own time.

A path begins at the exact state of a reference (which may be moving), is continuous in position, velocity and
acceleration from there on, and ends at rest. It may begin with a *lead*, in which each joint slows down on its own,
before ruckig's trajectory. `planner.py` sees to it that its setpoints are inside the position limits, and stoppable.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ruckig import Trajectory

from gateway.core.motion.joints.braking import OVER_RATIO, Braking, JointLimits, Ramp, advance, duration
from gateway.values import ARM_DOF, ValueRefused, Vector, require_finite

__all__ = ["REST", "Path", "PlanFailed", "Slowing", "Start", "State", "check_entry", "check_goal", "check_speed"]

State = tuple[Vector, Vector, Vector]
"""Positions [rad], velocities [rad/s], accelerations [rad/s²] of one arm."""

REST: Vector = (0.0,) * ARM_DOF
"""Velocities or accelerations of an arm at rest."""


class PlanFailed(ValueError):
    """An input or a plan cannot be used; nothing has changed.

    Attributes:
        joint: Which joint, e.g. `left arm joint 4`; empty when none is to blame.
        value: The offending value; NaN when there is none.
        bound: The bound as text; empty when there is none.
    """

    def __init__(self, message: str, *, joint: str = "", value: float = math.nan, bound: str = "") -> None:
        super().__init__(message)
        self.joint = joint
        self.value = value
        self.bound = bound


def check_goal(name: str, q_rad: Sequence[float], limits: JointLimits) -> Vector:
    """Return the positions as a vector when there are seven finite ones inside the limits.

    Args:
        name: Whose, e.g. `left arm`.
        q_rad: Positions to check [rad].
        limits: Limits of that arm.

    Raises:
        PlanFailed: With joint, value and bound.
    """
    goal = tuple(q_rad)
    try:
        require_finite(f"{name} position", goal, ARM_DOF)
    except ValueRefused as refused:
        raise PlanFailed(str(refused)) from refused
    for index, (q, lower, upper) in enumerate(zip(goal, limits.lower_rad, limits.upper_rad, strict=True)):
        if not lower <= q <= upper:
            joint, bound = f"{name} joint {index + 1}", f"[{lower}, {upper}]"
            raise PlanFailed(f"{joint}: {q} rad is outside {bound} rad", joint=joint, value=q, bound=bound)
    return goal


def check_entry(
    q_rad: Sequence[float], dq_radps: Sequence[float], ddq_radps2: Sequence[float], braking: Braking
) -> State:
    """Return a state as vectors when it is inside all limits and stays inside them while it brakes.

    Args:
        q_rad: Positions [rad].
        dq_radps: Velocities [rad/s].
        ddq_radps2: Accelerations [rad/s²].
        braking: What the arm's brakes can do.

    Raises:
        PlanFailed: With joint, value and bound.
    """
    q = check_goal("entry", q_rad, braking.limits)
    v, a = tuple(dq_radps), tuple(ddq_radps2)
    try:
        require_finite("entry velocity", v, ARM_DOF)
        require_finite("entry acceleration", a, ARM_DOF)
    except ValueRefused as refused:
        raise PlanFailed(str(refused)) from refused
    limits = braking.limits
    for index in range(ARM_DOF):
        joint = f"entry joint {index + 1}"
        if braking.is_over(v[index], 0.0, limits.v_radps):
            raise PlanFailed(f"{joint}: too fast", joint=joint, value=v[index], bound=f"{limits.v_radps} rad/s")
        if abs(a[index]) > limits.a_radps2 * OVER_RATIO:
            raise PlanFailed(f"{joint}: accelerates", joint=joint, value=a[index], bound=f"{limits.a_radps2} rad/s²")
        if not braking.can_stop(index, q[index], v[index], a[index]):
            bound = f"[{limits.lower_rad[index]}, {limits.upper_rad[index]}]"
            raise PlanFailed(f"{joint}: cannot stop inside {bound} rad", joint=joint, value=q[index], bound=bound)
    return q, v, a


def check_speed(speed: float) -> float:
    """Return the factor when 0 < speed <= 1.

    Raises:
        PlanFailed: With value and bound.
    """
    if not 0.0 < speed <= 1.0:
        raise PlanFailed(f"speed is {speed}, a factor in (0, 1] is needed", value=speed, bound="(0, 1]")
    return speed


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """Where a path begins: the state of one arm's reference, and what its brakes can do."""

    q_rad: Vector
    dq_radps: Vector
    ddq_radps2: Vector
    braking: Braking

    @property
    def is_at_rest(self) -> bool:
        """Whether nothing moves."""
        return not any(self.dq_radps) and not any(self.ddq_radps2)

    def is_over(self, v_radps: float) -> bool:
        """Whether a joint is faster than `v_radps`, or will be before its acceleration can be taken back."""
        return any(self.braking.is_over(v, a, v_radps) for v, a in zip(self.dq_radps, self.ddq_radps2, strict=True))

    def slow(self, v_radps: float) -> Slowing:
        """Return the quickest way to constant velocities of at most `v_radps`; 0 for the stop."""
        ramps = tuple(self.braking.slow(v, a, v_radps) for v, a in zip(self.dq_radps, self.ddq_radps2, strict=True))
        return Slowing(start=self, ramps=ramps, duration_s=max(duration(course) for course in ramps))


@dataclass(frozen=True, slots=True, kw_only=True)
class Slowing:
    """One arm becomes slower or stops, each joint on its own.

    Attributes:
        start: The state at time 0.
        ramps: One per joint.
        duration_s: Time until all velocities are constant [s].
    """

    start: Start
    ramps: tuple[Ramp, ...]
    duration_s: float

    def at(self, time_s: float) -> State:
        """Return the state `time_s` after the start."""
        start = self.start
        joints = zip(start.q_rad, start.dq_radps, start.ddq_radps2, self.ramps, strict=True)
        states = [advance(q, v, a, course, time_s) for q, v, a, course in joints]
        q_rad, dq_radps, ddq_radps2 = zip(*states, strict=True)
        return q_rad, dq_radps, ddq_radps2


@dataclass(frozen=True, slots=True, kw_only=True)
class Path:
    """One arm's part of a plan. The trajectory is shared by all arms of it; each arm keeps its own time.

    Attributes:
        start: The state at time 0; only a reference in exactly this state may enter.
        lead: What comes before the trajectory; None when it begins at once.
        lead_s: Duration of the lead, the longest of all arms [s].
        trajectory: ruckig's plan from the end of the lead on.
        first: Index of this arm's first joint in it.
        duration_s: Time from the start to rest, the same for all arms [s].
        end_rad: Where this arm comes to rest [rad].
    """

    start: Start
    lead: Slowing | None
    lead_s: float
    trajectory: Trajectory
    first: int
    duration_s: float
    end_rad: Vector

    @property
    def duration_ns(self) -> int:
        """Time from the start to rest [ns]."""
        return round(self.duration_s * 1e9)

    def at(self, time_s: float) -> State:
        """Return the state `time_s` after the start; exactly at rest from `duration_s` on."""
        if time_s >= self.duration_s:
            return self.end_rad, REST, REST
        if self.lead is not None and time_s < self.lead_s:
            return self.lead.at(time_s)
        q_rad, dq_radps, ddq_radps2 = self.trajectory.at_time(time_s - self.lead_s)
        arm = slice(self.first, self.first + ARM_DOF)
        return tuple(q_rad[arm]), tuple(dq_radps[arm]), tuple(ddq_radps2[arm])
