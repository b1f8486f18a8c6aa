"""Line plan: a straight motion of one or both arms in joint space, worked out and judged whole before anything moves.

For each arm the elbow's way (`line_elbow.py`) and the joints along its line (`line_curve.py`), at more places where they turn
out too far apart; what has to stay free (`line_gaps.py`); one clock for all (`line_clock.py`); and that the arms can stop
anywhere on the way (`line_path.py`), else all becomes slower. Arms that move together share part and clock, so each is where
the other expects it.

It costs milliseconds, and a tick has none to give: a plan is a generator of pieces of about a tenth of a millisecond each.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping
from typing import TYPE_CHECKING, TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from gateway.core.motion.joints.braking import Braking, JointLimits
from gateway.core.motion.lines.line import Line, line_to
from gateway.core.motion.lines.line_clock import SLOWEST, LineClock, Reins, clock_for
from gateway.core.motion.lines.line_curve import Coarse, Curve, parts_for, place, solve
from gateway.core.motion.lines.line_elbow import Elbow, chosen
from gateway.core.motion.lines.line_gaps import too_near
from gateway.core.motion.lines.line_path import LinePath, Unstoppable, unstoppable
from gateway.core.motion.poses.pose_state import PoseDynamics
from gateway.core.motion.space import Start
from gateway.errors import Code, Refusal
from gateway.robot.topics import ARM_JOINTS
from gateway.values import EePose, Side, Vector

if TYPE_CHECKING:  # they take numpy along, which a guard has no use for
    from gateway.kinematics.arm import ArmModel
    from gateway.kinematics.collision import CollisionModel

__all__ = ["Body", "Going", "Planning", "plan_lines"]

FINER = (1, 2, 4)
"""How many times as many places are tried, one after the other."""

SLOWER = 1.3
"""Factor by which a motion becomes slower that an arm could not stop."""


class Going(Struct, frozen=True, kw_only=True):
    """One arm that goes along.

    Attributes:
        arm: Its kinematics.
        start: Where it is, at rest.
        target: Where its end effector shall be, in its shoulder frame.
        poses: Limits of its end effector.
    """

    arm: ArmModel
    start: Start[Braking]
    target: EePose
    poses: PoseDynamics


class Body(Struct, frozen=True, kw_only=True):
    """What has to stay free.

    Attributes:
        model: Parts of the body; None when nothing is watched.
        margin_m: What has to stay free between them [m].
        q_rad: Joints of both arms as they are, shape (7,) each [rad]: of those that stay where they are.
    """

    model: CollisionModel | None
    margin_m: float
    q_rad: Mapping[Side, Vector]


Planning: TypeAlias = Generator[None, None, dict[Side, LinePath] | Refusal]
"""Yields after each piece; returns a path for each arm, or the first place on the way that cannot be."""


def plan_lines(going: Mapping[Side, Going], body: Body, speed: float, v_radps: float = math.inf) -> Planning:
    """Return paths of a straight motion to poses at rest, all arms ending together, inside all limits; or why not.

    `speed` is a factor on velocities and accelerations of the poses, 0 < speed <= 1; `v_radps` bounds the joints, too.
    """
    for side, one in going.items():
        if not one.arm.shape.is_near:
            return _not_closed(side, one.arm)
    lines = {side: line_to(one.arm.forward(one.start.state.values), one.target) for side, one in going.items()}
    curves = yield from _curves(going, lines)
    if isinstance(curves, Refusal):
        return curves
    if body.model is not None:
        parts = next(iter(curves.values())).times_s
        postures = [
            {**body.q_rad, **{side: curve.points[number] for side, curve in curves.items()}}
            for number in range(len(parts))
        ]
        refusal = yield from too_near(body.model, body.margin_m, postures, lambda number: place(parts[number]))
        if refusal is not None:
            return refusal
    joints = {side: one.start.space.limits for side, one in going.items()}
    reins = {
        side: Reins(one.poses, replace(joints[side], v_radps=min(joints[side].v_radps, v_radps)))
        for side, one in going.items()
    }
    clock = yield from clock_for(lines, curves, reins, speed)
    if isinstance(clock, Refusal):
        return clock
    return (yield from _stoppable(going, curves, clock))


def _curves(
    going: Mapping[Side, Going], lines: Mapping[Side, Line]
) -> Generator[None, None, dict[Side, Curve] | Refusal]:
    """Work out the joints of all arms at the same places, at more of them where some are too far apart."""
    side, coarse = next(iter(going)), Coarse(0.0)
    elbows: dict[Side, Elbow] = {}
    for side, one in going.items():
        elbows[side] = yield from chosen(one.arm, lines[side], one.start.state.values, one.start.space.limits)
    for finer in FINER:
        parts = parts_for(tuple(lines.values()), finer)
        curves: dict[Side, Curve] = {}
        for side, one in going.items():
            start, limits = one.start, one.start.space.limits
            found = yield from solve(side, one.arm, lines[side], elbows[side], start.state.values, parts, limits)
            if isinstance(found, Refusal):
                return found
            if isinstance(found, Coarse):
                coarse = found
                break
            curves[side] = found
        else:
            return curves
    return Refusal(
        code=Code.NO_STRAIGHT_WAY,
        message=f"{place(coarse.part)} the {side} arm's joints would have to turn too sharply to keep the hand on the line: "
        "it is near a singular posture, or a joint runs along its limit",
        field=f"{side}_arm",
        value=f"{coarse.part:.4f}",
        bound="1",
        unit="of the way",
    )


def _stoppable(
    going: Mapping[Side, Going], curves: Mapping[Side, Curve], clock: LineClock
) -> Generator[None, None, dict[Side, LinePath] | Refusal]:
    """Make paths of curves, at a pace at which each setpoint is stoppable."""
    while True:
        paths = {side: LinePath(start=one.start.state, curve=curves[side], clock=clock) for side, one in going.items()}
        worst: tuple[Side, Unstoppable] | None = None
        for side, path in paths.items():
            found = yield from unstoppable(path, going[side].start.space)
            if found is not None:
                worst = side, found
        if worst is None:
            return paths
        clock = clock.slower(SLOWER)
        if clock.slowness > SLOWEST:
            return _cannot_stop(*worst, going[worst[0]].start.space.limits)


def _not_closed(side: Side, arm: ArmModel) -> Refusal:
    return Refusal(
        code=Code.NO_STRAIGHT_WAY,
        message=f"the {side} arm of the body model has no closed form, which a straight way needs: {arm.shape.worst} "
        f"({arm.shape.gap:.3g})",
        field=f"{side}_arm",
        hint="let the joints go there as they like with move_pose(), or name no `urdf` in section [model]",
    )


def _cannot_stop(side: Side, found: Unstoppable, limits: JointLimits) -> Refusal:
    n = found.joint
    bound = f"[{limits.lower_rad[n]:g}, {limits.upper_rad[n]:g}]"
    return Refusal(
        code=Code.NO_STRAIGHT_WAY,
        message=f"{place(found.part)} {side} arm joint {n + 1} ({ARM_JOINTS[side][n]}) could not stop inside {bound} rad from "
        f"{found.q_rad:.4f} rad at {found.dq_radps:.3g} rad/s, however slowly the line is followed ({SLOWEST:g} times "
        "slower is the bound)",
        field=f"{side}_arm[{n}]",
        value=f"{found.q_rad:.6g}",
        bound=bound,
        unit="rad",
    )
