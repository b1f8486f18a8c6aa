"""Joint tracker: one arm's way along a trajectory of joints, exactly, once it is on it (`motion/tracker.py`).

The arm may be in any motion when it begins. The way is made of legs, each of which continues position, velocity and
acceleration of the one before and keeps every limit:

* *Join*: to the state (position, velocity, acceleration) that the trajectory will have a little later, the least later
  one that all joints can reach in time; ruckig plans it. From then on the arm is *on* the trajectory.
* On it, the setpoints are those of the trajectory itself, exactly.
* *Close*: when it shall end at rest and the time left is just enough to come to rest at the last point, it does that.
  When it shall not, it runs to the last point at speed.

Every setpoint is stoppable (`braking.py`): so braking, which is what remains when no leg can be planned, always ends
inside the position limits.
"""

from __future__ import annotations

import math

from msgspec import Struct
from ruckig import InputParameter, Ruckig, Synchronization

from gateway.core.motion.joints.braking import REST, Braking, Slowing
from gateway.core.motion.joints.trajectory import Trajectory
from gateway.core.motion.solver import NoPlan, Plan, solve
from gateway.core.motion.space import State
from gateway.core.motion.tracker import ROUNDING_S, Outcome, Tracker
from gateway.values import ARM_DOF, Vector

__all__ = ["JointTracker"]

JOINTS = range(ARM_DOF)

JOIN_STEPS = 250
"""A join that would take more periods than this is none: the trajectory runs away from the arm."""

MISS_RAD = 2e-8
"""ruckig may end so far beside its target [rad] (1e-8 was measured); that is spread over the plan."""


class _Leg(Struct, frozen=True, kw_only=True):
    """A planned piece of the way beside the trajectory.

    Attributes:
        plan: ruckig's plan, or the stop.
        begun: Number of the period before its first one.
        duration_s: Until it is over [s].
        end: State from then on.
        miss_rad: What is spread over it, because the plan ends beside its target by so much; empty when it does not [rad].
        is_on: Whether it ends on the trajectory.
        is_done: Whether it ends at rest at the last point.
    """

    plan: Plan | Slowing
    begun: int
    duration_s: float
    end: State
    miss_rad: Vector = ()
    is_on: bool = False
    is_done: bool = False

    def at(self, time_s: float) -> State:
        """Return the state a time after its beginning."""
        if time_s >= self.duration_s - ROUNDING_S:
            return self.end
        if isinstance(self.plan, Slowing):
            return self.plan.at(time_s)
        q_rad, dq_radps, ddq_radps2 = self.plan.at_time(time_s)
        if self.miss_rad:
            x, s = time_s / self.duration_s, self.duration_s
            part = x * x * x * (10.0 + x * (6.0 * x - 15.0))  # from 0 to 1, at rest at both ends
            speed = 30.0 * x * x * (1.0 + x * (x - 2.0)) / s
            bend = 60.0 * x * (1.0 + x * (2.0 * x - 3.0)) / (s * s)
            q_rad = [q + part * miss for q, miss in zip(q_rad, self.miss_rad, strict=True)]
            dq_radps = [v + speed * miss for v, miss in zip(dq_radps, self.miss_rad, strict=True)]
            ddq_radps2 = [a + bend * miss for a, miss in zip(ddq_radps2, self.miss_rad, strict=True)]
        return State(tuple(q_rad), tuple(dq_radps), tuple(ddq_radps2))


class JointTracker(Tracker[Trajectory]):
    """Leads one arm along one trajectory, inside the limits of position, velocity, acceleration and jerk."""

    def __init__(
        self,
        braking: Braking,
        trajectory: Trajectory,
        start_s: float,
        *,
        rests: bool,
        lead: Tracker[Trajectory] | None = None,
    ) -> None:
        super().__init__(braking.period_s, trajectory, start_s, rests=rests, lead=lead)
        self._braking = braking
        self._goal = State(trajectory.points[-1], REST, REST)
        self._stop: _Leg | None = None
        """Of an arm that waits and follows nothing."""
        self._leg: _Leg | None = None
        self._is_on = False
        self._ahead: State | None = None
        """State of the trajectory one period on, when the arm stays on it."""
        limits = braking.limits
        self._limits = (limits.v_radps,) * ARM_DOF, (limits.a_radps2,) * ARM_DOF, (limits.j_radps3,) * ARM_DOF
        self._closing_s = 2.0 * (limits.v_radps / limits.a_radps2 + 2.5 * limits.a_radps2 / limits.j_radps3)
        """Coming to rest at the last point takes less than this when the arm is on the trajectory [s]."""
        tiny, period_s = braking.tiny_rad, braking.period_s
        self._tiny = (tiny, tiny / period_s, tiny / period_s**2)
        self._ruckig = Ruckig(ARM_DOF)

    @property
    def is_sound(self) -> bool:
        """Whether an arm that runs to the end at speed can brake inside its position limits from there."""
        end = self.trajectory.at(self.trajectory.duration_s)
        return self.rests or all(map(self._braking.can_stop, JOINTS, *end))

    # ------------------------------------------------------------------------------------------------ one period

    def begin(self, now: State) -> bool:
        """Plan the way onto the trajectory; return whether there is one. Only for one that does not wait."""
        self._leg = self._next_leg(now)
        return self.outcome is None

    def _go_on(self, now: State) -> State | None:
        if self._leg is None:
            self._leg = self._next_leg(now)
            if self.outcome is not None:
                return None
        self._steps += 1
        return self._ahead if self._leg is None else self._along(self._leg)

    def _along(self, leg: _Leg) -> State:
        time_s = (self._steps - leg.begun) * self._period_s
        state = leg.at(time_s)
        if time_s < leg.duration_s - ROUNDING_S:
            return state
        self._leg = None
        self._is_on = leg.is_on
        self.has_joined = self.has_joined or leg.is_on
        if leg.is_done:
            self.outcome = Outcome.DONE
        return state

    def _pause(self, now: State) -> State:
        if self._stop is None:
            self._stop = self._halt(now)
        return self._stop.at((self._steps + 1 - self._stop.begun) * self._period_s)

    # ------------------------------------------------------------------------------------------------ the next leg

    def _next_leg(self, now: State) -> _Leg | None:
        """Return the leg that begins now; None to stay on the trajectory, or, with an outcome, to brake."""
        left_s = self.trajectory.duration_s - self.time_s
        is_closing = self.rests and left_s < self._closing_s
        if self._is_on:
            if self._may_stay(left_s, is_closing=is_closing):
                return None
            if is_closing:
                return self._close(now)
            self.outcome = Outcome.LOST if left_s > self._period_s else Outcome.UNDERRUN
            return None
        closing = self._close(now) if is_closing else None
        if closing is not None and closing.duration_s >= left_s:
            return closing
        joining = self._join(now)
        if joining is None and closing is None:
            self.outcome = Outcome.LOST
        return joining or closing

    def _may_stay(self, left_s: float, *, is_closing: bool) -> bool:
        """Whether the trajectory itself gives the next setpoint."""
        left_s -= self._period_s
        if left_s < -ROUNDING_S:
            return False
        state = State(*self.trajectory.at(self._time_s(self._steps + 1)))
        if not all(map(self._braking.can_stop, JOINTS, *state)):
            return False
        if is_closing:
            plan = self._plan(state, self._goal, 0.0)
            if plan is None or plan.duration > left_s:
                return False
        self._ahead = state
        return True

    def _join(self, now: State) -> _Leg | None:
        """Return the shortest way to a state that the trajectory will have; None when there is none."""
        steps, period_s = 1, self._period_s
        while steps <= JOIN_STEPS:
            meets_s = self._time_s(self._steps + steps)
            if meets_s > self.trajectory.duration_s + ROUNDING_S:
                return None
            target = State(*self.trajectory.at(meets_s))
            plan = self._plan(now, target, steps * period_s)
            if plan is not None and plan.duration <= steps * period_s + ROUNDING_S:
                miss_rad = self._miss_rad(plan, target, steps * period_s)
                if miss_rad is not None and self._is_safe(plan, target, steps):
                    leg_s = steps * period_s
                    return _Leg(
                        plan=plan, begun=self._steps, duration_s=leg_s, end=target, miss_rad=miss_rad, is_on=True
                    )
            # The least later state cannot be read off the duration of a plan, which is no smooth function: it is sought,
            # from a third of what the first plan takes on.
            longest_s = plan.duration if plan is not None else 0.0
            steps = max(steps + 1 + steps // 8, math.floor(0.3 * longest_s / period_s))
        return None

    def _close(self, now: State) -> _Leg:
        """Return the way to rest at the last point; where that would lead beyond a limit, the stop, to close after it."""
        plan = self._plan(now, self._goal, 0.0)
        if plan is None:
            return self._halt(now)
        steps = math.ceil(plan.duration / self._period_s)
        miss_rad = self._miss_rad(plan, self._goal, plan.duration)
        if miss_rad is None or (steps > JOIN_STEPS and any(now[1])) or not self._is_safe(plan, self._goal, steps):
            return self._halt(now)
        return _Leg(
            plan=plan, begun=self._steps, duration_s=plan.duration, end=self._goal, miss_rad=miss_rad, is_done=True
        )

    def _halt(self, now: State) -> _Leg:
        stop = self._braking.halt(now)
        return _Leg(plan=stop, begun=self._steps, duration_s=stop.duration_s, end=stop.at(stop.duration_s))

    def _plan(self, now: State, target: State, least_s: float) -> Plan | None:
        entry, plan = InputParameter(ARM_DOF), Plan(ARM_DOF)
        is_at_rest = not any(map(any, (*now[1:], *target[1:])))
        entry.synchronization = Synchronization.Phase if is_at_rest else Synchronization.Time  # `planner.py` says why
        entry.current_position, entry.current_velocity, entry.current_acceleration = now
        entry.target_position, entry.target_velocity, entry.target_acceleration = target
        entry.max_velocity, entry.max_acceleration, entry.max_jerk = self._limits
        if least_s > 0.0:
            entry.minimum_duration = least_s
        try:
            solve(self._ruckig, entry, plan)
        except NoPlan:
            return None
        return plan

    def _miss_rad(self, plan: Plan, target: State, time_s: float) -> Vector | None:
        """Return by how much a plan ends beside its target, empty when it is at it; None when it is not even near."""
        ends = plan.at_time(time_s)
        misses = [
            max(abs(wanted - got) for wanted, got in zip(row, end, strict=True))
            for row, end in zip(target, ends, strict=True)
        ]
        if all(miss <= tiny for miss, tiny in zip(misses, self._tiny, strict=True)):
            return ()
        if misses[0] > MISS_RAD or misses[1] > self._tiny[1] or misses[2] > self._tiny[2]:
            return None
        return tuple(wanted - got for wanted, got in zip(target[0], ends[0], strict=True))

    def _is_safe(self, plan: Plan, end: State, steps: int) -> bool:
        """Whether every setpoint of a plan is stoppable, and so is its end."""
        braking, extrema = self._braking, plan.position_extrema
        near = [n for n in JOINTS if not braking.is_far(n, extrema[n].min, extrema[n].max)]
        if not near:
            return True
        states = [plan.at_time(step * braking.period_s) for step in range(1, steps)]
        states.append(end)
        return all(braking.can_stop(n, q[n], v[n], a[n]) for q, v, a in states for n in near)
