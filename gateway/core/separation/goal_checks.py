"""Goals of arms that are kept apart: whether they are now, where they are, whether a goal leaves the margin between parts.

What the self-collision guard asks of a request; what it does tick by tick is `spacing.py`'s. A goal is judged by itself, with
the other arm where it is bound for; the way to it is not: that is looked at while it is gone.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING

from gateway.core.supervision.coordinator import Coordinator
from gateway.errors import Code, Refusal
from gateway.values import ARM_DOF, Side, Space, Vector

if TYPE_CHECKING:  # it takes numpy along, which a guard has no use for
    from gateway.kinematics.collision import CollisionModel

__all__ = ["check_goals", "check_unguarded", "whereabouts", "why_off"]

TOUCHED_M = 1e-9
"""Rounding of a gap that stays as it is [m]."""


def why_off(coordinator: Coordinator, now_ns: int) -> Refusal | None:
    """Return why arms are not kept apart now; None while they are."""
    if not coordinator.settings.model.self_collision:
        message = "section [model] of the configuration does not ask for it"
        return Refusal(code=Code.MODEL_OFF, message=message, field="model.self_collision", value="false")
    refusals = (coordinator.model_refusal(side, now_ns) for side in Side)
    return next((refusal for refusal in refusals if refusal is not None), None)


def whereabouts(coordinator: Coordinator) -> dict[Side, Vector]:
    """Return where the arms are, shape (7,) each [rad]: by their setpoints, else as measured; none that was never heard."""
    found: dict[Side, Vector] = {}
    for side, arm in coordinator.body.joint_arms.items():
        measured = coordinator.store.arm(side)
        if arm.running:
            found[side] = arm.values
        elif measured is not None:
            found[side] = measured.q_rad
    return found


def check_goals(
    coordinator: Coordinator, goals: Mapping[Side, Vector], now_ns: int, *, hands_only: bool = False
) -> Refusal | None:
    """Refuse goals at which parts of the body would be nearer than the margin, and nearer than they are.

    Goals are inside the limits, per side shape (7,) [rad]; with `hands_only` only the poses of the hands are sure,
    and not how the arms will be bent.
    """
    model, here = coordinator.model, whereabouts(coordinator)
    if model is None or model.collision is None or len(here) < len(Side) or why_off(coordinator, now_ns) is not None:
        return None
    there = {side: goals[side] if side in goals else _bound_for(coordinator, side, here[side]) for side in Side}
    posture, margin_m = model.collision.posture(there), model.collision.margin_m
    before = model.collision.posture(here)
    for gap_m, number in posture.within(margin_m):
        now_m = before.told(number).gap_m
        if gap_m < min(margin_m, now_m) - TOUCHED_M and not (hands_only and _depends(model.collision, number, goals)):
            near = posture.told(number)
            return Refusal(
                code=Code.GOAL_TOO_NEAR,
                message=(
                    f"{near.first} and {near.second} would be {_mm(gap_m)} at the goal (now {_mm(now_m)}), "
                    f"{1e3 * margin_m:.0f} mm must stay free between them"
                ),
                field=" and ".join(f"{side}_arm" for side in goals),
                value=f"{gap_m:.4f}",
                bound=f">= {margin_m:g}",
                unit="m",
            )
    return None


def check_unguarded(coordinator: Coordinator, sides: Sequence[Side], space: Space, now_ns: int) -> Refusal | None:
    """Refuse to move an arm by poses while arms are kept apart: where its joints go is the robot's own secret."""
    if space is Space.JOINT or why_off(coordinator, now_ns) is not None:
        return None
    side = sides[0]
    return Refusal(
        code=Code.UNGUARDED,
        message=(
            f"the {side} arm is in end-effector mode: the robot alone decides where its joints go (manual §4.2), so that "
            "nobody can keep it apart from the other arm and the body, which section [model] asks for"
        ),
        field=f"{side}_arm",
        value="end-effector",
        bound="joint",
    )


def _depends(parts: CollisionModel, number: int, sides: Collection[Side]) -> bool:
    """Whether the gap of a pair depends on how these arms are bent, beside the poses of their hands."""
    first, second, *_ = parts.pairs[number]
    both = (parts.capsules[first], parts.capsules[second])
    return any(part.side in sides and 0 < part.after < ARM_DOF for part in both)


def _bound_for(coordinator: Coordinator, side: Side, here: Vector) -> Vector:
    """Return where an arm that no goal is asked for will be."""
    motion, arm = coordinator.body.motions.of(side), coordinator.body.joint_arms[side]
    if motion is not None and motion.space is Space.JOINT:
        return motion.goals[side]
    return arm.reference.end_values() if arm.running else here


def _mm(gap_m: float) -> str:
    return f"{1e3 * gap_m:.0f} mm apart" if gap_m >= 0.0 else f"{-1e3 * gap_m:.0f} mm inside each other"
