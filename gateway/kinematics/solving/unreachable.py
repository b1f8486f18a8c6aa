"""Unreachable: why an arm cannot take a pose, and how far it is from being able to; the code is `OUT_OF_RANGE`.

Either the wrist would have to be nearer to or further from the shoulder than the elbow allows, or the hand would have to be
turned so that some joint is beyond its limit at every arm angle; then the joint is named that is least beyond.
"""

from __future__ import annotations

from gateway.errors import Code, Refusal
from gateway.kinematics.placement import Placement
from gateway.kinematics.solving.inverse import ClosedForm
from gateway.robot.topics import ARM_JOINTS
from gateway.values import Side

__all__ = ["not_found", "why_not"]


def why_not(closed: ClosedForm, side: Side, target: Placement) -> Refusal:
    """Return why there is no solution inside the limits."""
    distance, (near, far) = closed.distance_m(target), closed.reach_m()
    if not near <= distance <= far:
        return _out_of_reach(side, target, distance, near, far)
    return _out_of_limits(closed, side, target)


def _out_of_reach(side: Side, target: Placement, distance: float, near: float, far: float) -> Refusal:
    excess = max(near - distance, distance - far)
    which, advice = ("near", "away from") if distance < near else ("far", "towards")
    at = ", ".join(f"{c:.4f}" for c in target.p_m)
    return Refusal(
        code=Code.OUT_OF_RANGE,
        message=(
            f"{side}_ee at ({at}) m puts the wrist {distance:.4f} m from the shoulder, {1e3 * excess:.1f} mm too {which}: "
            f"the elbow's limits leave {near:.4f} to {far:.4f} m"
        ),
        field=f"{side}_arm",
        value=f"{distance:.6g}",
        bound=f"[{near:.6g}, {far:.6g}]",
        unit="m",
        hint=f"move the target at least {1e3 * excess:.1f} mm {advice} the shoulder",
    )


def _out_of_limits(closed: ClosedForm, side: Side, target: Placement) -> Refusal:
    branch, arm_angle = closed.least_beyond(target)
    name = ARM_JOINTS[side][branch.joint]
    q, (low, high) = branch.q_rad[branch.joint], closed.limits_rad[branch.joint]
    return Refusal(
        code=Code.OUT_OF_RANGE,
        message=(
            f"{side}_ee is within reach there, but turned so that {name} would be {branch.beyond_rad:.4f} rad beyond its "
            f"limit at best: {q:.4f} rad is outside [{low:.4g}, {high:.4g}] rad (arm angle {arm_angle:.2f} rad; any other "
            "takes a joint further out)"
        ),
        field=name,
        value=f"{q:.6g}",
        bound=f"[{low:.6g}, {high:.6g}]",
        unit="rad",
        hint=f"turn the hand by {branch.beyond_rad:.3f} rad or more, or move it",
    )


def not_found(side: Side, error_m: float, error_rad: float) -> Refusal:
    """Return that a numerical search, all there is for an arm of another shape, ended short of the pose."""
    return Refusal(
        code=Code.OUT_OF_RANGE,
        message=(
            f"{side}_ee was not brought to the pose: the search ended {1e3 * error_m:.2f} mm and {error_rad:.4f} rad off"
        ),
        field=f"{side}_arm",
        value=f"{error_m:.6g}",
        bound="0",
        unit="m",
        hint="this arm's axes do not meet, so there is no proof: try a seed nearer to the goal, or another pose",
    )
