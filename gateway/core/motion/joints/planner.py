"""Planner: one motion of one or both arms to goals at rest, all joints ending together.

ruckig plans it. What it does not see to, and this module does:

* It does not know position limits. From rest its plans only move on, towards the goals; from motion the
  time-synchronised ones overshoot (0.1 rad beyond a limit was measured with 1 rad/s, 3 rad/s², 20 rad/s³). So every
  setpoint of a plan from motion must be stoppable (`braking.py`) as long as it may turn back; its goals are inset,
  since it may miss by 1e-8 rad.
* With a velocity limit below the present velocity it takes its braking acceleration back too late: it dips below the
  new limit, even backwards. So such a plan gets a lead: all joints first ramp down to the new limit.
* When such a plan is refused, or ruckig finds none, the lead is a full stop. That is always possible.

From rest the joints are phase-synchronised: that ends them together as well, in the same time, on a straight line in
joint space, exact to 1e-15 rad. Time synchronisation from rest missed by up to 1e-8 rad, and now and then found no
plan.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import accumulate, islice

from ruckig import InputParameter, Profile, Ruckig, Synchronization

from gateway.core.motion.joints.braking import Braking, Slowing
from gateway.core.motion.joints.path import Path
from gateway.core.motion.solver import NoPlan, Plan, solve
from gateway.core.motion.space import PlanFailed, Start, State, check_speed
from gateway.values import ARM_DOF, Side, Vector

__all__ = ["plan_paths"]

INSET_RAD = 2e-8
"""How far goals of a plan from motion are kept inside the position limits [rad]: it may end 1e-8 rad off."""

EXCESS_RAD = 1e-12
"""Beyond a position limit by no more than this is ruckig's rounding [rad]; setpoints are clipped to the limits."""

STEADY_RADPS = 1e-9
"""A joint that moves back more slowly than this does not turn back [rad/s]: rounding."""

CHECKED_STEPS = 250
"""A plan that may turn back for longer than this many periods is refused: checking it would take too long."""


def plan_paths(
    starts: Mapping[Side, Start[Braking]], goals: Mapping[Side, Sequence[float]], speed: float
) -> dict[Side, Path]:
    """Plan one motion of all given arms from their present states to goals at rest.

    Args:
        starts: Per arm where it is; it may be moving.
        goals: For the same arms where it shall rest, shape (7,) each [rad].
        speed: Factor on the velocity limit, 0 < speed <= 1; on the acceleration limit too where an arm starts at rest.

    Raises:
        PlanFailed: An input is bad, or ruckig finds no plan.
    """
    check_speed(speed)
    if not starts or set(starts) != set(goals):
        raise PlanFailed(f"goals for {sorted(map(str, goals))} do not fit references of {sorted(map(str, starts))}")
    checked = {side: start.space.check_place(f"{side} arm", goals[side]).values for side, start in starts.items()}
    failures: list[PlanFailed] = []
    for slow_to in _slow_to(starts, speed):
        try:
            paths = _plan(starts, checked, speed, slow_to)
        except NoPlan as none:
            failures = [PlanFailed(f"ruckig finds no plan: {none}")]
            continue
        objections = (_objection(side, starts[side].space, path, slow_to != 0.0) for side, path in paths.items())
        failures = [*islice((o for o in objections if o is not None), 1)]
        if not failures:
            return paths
    # Taken out of the list: a failure that a name of this frame kept would keep the frame in turn, for ever where
    # nothing collects cycles.
    raise failures.pop()


def _slow_to(starts: Mapping[Side, Start[Braking]], speed: float) -> tuple[float | None, ...]:
    """Return the leads to try, as the factor on the velocity limit to which they slow down; None for no lead."""
    if all(start.state.is_at_rest for start in starts.values()):
        return (None,)
    is_over = any(_is_over(start, speed) for start in starts.values())
    return (speed if is_over else None, 0.0)


def _is_over(start: Start[Braking], speed: float) -> bool:
    """Whether a joint is faster than it may be, or will be before its acceleration can be taken back."""
    braking, (_, rates, forces) = start.space, start.state
    v_max = speed * braking.limits.v_radps
    return any(braking.is_over(v, a, v_max) for v, a in zip(rates, forces, strict=True))


def _plan(
    starts: Mapping[Side, Start[Braking]], goals: Mapping[Side, Vector], speed: float, slow_to: float | None
) -> dict[Side, Path]:
    """Plan once.

    Raises:
        NoPlan: There is no such plan, or ruckig does not find it.
    """
    leads: dict[Side, Slowing] = {}
    if slow_to is not None:
        leads = {
            side: start.space.slowing(start.state, slow_to * start.space.limits.v_radps)
            for side, start in starts.items()
        }
    lead_s = max((lead.duration_s for lead in leads.values()), default=0.0)
    rows: list[tuple[float, ...]] = []
    for side, start in starts.items():
        state = leads[side].at(lead_s) if leads else start.state
        rows.extend(_rows(start, state, goals[side], speed))
    q, v, a, goal, v_max, a_max, j_max, lower, upper = map(list, zip(*rows, strict=True))

    entry = InputParameter(len(rows))
    entry.synchronization = Synchronization.Phase
    if any(v) or any(a):
        entry.synchronization = Synchronization.Time
        bounds = zip(goal, lower, upper, strict=True)
        goal = [min(max(end, low + INSET_RAD), high - INSET_RAD) for end, low, high in bounds]
    entry.current_position, entry.current_velocity, entry.current_acceleration, entry.target_position = q, v, a, goal
    entry.max_velocity, entry.max_acceleration, entry.max_jerk = v_max, a_max, j_max
    trajectory = Plan(len(rows))
    solve(Ruckig(len(rows)), entry, trajectory)

    ends = trajectory.at_time(trajectory.duration)[0]
    paths = {}
    for number, (side, start) in enumerate(starts.items()):
        first = number * ARM_DOF
        paths[side] = Path(
            start=start.state,
            lead=leads.get(side),
            lead_s=lead_s,
            trajectory=trajectory,
            first=first,
            duration_s=lead_s + trajectory.duration,
            end_rad=start.space.land(ends[first : first + ARM_DOF], goals[side]),
        )
    return paths


def _rows(start: Start[Braking], state: State, goal: Vector, speed: float) -> Iterator[tuple[float, ...]]:
    """Yield for each joint of an arm: q, v, a, goal, the limits of v, a, j, and of the position."""
    limits = start.space.limits
    # Below the present acceleration ruckig runs away: only an arm at rest gets a lower acceleration limit.
    a_max = limits.a_radps2 * speed if start.state.is_at_rest else limits.a_radps2
    for q, v, a, end, lower, upper in zip(*state, goal, limits.lower_rad, limits.upper_rad, strict=True):
        yield q, v, a, end, limits.v_radps * speed, a_max, limits.j_radps3, lower, upper


def _objection(side: Side, braking: Braking, path: Path, may_turn: bool) -> PlanFailed | None:
    """Return why a path must not be handed out, or None; one from rest, or led by a full stop, only moves on."""
    joints = range(path.first, path.first + ARM_DOF)
    extrema, profiles = path.trajectory.position_extrema, path.trajectory.profiles[0]
    excess_rad = EXCESS_RAD + 2.0 * braking.tiny_rad
    for n, lower, upper in zip(joints, braking.limits.lower_rad, braking.limits.upper_rad, strict=True):
        low, high = extrema[n].min, extrema[n].max
        if not lower - excess_rad <= low <= high <= upper + excess_rad:
            joint, bound = f"{side} arm joint {n - path.first + 1}", f"[{lower}, {upper}]"
            message = f"{joint} would move over [{low}, {high}] rad, outside {bound} rad"
            return PlanFailed(message, joint=joint, value=low if low < lower else high, bound=bound)
    if path.start.is_at_rest or not may_turn:
        return None
    turned_s = path.lead_s + max(_turned_s(profiles[n]) for n in joints)
    steps = math.ceil(turned_s / braking.period_s)
    if steps > CHECKED_STEPS:
        return PlanFailed(f"the {side} arm would turn back for {turned_s:.1f} s: too long to be checked")
    for step in range(1, steps + 1):
        for index, (q, v, a) in enumerate(zip(*path.at(step * braking.period_s), strict=True)):
            if not braking.can_stop(index, q, v, a):
                joint = f"{side} arm joint {index + 1}"
                bound = f"[{braking.limits.lower_rad[index]}, {braking.limits.upper_rad[index]}]"
                message = f"{joint} could not stop inside {bound} rad from {q} rad at {v} rad/s, {a} rad/s²"
                return PlanFailed(message, joint=joint, value=q, bound=bound)
    return None


def _turned_s(profile: Profile) -> float:
    """Return the time after which a joint only moves on, in the direction in which it arrives [s]."""
    v, a, ends_s = profile.v, profile.a, list(accumulate(profile.t))
    sign = next((math.copysign(1.0, x) for x in reversed(v) if abs(x) > STEADY_RADPS), 0.0)
    turned_s = 0.0
    for phase, jerk in enumerate(profile.j):
        velocities = [v[phase], v[phase + 1]]
        if a[phase] * a[phase + 1] < 0.0:
            velocities.append(v[phase] - a[phase] ** 2 / (2.0 * jerk))
        if min(sign * x for x in velocities) < -STEADY_RADPS:
            turned_s = ends_s[phase]
    # What comes before the seven phases takes the joint into its limits, and counts as turning.
    duration_s: float = profile.brake.duration + turned_s
    return duration_s
