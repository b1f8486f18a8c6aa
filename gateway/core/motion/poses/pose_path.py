"""Pose path: an end effector's way to a pose at rest, position and orientation on one clock, exactly straight.

From rest the position moves along the straight line and the orientation about one fixed axis, the shorter way; how far
along is one number, which ruckig plans so that linear and angular limits both hold. Both arms of one motion share it, so
that they end together. The reach is a ball, so a straight way between two places in it stays in it.

From motion the path has a *lead*: first each arm comes to rest (`PoseDynamics.halt`). That is always possible.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from msgspec import Struct
from ruckig import InputParameter, Ruckig, Trajectory

from gateway.core.motion.poses.pose_state import REST6, PoseDynamics, PoseStop
from gateway.core.motion.poses.quaternion import aligned, exp, multiply, turn, unit
from gateway.core.motion.solver import NoPlan, Plan, solve
from gateway.core.motion.space import PlanFailed, Start, State, check_speed
from gateway.values import Side, Vector

__all__ = ["PosePath", "plan_pose_paths"]

NOTHING_S = 1e-9
"""A way that takes less at full speed is none [s]: below any limit on the change of a setpoint."""


class PosePath(Struct, frozen=True, kw_only=True):
    """One arm's part of a plan. The trajectory is shared by all arms of it; each arm keeps its own time.

    Attributes:
        lead: The stop before it.
        lead_s: Duration of the lead, the longest of all arms [s].
        moved_m: Straight way of the position, shape (3,) [m].
        turned_rad: Rotation vector of the orientation, shape (3,) [rad].
        trajectory: ruckig's plan of how far along [s at full speed]; None where there is no way to go.
        way_s: How far along the end is [s at full speed].
        duration_s: Time from the start to rest, the same for all arms [s].
        end: Where this arm comes to rest: exactly the goal, its quaternion in the sign in which it is reached.
    """

    lead: PoseStop
    lead_s: float
    moved_m: Vector
    turned_rad: Vector
    trajectory: Trajectory | None
    way_s: float
    duration_s: float
    end: State

    @property
    def start(self) -> State:
        """The state at time 0; only a reference in exactly this state may enter."""
        return self.lead.start

    @property
    def duration_ns(self) -> int:
        """Time from the start to rest [ns]."""
        return round(self.duration_s * 1e9)

    def at(self, time_s: float) -> State:
        """Return the state `time_s` after the start; exactly at rest from `duration_s` on.

        During the lead it is that of the latest setpoint.
        """
        if time_s >= self.duration_s:
            return self.end
        if self.trajectory is None or time_s < self.lead_s:
            return self.lead.at(time_s)
        along, speed, force = (x[0] / self.way_s for x in self.trajectory.at_time(time_s - self.lead_s))
        way = self.moved_m + self.turned_rad
        begin = self.lead.end.values
        p_m = tuple(x + along * moved for x, moved in zip(begin[:3], self.moved_m, strict=True))
        quat = unit(multiply(exp(tuple(along * r for r in self.turned_rad)), begin[3:]))
        return State(p_m + quat, tuple(speed * x for x in way), tuple(force * x for x in way))


def plan_pose_paths(
    starts: Mapping[Side, Start[PoseDynamics]], goals: Mapping[Side, Sequence[float]], speed: float
) -> dict[Side, PosePath]:
    """Plan one motion of all given arms from their present states to goals at rest, ending together.

    Args:
        starts: Per arm where it is; it may be moving.
        goals: For the same arms where it shall rest: x, y, z [m], qx, qy, qz, qw.
        speed: Factor on the velocity limits, 0 < speed <= 1; on the accelerations too when all arms start at rest.

    Raises:
        PlanFailed: An input is bad, or ruckig finds no plan.
    """
    check_speed(speed)
    if not starts or set(starts) != set(goals):
        raise PlanFailed(f"goals for {sorted(map(str, goals))} do not fit references of {sorted(map(str, starts))}")
    ends = {side: start.space.check_place(f"{side} arm", goals[side]) for side, start in starts.items()}
    leads = {side: start.space.halt(start.state) for side, start in starts.items()}
    lead_s = max(lead.duration_s for lead in leads.values())
    force = 1.0 if lead_s else speed
    ways, a_max, j_max = {}, [], []
    for side, start in starts.items():
        begin, end = leads[side].end.values, ends[side].values
        moved_m = tuple(b - a for a, b in zip(begin[:3], end[:3], strict=True))
        turned_rad = turn(begin[3:], end[3:])
        ways[side] = moved_m, turned_rad
        for group, way in ((start.space.linear, moved_m), (start.space.angular, turned_rad)):
            length = math.hypot(*way)
            if length > NOTHING_S * group.speed:
                a_max.append((length / group.speed, force * group.a / length))
                j_max.append(group.j / length)
    way_s = max((seconds for seconds, _ in a_max), default=0.0)
    trajectory: Trajectory | None = None
    if way_s:
        entry = InputParameter(1)
        entry.current_position, entry.target_position = [0.0], [way_s]
        entry.max_velocity = [speed]
        entry.max_acceleration = [way_s * min(a for _, a in a_max)]
        entry.max_jerk = [way_s * min(j_max)]
        trajectory = Plan(1)
        try:
            solve(Ruckig(1), entry, trajectory)
        except NoPlan as none:
            raise PlanFailed(f"ruckig finds no plan: {none}") from none
    paths = {}
    for side, (moved_m, turned_rad) in ways.items():
        end = ends[side].values
        near = multiply(exp(turned_rad), leads[side].end.values[3:])
        paths[side] = PosePath(
            lead=leads[side],
            lead_s=lead_s,
            moved_m=moved_m,
            turned_rad=turned_rad,
            trajectory=trajectory,
            way_s=way_s,
            duration_s=lead_s + (trajectory.duration if trajectory else 0.0),
            end=State(end[:3] + aligned(end[3:], near), REST6, REST6),
        )
    return paths
