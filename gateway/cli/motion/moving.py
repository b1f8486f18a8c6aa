"""`ta2 home`, `ta2 move` and `ta2 move-pose`: point to point, refused before anybody is asked where it cannot be reached."""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from gateway.api import protocol
from gateway.cli.motion.job import Stage, after, move, require_mode, watched
from gateway.cli.terminal.ending import ExitStatus
from gateway.cli.terminal.figures import joints_text
from gateway.cli.terminal.progress import Teller
from gateway.client import Control, MotionHandle, MotionResult, PoseTarget, Robot, RobotState
from gateway.client.asking.poses import numbers, within_reach
from gateway.client.asking.requests import joints, within_limits
from gateway.client.state.home import home_goals
from gateway.values import Side

__all__ = ["Plan", "carry_out"]


@dataclass(slots=True, kw_only=True)
class Plan:
    """Where arms are to go: a task of `job`.

    Attributes:
        what: In words.
        options: How, as the command line has it.
        targets_rad: Per side seven joints [rad], or offsets.
        is_offset: Whether they are offsets from where the arm is held, or was measured.
        is_pose: Whether they are poses instead: x, y, z [m], qx, qy, qz, qw, each in its arm's shoulder frame.
        clipped: Joints that were clipped, known once it has begun.
    """

    what: str
    options: Namespace
    targets_rad: Mapping[str, tuple[float, ...]]
    is_offset: bool = False
    is_pose: bool = False
    clipped: tuple[str, ...] = ()

    @property
    def on_limit(self) -> protocol.OnLimitName:
        """What becomes of a goal outside the limits; `home` has none."""
        return "clip" if getattr(self.options, "clip", False) else "reject"

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
        return _pose_preview(options, self, robot, by_joints=is_joint and not options.straight)

    @property
    def stages(self) -> Sequence[Stage]:
        """One motion."""
        return (self._go,)

    def _go(self, robot: Robot, own: Control, tell: Teller, timeout_s: float) -> MotionResult:
        handle = self._start(own)
        self.clipped = handle.clipped
        return watched(robot, handle, tell, timeout_s)

    def _start(self, own: Control) -> MotionHandle:
        speed, tolerance_rad = self.options.speed, self.options.tolerance
        if self.is_pose:
            targets = {
                side: PoseTarget(values[:3], values[3:], f"{side}_shoulder_base")
                for side, values in self.targets_rad.items()
            }
            start_poses = own.move_linear if self.options.straight else own.move_pose
            return start_poses(targets, speed=speed, tolerance_rad=tolerance_rad, on_limit=self.on_limit)
        start = own.move_by if self.is_offset else own.move_to
        return start(self.targets_rad, speed=speed, tolerance=tolerance_rad, on_limit=self.on_limit)

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
    if options.command == "home":
        return move(options, lambda state: _home(options, state))
    named = {side: values for side in ("left", "right") if (values := getattr(options, side)) is not None}
    if options.command == "move-pose":
        poses = {side: numbers(side, values[:3], values[3:]) for side, values in named.items()}
        plan = Plan(what="to poses in their shoulder frames", options=options, targets_rad=poses, is_pose=True)
    else:
        checked = {side: joints(side, q_rad) for side, q_rad in named.items()}
        what = "by offsets" if options.by else "to joint positions"
        plan = Plan(what=what, options=options, targets_rad=checked, is_offset=options.by)
    return move(options, lambda _: plan)


def _home(options: Namespace, state: RobotState) -> Plan:
    goals = home_goals(state)
    staying = [side.value for side in Side if side.value not in goals]
    is_enabled = state.mode is not None and bool(staying) and state.mode.arm_enabled.get(staying[0], False)
    why = "in end-effector mode" if is_enabled else "disabled"
    note = f"; the {staying[0]} arm is {why} and stays" if staying else ""
    return Plan(what=f"to the initial position of manual §6.6{note}", options=options, targets_rad=goals)


def _preview(options: Namespace, plan: Plan, robot: Robot) -> Iterator[str]:
    info, state = robot.info, robot.state
    v_radps = options.speed * info.v_radps
    yield f"{options.command}: {' and '.join(plan.targets_rad)} {plan.what}, with up to {v_radps:g} rad/s"
    longest_s = 0.0
    for side, target in plan.targets_rad.items():
        arm = state.arm(side)
        start = tuple(map(float, arm.q_ref if arm.is_streaming else arm.q))
        goal = tuple(q + dq for q, dq in zip(start, target, strict=True)) if plan.is_offset else target
        goal = within_limits(side, goal, info, plan.on_limit)
        ways = tuple(end - begin for begin, end in zip(start, goal, strict=True))
        yield f"  {side + ' arm':<9} by {joints_text(ways)} rad"
        longest_s = max(longest_s, _duration_s(max(map(abs, ways)), v_radps, info))
    yield f"  takes about {longest_s:.1f} s, then the arms are {after(options)}"


def _pose_preview(options: Namespace, plan: Plan, robot: Robot, *, by_joints: bool) -> Iterator[str]:
    """Yield how far end effectors will move and turn."""
    info, state, speed = robot.info, robot.state, options.speed
    v_mps, w_radps = speed * info.pose_v_mps, speed * info.pose_w_radps
    arms = " and ".join(plan.targets_rad)
    fastest = f"{speed * info.v_radps:g} rad/s of each joint" if by_joints else f"{v_mps:g} m/s and {w_radps:g} rad/s"
    yield f"{options.command}: {arms} {plan.what}, with up to {fastest}"
    how = "as the joints like" if by_joints else "straight"
    for side, target in plan.targets_rad.items():
        goal = within_reach(side, target, info, plan.on_limit)
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
