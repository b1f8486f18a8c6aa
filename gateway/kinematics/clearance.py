"""Clearance: where the hull must not be in its own way. Rows of `ta2 model check`.

A hull that is too thick would refuse what robots do every day: the home of §6.6, hanging arms (§6.4), and both hands side by
side before the body, at a grid of places, as they are held at home. All must keep the margin.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

from gateway.kinematics.arm import ArmModel
from gateway.kinematics.collision import CollisionModel, Nearness
from gateway.kinematics.description import Description
from gateway.kinematics.model_check import Finding
from gateway.kinematics.solving.inverse import Solution
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import EePose, Side, Vector

__all__ = ["HANGING_Q_RAD", "clearances", "ordinary"]

HANGING_Q_RAD: dict[Side, Vector] = {
    Side.LEFT: (0.0, 1.57, 0.0, 0.26, 0.0, 0.0, 0.0),
    Side.RIGHT: (0.0, -1.57, 0.0, -0.26, 0.0, 0.0, 0.0),
}
"""Target of the manual's example in joint mode [rad] (§6.4)."""

AHEAD_M = (0.25, 0.30, 0.35, 0.40, 0.45)
OUTWARD_M = (0.0, 0.05, 0.10, 0.15)
UP_M = (-0.40, -0.30, -0.20, -0.10, 0.0)


def clearances(description: Description) -> tuple[Finding, ...]:
    """Return whether ordinary postures keep the margin.

    Args:
        description: Numbers of the body; the hull is our own.
    """
    model = CollisionModel(description)
    before = [model.posture(q_rad).nearest() for q_rad in ordinary(description)]
    return (
        _row("home of §6.6 is free", [model.posture(HOME_Q_RAD).nearest()], model.margin_m),
        _row("hanging arms of §6.4 are free", [model.posture(HANGING_Q_RAD).nearest()], model.margin_m),
        _row(f"{len(before)} places of both hands before the body are free", before, model.margin_m),
    )


def ordinary(description: Description) -> Iterator[dict[Side, Vector]]:
    """Yield joint angles with both hands at a grid of places before the body, where they can be reached."""
    arms = {side: ArmModel(description, side) for side in Side}
    held = {side: arms[side].forward(HOME_Q_RAD[side]).quat_xyzw for side in Side}
    for x, outward, z in product(AHEAD_M, OUTWARD_M, UP_M):
        found = {}
        for side in Side:
            y = outward if side is Side.LEFT else -outward
            solved = arms[side].solution(EePose(p_m=(x, y, z), quat_xyzw=held[side]), HOME_Q_RAD[side])
            if isinstance(solved, Solution):
                found[side] = solved.q_rad
        if len(found) == len(Side):
            yield found


def _row(name: str, near: list[Nearness], margin_m: float) -> Finding:
    least = min(near, key=lambda row: row.gap_m)
    return Finding(
        name=name,
        found=f"{1e3 * least.gap_m:.0f} mm between {least.first} and {least.second}",
        expected=f"{1e3 * margin_m:.0f} mm or more (our hull)",
        off=1e3 * max(margin_m - least.gap_m, 0.0),
        allowed=0.0,
        unit="mm",
    )
