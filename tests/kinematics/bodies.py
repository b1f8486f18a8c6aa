"""What tests of the kinematics share: both arms, random configurations inside their limits, and how far poses differ."""

from __future__ import annotations

import random
from collections.abc import Iterator

from gateway.errors import Refusal
from gateway.kinematics.arm import ArmModel
from gateway.kinematics.description import Description, arm_joint, nominal
from gateway.kinematics.placement import Placement, turn_rad
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import Side, Vector
from tests.changed import replace

__all__ = ["ARMS", "difference", "excess", "nudged", "samples"]

ARMS = {side: ArmModel(nominal(), side) for side in Side}


def samples(side: Side, count: int, seed: int = 0) -> Iterator[Vector]:
    """Yield configurations, evenly spread inside the robot's limits."""
    rng = random.Random(f"{side}{seed}")
    for _ in range(count):
        yield tuple(rng.uniform(a, b) for a, b in zip(JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side], strict=True))


def difference(a: Placement, b: Placement) -> tuple[float, float]:
    """Return distance [m] and angle [rad] between two placements."""
    way = sum((x - y) ** 2 for x, y in zip(a.p_m, b.p_m, strict=True)) ** 0.5
    return way, sum(c * c for c in turn_rad(a.rows, b.rows)) ** 0.5


def excess(refusal: Refusal) -> float:
    """Return how far the value of a refusal is outside its bound, to six digits of both."""
    low, high = (float(v) for v in refusal.bound.strip("[]").split(","))
    return max(low - float(refusal.value), float(refusal.value) - high)


def nudged(
    side: Side, number: int, *, xyz_m: Vector = (0.0, 0.0, 0.0), rpy_rad: Vector = (0.0, 0.0, 0.0)
) -> Description:
    """Return the nominal body with one joint of an arm displaced in its parent."""
    ours = nominal()
    joint = ours.joints[arm_joint(side, number)]
    moved = replace(
        joint,
        xyz_m=tuple(a + b for a, b in zip(joint.xyz_m, xyz_m, strict=True)),
        rpy_rad=tuple(a + b for a, b in zip(joint.rpy_rad, rpy_rad, strict=True)),
    )
    return replace(ours, joints={**ours.joints, joint.name: moved})
