"""Validation of chunks of poses, as `chunk.py` is that for joints: what a pose, and the motion through poses, must keep.

Poses are in the arm's own shoulder frame (manual §4.0.1), xyzw. A quaternion near unit norm is normalised: policies
regress its components; one that is far from it is refused.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from gateway.codes import Code
from gateway.core.motion.bounds import not_finite, wrong_count
from gateway.core.motion.poses.pose_trajectory import PoseTrajectory
from gateway.core.motion.poses.quaternion import angle_rad
from gateway.errors import Refusal
from gateway.robot.limits import MAX_ARM_LEN_M
from gateway.values import Side, Vector

__all__ = ["JUMP_M", "JUMP_RAD", "Bounds", "check_pose", "check_pose_jump", "check_pose_motion"]

POSE_SIZE = 7
NORM_TOLERANCE = 0.05
"""How far the norm of a quaternion may be from 1."""

JUMP_M = 0.02
JUMP_RAD = 0.1
"""How far the chunk may be from the arm's reference when it begins [m], [rad] (BEHAVIOUR, values)."""

SLACK = 1.0 + 1e-9
"""Rounding of what was worked out from poses that lie exactly at a limit."""

Bounds = tuple[float, float, float, float, float]
"""Reach [m], linear speed [m/s] and acceleration [m/s²], angular speed [rad/s] and acceleration [rad/s²]."""

KINDS = (
    ("distance from the shoulder", "m", 0.0),
    ("linear speed", "m/s", 1.0),
    ("linear acceleration", "m/s²", 0.5),
    ("angular speed", "rad/s", 1.0),
    ("angular acceleration", "rad/s²", 0.5),
)
"""Of the bounds: name, unit, and the power of the excess by which time must be stretched; 0 where that does not help."""


def check_pose(side: Side, index: int, pose: Sequence[float]) -> Refusal | None:
    """Refuse what is no pose in the robot's reach."""
    field = f"{side}_arm[{index}]"
    if len(pose) != POSE_SIZE:
        return wrong_count(f"{side} arm point {index}", len(pose), POSE_SIZE, field, "x, y, z, qx, qy, qz, qw")
    for n, value in enumerate(pose):
        if not math.isfinite(value):
            return not_finite(f"{side} arm point {index} value {n}", value, f"{field}[{n}]")
    reach_m, norm = math.hypot(*pose[:3]), math.hypot(*pose[3:])
    if reach_m > MAX_ARM_LEN_M:
        return _beyond(side, index, 0, reach_m, MAX_ARM_LEN_M, "stay in reach; chunks are never clipped")
    if abs(norm - 1.0) > NORM_TOLERANCE:
        return Refusal(
            code=Code.OUT_OF_RANGE,
            message=f"{side} arm point {index}: the quaternion's norm is {norm:.4f}, 1 is needed (xyzw, manual §4.0.2)",
            field=f"{field}[3]",
            value=f"{norm:.6g}",
            bound=f"[{1.0 - NORM_TOLERANCE}, {1.0 + NORM_TOLERANCE}]",
            hint="give x, y, z, then qx, qy, qz, qw of unit norm",
        )
    return None


def check_pose_motion(side: Side, trajectory: PoseTrajectory, bounds: Bounds) -> Refusal | None:
    """Refuse a motion that leaves the reach, or is faster than it can be followed, anywhere.

    Bounds are norms, as `pose_follower.followed` gives them.
    """
    rows = (trajectory.reach_m, trajectory.v_mps, trajectory.a_mps2, trajectory.w_radps, trajectory.dw_radps2)
    stretch = 1.0
    first: tuple[int, int] | None = None
    for kind, (row, bound) in enumerate(zip(rows, bounds, strict=True)):
        most = max(row)
        stretch = max(stretch, (most / bound) ** KINDS[kind][2])
        if most > bound * SLACK:
            index = next(n for n, value in enumerate(row) if value > bound * SLACK)
            first = min(first or (index, kind), (index, kind))
    if first is None:
        return None
    index, kind = first
    hint = f"stretch={math.ceil(stretch * 1000.0 - 1e-6) / 1000.0:g} is slow enough; against jitter ask for smoothing"
    if kind == 0:
        hint = "stay in reach; chunks are never clipped"
    return _beyond(side, index, kind, rows[kind][index], bounds[kind], hint)


def check_pose_jump(side: Side, pose: Vector, reference: Vector) -> Refusal | None:
    """Refuse a chunk that is too far from the arm's reference where it begins."""
    off_m, off_rad = math.dist(pose[:3], reference[:3]), angle_rad(pose[3:], reference[3:])
    for off, bound, unit in ((off_m, JUMP_M, "m"), (off_rad, JUMP_RAD, "rad")):
        if off > bound * SLACK:
            return Refusal(
                code=Code.JUMP_TOO_FAR,
                message=f"the {side} arm's chunk is {off:.4f} {unit} from the arm's reference where it begins, {bound} "
                f"{unit} is the bound",
                field=f"{side}_arm[0]",
                value=f"{off:.6g}",
                bound=str(bound),
                unit=unit,
            )
    return None


def _beyond(side: Side, index: int, kind: int, value: float, bound: float, hint: str) -> Refusal:
    name, unit, power = KINDS[kind]
    limit = "what is followed in any direction" if power else "the limit"
    return Refusal(
        code=Code.TOO_FAST if power else Code.OUT_OF_RANGE,
        message=f"{side} arm point {index}: {name} {value:.4g} {unit} there or on the way to the next point, {bound:.4g} "
        f"{unit} is {limit}",
        field=f"{side}_arm[{index}]",
        value=f"{value:.6g}",
        bound=f"{bound:g}",
        unit=unit,
        hint=hint,
    )
