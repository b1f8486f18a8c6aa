"""Pose path: an end effector's way to a pose at rest, position and orientation on one clock, exactly straight.

From rest the position moves along the straight line and the orientation about one fixed axis, the shorter way; how far
along is one number, which ruckig plans so that linear and angular limits both hold. Both arms of one motion share it, so
that they end together. The reach is a ball, so a straight way between two places in it stays in it.

From motion the path has a *lead*: first each arm comes to rest (`PoseDynamics.stop`). That is always possible.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ruckig import InputParameter, Ruckig, Trajectory

from gateway.core.motion.joints.path import PlanFailed, check_speed
from gateway.core.motion.joints.solver import NoPlan, solve
from gateway.core.motion.poses.pose_state import PoseDynamics, PoseLimits, PoseState
from gateway.core.motion.poses.quaternion import aligned, exp, multiply, turn, unit
from gateway.values import Side, ValueRefused, Vector, require_finite

__all__ = ["PosePath", "PoseStart", "check_pose", "plan_pose_paths"]

NORM_TOLERANCE = 1e-3
"""How far the norm of a goal's quaternion may be from 1: rounding of a user's. It is normalised."""

NOTHING_S = 1e-9
"""A way that takes less at full speed is none [s]: below any limit on the change of a setpoint."""


def check_pose(name: str, values: Sequence[float], limits: PoseLimits, slack_m: float = 0.0) -> tuple[Vector, Vector]:
    """Return position and orientation when they are finite, of unit norm and inside the reach.

    Args:
        name: Whose, e.g. `left arm`.
        values: x, y, z [m], qx, qy, qz, qw.
        limits: Limits of that arm.
        slack_m: How far beyond the reach it may be [m]: for setpoints, which are rounded.

    Raises:
        PlanFailed: With what is to blame, value and bound.
    """
    pose = tuple(values)
    try:
        require_finite(f"{name} pose", pose, 7)
    except ValueRefused as refused:
        raise PlanFailed(str(refused)) from refused
    reach_m, norm = math.hypot(*pose[:3]), math.hypot(*pose[3:])
    if reach_m > limits.reach_m + slack_m:
        bound = f"[0, {limits.reach_m}]"
        raise PlanFailed(
            f"{name}: {reach_m} m from the shoulder is outside {bound} m",
            joint=f"{name} reach",
            value=reach_m,
            bound=bound,
        )
    if abs(norm - 1.0) > NORM_TOLERANCE:
        bound = f"[{1.0 - NORM_TOLERANCE}, {1.0 + NORM_TOLERANCE}]"
        raise PlanFailed(
            f"{name}: the quaternion has norm {norm}, outside {bound} (xyzw)",
            joint=f"{name} orientation",
            value=norm,
            bound=bound,
        )
    return pose[:3], unit(pose[3:])


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseStart:
    """Where a path begins: the state of one arm's reference, and its limits."""

    state: PoseState
    dynamics: PoseDynamics


@dataclass(frozen=True, slots=True, kw_only=True)
class PosePath:
    """One arm's part of a plan. The trajectory is shared by all arms of it; each arm keeps its own time.

    Attributes:
        start: The state at time 0; only a reference in exactly this state may enter.
        lead: The setpoints of the stop before it; empty from rest.
        period_s: Time between those [s].
        lead_s: Duration of the lead, the longest of all arms [s].
        origin: Where the straight way begins, at rest.
        moved_m: Straight way of the position, shape (3,) [m].
        turned_rad: Rotation vector of the orientation, shape (3,) [rad].
        trajectory: ruckig's plan of how far along [s at full speed]; None where there is no way to go.
        way_s: How far along the end is [s at full speed].
        duration_s: Time from the start to rest, the same for all arms [s].
        end: Where this arm comes to rest: exactly the goal, its quaternion in the sign in which it is reached.
    """

    start: PoseState
    lead: tuple[PoseState, ...]
    period_s: float
    lead_s: float
    origin: PoseState
    moved_m: Vector
    turned_rad: Vector
    trajectory: Trajectory | None
    way_s: float
    duration_s: float
    end: PoseState

    @property
    def duration_ns(self) -> int:
        """Time from the start to rest [ns]."""
        return round(self.duration_s * 1e9)

    def at(self, time_s: float) -> PoseState:
        """Return the state `time_s` after the start; exactly at rest from `duration_s` on.

        During the lead it is that of the latest setpoint.
        """
        if time_s >= self.duration_s or self.trajectory is None:
            return self.end if time_s >= self.duration_s else self._led(time_s)
        if time_s < self.lead_s:
            return self._led(time_s)
        along, speed, force = (x[0] / self.way_s for x in self.trajectory.at_time(time_s - self.lead_s))
        way = self.moved_m + self.turned_rad
        p_m = tuple(x + along * moved for x, moved in zip(self.origin.p_m, self.moved_m, strict=True))
        quat = unit(multiply(exp(tuple(along * r for r in self.turned_rad)), self.origin.quat_xyzw))
        return PoseState(p_m, quat, tuple(speed * x for x in way), tuple(force * x for x in way))

    def _led(self, time_s: float) -> PoseState:
        step = min(round(time_s / self.period_s), len(self.lead))
        return self.lead[step - 1] if step > 0 else self.start


def plan_pose_paths(
    starts: Mapping[Side, PoseStart], goals: Mapping[Side, Sequence[float]], speed: float
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
    checked = {side: check_pose(f"{side} arm", goals[side], start.dynamics.limits) for side, start in starts.items()}
    leads = {side: start.dynamics.stop(start.state) for side, start in starts.items()}
    lead_s = max(len(leads[side]) * start.dynamics.period_s for side, start in starts.items())
    force = 1.0 if lead_s else speed
    ways, a_max, j_max = {}, [], []
    for side, start in starts.items():
        origin = leads[side][-1] if leads[side] else start.state
        p_m, quat = checked[side]
        moved_m = tuple(b - a for a, b in zip(origin.p_m, p_m, strict=True))
        turned_rad = turn(origin.quat_xyzw, quat)
        ways[side] = origin, moved_m, turned_rad
        for group, way in ((start.dynamics.linear, moved_m), (start.dynamics.angular, turned_rad)):
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
        trajectory = Trajectory(1)
        try:
            solve(Ruckig(1), entry, trajectory)
        except NoPlan as none:
            raise PlanFailed(f"ruckig finds no plan: {none}") from none
    paths = {}
    for side, start in starts.items():
        origin, moved_m, turned_rad = ways[side]
        p_m, quat = checked[side]
        near = multiply(exp(turned_rad), origin.quat_xyzw)
        paths[side] = PosePath(
            start=start.state,
            lead=leads[side],
            period_s=start.dynamics.period_s,
            lead_s=lead_s,
            origin=origin,
            moved_m=moved_m,
            turned_rad=turned_rad,
            trajectory=trajectory,
            way_s=way_s,
            duration_s=lead_s + (trajectory.duration if trajectory else 0.0),
            end=PoseState(p_m, aligned(quat, near)),
        )
    return paths
