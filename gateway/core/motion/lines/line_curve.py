"""Line curve: the joints of one arm along a straight line, as a smooth function of the part of the way.

At a row of places on the line the inverse kinematics says where the joints are, bent as they are at the begin, with the elbow
where `line_elbow.py` wants it. Through these runs the cubic spline of `trajectory.py`, with the part of the way in place of
time. In the middle between two places the spline must be on the line as well, else the places are too far apart.

All is worked out in pieces of about a tenth of a millisecond: `solve` is a generator that yields after each. It knows no time,
and of limits only those of positions.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, TypeAlias

from gateway.core.motion.joints.braking import JointLimits
from gateway.core.motion.joints.trajectory import Trajectory, interpolate
from gateway.core.motion.lines.line import Line
from gateway.core.motion.lines.line_elbow import Elbow
from gateway.errors import Code, Refusal
from gateway.kinematics.placement import turn_rad
from gateway.robot.topics import ARM_JOINTS
from gateway.values import ARM_DOF, Side, Vector

if TYPE_CHECKING:  # it takes numpy along, which a guard has no use for
    from gateway.kinematics.arm import ArmModel

__all__ = ["OFF_M", "OFF_RAD", "Coarse", "Curve", "parts_for", "place", "solve"]

STEP_M = 0.01
"""Way from place to place [m] ..."""
STEP_RAD = 0.04
"""... and turn [rad]."""
FEWEST = 12
MOST = 480
"""Number of steps."""
EDGE = 0.25
"""Part of the first and of the last step after which there is one more place: the spline knows least at its ends."""

OFF_M = 2e-5
"""How far the spline may be from the line between two places [m] ..."""
OFF_RAD = 2e-5
"""... and how far turned from it [rad]."""
SLACK_RAD = 1e-12
"""Rounding of a joint that stays at its limit [rad]."""

SOLVED = 3
"""Places that are solved at once ..."""
SEARCHED = (None, None, None)
"""... where the closed form does it; a search for one of them counts as so many pieces."""
CHECKED = 4
"""Middles that are checked at once."""

Curve: TypeAlias = Trajectory
"""Joints [rad] and their derivatives by the part of the way, from 0 to 1, which stands where a trajectory has its time."""


class Coarse:
    """The places are too far apart, or the joints turn too sharply there."""

    def __init__(self, part: float) -> None:
        self.part = part


def parts_for(lines: Sequence[Line], finer: int = 1) -> Vector:
    """Return the places on lines that are followed together, as parts of the way from 0 to 1.

    Args:
        lines: One for each arm.
        finer: So many times as many of them.
    """
    needed = max(max(line.length_m / STEP_M, line.angle_rad / STEP_RAD) for line in lines)
    count = min(max(math.ceil(needed), FEWEST) * finer, MOST)
    step = 1.0 / count
    inner = [n * step for n in range(1, count)]
    return (0.0, EDGE * step, *inner, 1.0 - EDGE * step, 1.0)


def place(part: float) -> str:
    """Return a place on the way in words."""
    return f"at {part:.0%} of the way"


def solve(
    side: Side, arm: ArmModel, line: Line, elbow: Elbow, begin_rad: Vector, parts: Vector, limits: JointLimits
) -> Generator[None, None, Curve | Refusal | Coarse]:
    """Work out an arm's joints along a line, piece by piece.

    The line begins at the pose of `begin_rad`, shape (7,) [rad], inside the limits; `parts` are places on it, rising
    from 0 to 1.

    Returns:
        The joints; or the first place at which the arm cannot be; or that the places are too far apart.
    """
    bend, points = arm.bend(begin_rad), [begin_rad]
    for number, part in enumerate(parts[1:], start=1):
        target = line.at(part)
        swivel = bend.swivel(target)
        if swivel is None:
            return _out_of_reach(side, part)
        nearly_rad = swivel.at(elbow.at(part))
        q_rad = bend.refined(target, nearly_rad)
        refusal = _outside(side, part, q_rad or nearly_rad, limits)
        if refusal is not None or q_rad is None:
            return refusal or _out_of_reach(side, part)
        points.append(q_rad)
        if not bend.is_exact:
            yield from SEARCHED
        elif number % SOLVED == 0:
            yield
    columns: list[Trajectory] = []
    for joint in range(ARM_DOF):
        columns.append(interpolate([(q_rad[joint],) for q_rad in points], parts))
        yield
    curve = _joined(columns, points)
    for number, (before, after) in enumerate(pairwise(parts)):
        middle = 0.5 * (before + after)
        is_at, wanted = arm.chain.forward(curve.at(middle)[0]), line.at(middle)
        off_m, off_rad = math.dist(is_at.p_m, wanted.p_m), math.hypot(*turn_rad(is_at.rows, wanted.rows))
        if off_m > OFF_M or off_rad > OFF_RAD or _overshoots(curve, number, limits):
            return Coarse(middle)
        if number % CHECKED == 0:
            yield
    return curve


def _joined(columns: Sequence[Trajectory], points: Sequence[Vector]) -> Curve:
    """Return the trajectories of single joints as one of all."""
    names = ("q", "v", "a", "j", "low", "high", "speed", "peaks")
    each = {name: tuple([getattr(column, name)[0] for column in columns]) for name in names}
    return Trajectory(times_s=columns[0].times_s, points=tuple(points), **each)


def _overshoots(curve: Curve, piece: int, limits: JointLimits) -> bool:
    """Whether the spline leaves the limits between two places."""
    return any(
        low[piece] < lower - SLACK_RAD or high[piece] > upper + SLACK_RAD
        for low, high, lower, upper in zip(curve.low, curve.high, limits.lower_rad, limits.upper_rad, strict=True)
    )


def _outside(side: Side, part: float, q_rad: Vector, limits: JointLimits) -> Refusal | None:
    for n, (q, lower, upper) in enumerate(zip(q_rad, limits.lower_rad, limits.upper_rad, strict=True)):
        if not lower - SLACK_RAD <= q <= upper + SLACK_RAD:
            name = ARM_JOINTS[side][n]
            return Refusal(
                code=Code.NO_STRAIGHT_WAY,
                message=(
                    f"the straight way leaves the limits: {place(part)} {side} arm joint {n + 1} ({name}) would be at "
                    f"{q:.4f} rad, outside [{lower:.2f}, {upper:.2f}] rad (manual §4.13 or tighter configuration)"
                ),
                field=f"{side}_arm[{n}]",
                value=f"{q:.6g}",
                bound=f"[{lower:g}, {upper:g}]",
                unit="rad",
            )
    return None


def _out_of_reach(side: Side, part: float) -> Refusal:
    return Refusal(
        code=Code.NO_STRAIGHT_WAY,
        message=f"the straight way leaves the reach: {place(part)} the {side} arm's wrist is nearer to the shoulder, or "
        "further from it, than any angle of the elbow allows",
        field=f"{side}_arm",
        value=f"{part:.4f}",
        bound="1",
        unit="of the way",
    )
