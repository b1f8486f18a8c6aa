"""`ta2 home`, `ta2 move` and `ta2 move-pose`: point to point, refused before anybody is asked where it cannot be reached."""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from gateway.api import protocol
from gateway.cli.motion.job import Aim, Stage, after, move, require_mode, watched
from gateway.cli.terminal.ending import ExitStatus
from gateway.cli.terminal.figures import joints_text
from gateway.cli.terminal.progress import Teller
from gateway.client import Control, MotionHandle, MotionResult, PoseTarget, Robot, RobotState
from gateway.client.asking.poses import numbers, within_reach
from gateway.client.asking.requests import joints, within_limits
from gateway.client.state.home import home_goals
from gateway.values import Side

__all__ = ["Manner", "Plan", "carry_out"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Manner:
    """How a motion goes to its goal.

    Attributes:
        speed: Factor on the velocity limit.
        tolerance_rad: Reached within this [rad]; None for the configured one.
        is_clipping: Whether a goal outside the limits is moved to the limit.
        is_straight: Whether end effectors go straight in joint mode, too.
    """

    speed: float
    tolerance_rad: float | None
    is_clipping: bool = False
    is_straight: bool = False

    @property
    def on_limit(self) -> protocol.OnLimitName:
        """The same as the gateway calls it."""
        return "clip" if self.is_clipping else "reject"


@dataclass(slots=True, kw_only=True)
class Plan:
    """Where arms are to go: a task of `job`.

    Attributes:
        what: In words.
        manner: How.
        targets_rad: Per side seven joints [rad], or offsets.
        is_offset: Whether they are offsets from where the arm is held, or was measured.
        is_pose: Whether they are poses instead: x, y, z [m], qx, qy, qz, qw, each in its arm's shoulder frame.
        clipped: Joints that were clipped, known once it has begun.
    """

    what: str
    manner: Manner
    targets_rad: Mapping[str, tuple[float, ...]]
    is_offset: bool = False
    is_pose: bool = False
    clipped: tuple[str, ...] = ()

    def preview(self, robot: Robot, options: Namespace) -> Iterator[str]:
        """Yield what will move and how far.

        Raises:
            NotReady: An arm is in the other control mode; for poses, the arms are in different ones.
            Stale: An arm was never measured.
            Rejected: OUT_OF_RANGE, the goal is outside the limits and not to be clipped.
        """
        if not self.is_pose:
            for side in self.targets_rad:
                require_mode(side, robot.state, is_pose=False, remedy="`ta2 move-pose`")
            return _preview(options, self, robot)
        mode = robot.state.mode
        is_joint = mode is not None and all(mode.joint_mode.get(side, True) for side in self.targets_rad)
        if not is_joint:
            for side in self.targets_rad:
                require_mode(side, robot.state, is_pose=True, remedy="`ta2 move-pose` for one arm after the other")
        return _pose_preview(options, self, robot, by_joints=is_joint and not self.manner.is_straight)

    @property
    def stages(self) -> Sequence[Stage]:
        """One motion."""
        return (self._go,)

    def _go(self, robot: Robot, own: Control, tell: Teller, timeout_s: float) -> MotionResult:
        handle = self._start(own)
        self.clipped = handle.clipped
        return watched(robot, handle, tell, timeout_s)

    def _start(self, own: Control) -> MotionHandle:
        manner = self.manner
        if self.is_pose:
            targets = {
                side: PoseTarget(values[:3], values[3:], f"{side}_shoulder_base")
                for side, values in self.targets_rad.items()
            }
            start_poses = own.move_linear if manner.is_straight else own.move_pose
            return start_poses(
                targets, speed=manner.speed, tolerance_rad=manner.tolerance_rad, on_limit=manner.on_limit
            )
        start = own.move_by if self.is_offset else own.move_to
        return start(self.targets_rad, speed=manner.speed, tolerance=manner.tolerance_rad, on_limit=manner.on_limit)

    def figures(self) -> dict[str, object]:
        """Return which joints were clipped."""
        return {"clipped": list(self.clipped)}

    def remark(self) -> str:
        """Return the same in words."""
        return f", clipped to the limits: {', '.join(self.clipped)}" if self.clipped else ""


def carry_out(options: Namespace) -> ExitStatus:
    """Move to where the command says.

    Raises:
        GatewayError: Nothing was begun.
    """
    is_home, is_pose = options.command == "home", options.command == "move-pose"
    manner = Manner(
        speed=options.speed,
        tolerance_rad=options.tolerance,
        is_clipping=not is_home and options.clip,
        is_straight=is_pose and options.straight,
    )
    if is_home:
        return move(options, lambda state: _home(manner, state))
    named = {side: values for side in ("left", "right") if (values := getattr(options, side)) is not None}
    return move(options, _to_poses(manner, named) if is_pose else _to_joints(manner, named, is_offset=options.by))


def _home(manner: Manner, state: RobotState) -> Plan:
    goals = home_goals(state)
    staying = [side.value for side in Side if side.value not in goals]
    is_enabled = state.mode is not None and bool(staying) and state.mode.arm_enabled.get(staying[0], False)
    why = "in end-effector mode" if is_enabled else "disabled"
    note = f"; the {staying[0]} arm is {why} and stays" if staying else ""
    return Plan(what=f"to the initial position of manual §6.6{note}", manner=manner, targets_rad=goals)


def _to_joints(manner: Manner, targets_rad: Mapping[str, tuple[float, ...]], *, is_offset: bool) -> Aim:
    """Return the way to joints that a person gave; raise Rejected, WRONG_SHAPE or NOT_FINITE."""
    checked = {side: joints(side, q_rad) for side, q_rad in targets_rad.items()}
    what = "by offsets" if is_offset else "to joint positions"
    return lambda _: Plan(what=what, manner=manner, targets_rad=checked, is_offset=is_offset)


def _to_poses(manner: Manner, targets: Mapping[str, tuple[float, ...]]) -> Aim:
    """Return the way to poses that a person gave, each in its arm's own shoulder frame; raise Rejected where one is none."""
    checked = {side: numbers(side, values[:3], values[3:]) for side, values in targets.items()}
    what = "to poses in their shoulder frames"
    return lambda _: Plan(what=what, manner=manner, targets_rad=checked, is_pose=True)


def _preview(options: Namespace, plan: Plan, robot: Robot) -> Iterator[str]:
    info, state = robot.info, robot.state
    v_radps = plan.manner.speed * info.v_radps
    yield f"{options.command}: {' and '.join(plan.targets_rad)} {plan.what}, with up to {v_radps:g} rad/s"
    longest_s = 0.0
    for side, target in plan.targets_rad.items():
        arm = state.arm(side)
        start = tuple(map(float, arm.q_ref if arm.is_streaming else arm.q))
        goal = tuple(q + dq for q, dq in zip(start, target, strict=True)) if plan.is_offset else target
        goal = within_limits(side, goal, info, plan.manner.on_limit)
        ways = tuple(end - begin for begin, end in zip(start, goal, strict=True))
        yield f"  {side + ' arm':<9} by {joints_text(ways)} rad"
        longest_s = max(longest_s, _duration_s(max(map(abs, ways)), v_radps, info))
    yield f"  takes about {longest_s:.1f} s, then the arms are {after(options)}"


def _pose_preview(options: Namespace, plan: Plan, robot: Robot, *, by_joints: bool) -> Iterator[str]:
    """Yield how far end effectors will move and turn."""
    info, state, speed = robot.info, robot.state, plan.manner.speed
    v_mps, w_radps = speed * info.pose_v_mps, speed * info.pose_w_radps
    arms = " and ".join(plan.targets_rad)
    fastest = f"{speed * info.v_radps:g} rad/s of each joint" if by_joints else f"{v_mps:g} m/s and {w_radps:g} rad/s"
    yield f"{options.command}: {arms} {plan.what}, with up to {fastest}"
    how = "as the joints like" if by_joints else "straight"
    for side, target in plan.targets_rad.items():
        goal = within_reach(side, target, info, plan.manner.on_limit)
        pose = state.arm(side).pose
        cosine = min(1.0, abs(sum(a * b for a, b in zip(map(float, pose.quat_xyzw), goal[3:], strict=True))))
        moved_m, turned_rad = math.dist(tuple(map(float, pose.p)), goal[:3]), 2.0 * math.acos(cosine)
        yield f"  {side + ' arm':<9} by {moved_m * 1e3:.0f} mm and {turned_rad:.3f} rad, {how}"
    yield f"  then the arms are {after(options)}"


def _duration_s(way_rad: float, v_radps: float, info: protocol.Info) -> float:
    """Return about how long a joint takes from rest to rest; the gateway plans it exactly."""
    ramp_s = info.a_radps2 / info.j_radps3
    if way_rad < v_radps**2 / info.a_radps2:
        return 2.0 * math.sqrt(way_rad / info.a_radps2) + ramp_s
    return way_rad / v_radps + v_radps / info.a_radps2 + ramp_s
