"""Validation of poses: shape, finiteness, frame, norm and reach of what is asked, and of where an arm begins.

Pure functions, as in `validation.py`. A pose is x, y, z [m] and a quaternion in xyzw, in the arm's own shoulder frame,
which must be named: the same numbers in the other arm's frame are another place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from gateway.core.limits.validation import Checked, check_tolerance
from gateway.core.motion.bounds import not_finite, wrong_count
from gateway.core.motion.gap import Gap
from gateway.core.motion.poses.pose_state import NORM_TOLERANCE
from gateway.core.motion.poses.quaternion import unit
from gateway.errors import Code, Refusal
from gateway.messages.incoming import OnLimit
from gateway.robot.topics import shoulder_frame
from gateway.settings.settings import PoseSettings
from gateway.values import Side, Vector

__all__ = ["check_frame", "check_pose", "check_pose_start", "check_pose_tolerance"]

WIDTH = 7


def check_frame(side: Side, frame: str) -> Refusal | None:
    """Refuse a pose that is not in the frame of its arm (manual §4.0.1)."""
    wanted = shoulder_frame(side)
    if frame == wanted:
        return None
    said = f"is in frame {frame!r}" if frame else "has no frame"
    return Refusal(
        code=Code.WRONG_FRAME,
        message=f"the pose for the {side} arm {said}, {wanted!r} is needed (manual §4.0.1)",
        field=f"{side}_arm.frame",
        value=frame,
        bound=wanted,
    )


def check_pose(
    side: Side, values: Sequence[float], settings: PoseSettings, on_limit: OnLimit = OnLimit.REJECT
) -> Checked | Refusal:
    """Return the pose to use, or why it is none: WRONG_SHAPE, NOT_FINITE or OUT_OF_RANGE (norm of the quaternion, reach).

    Values are x, y, z [m], qx, qy, qz, qw; clipping moves a position beyond the reach to its end.
    """
    name = f"{side}_arm"
    if len(values) != WIDTH:
        return wrong_count(f"the pose for the {side} arm", len(values), WIDTH, name, "x, y, z, qx, qy, qz, qw")
    for n, value in enumerate(values):
        if not math.isfinite(value):
            return not_finite(f"value {n + 1} of the pose for the {side} arm", value, f"{name}[{n}]")
    norm = math.hypot(*values[3:])
    if abs(norm - 1.0) > NORM_TOLERANCE:
        return Refusal(
            code=Code.OUT_OF_RANGE,
            message=f"the quaternion for the {side} arm has norm {norm:.6g}, 1 is needed (xyzw, manual §4.2)",
            field=f"{name}.quat_xyzw",
            value=f"{norm:.6g}",
            bound=f"[{1.0 - NORM_TOLERANCE}, {1.0 + NORM_TOLERANCE}]",
            hint="give the quaternion as x, y, z, w with norm 1",
        )
    reach_m = math.hypot(*values[:3])
    if reach_m > settings.reach_m and on_limit is OnLimit.REJECT:
        return Refusal(
            code=Code.OUT_OF_RANGE,
            message=f"the pose for the {side} arm is {reach_m:.4f} m from its shoulder, outside [0, {settings.reach_m}] m "
            "(manual §4.0.4 or tighter configuration)",
            field=f"{name}.p_m",
            value=f"{reach_m:.6g}",
            bound=f"[0, {settings.reach_m}]",
            unit="m",
        )
    return _inside(values, settings.reach_m)


def _inside(values: Sequence[float], reach_m: float) -> Checked:
    """Return the pose with a unit quaternion and its position moved to the reach, where it is beyond it."""
    p_m, quat = tuple(values[:3]), unit(tuple(values[3:]))
    far_m = math.hypot(*p_m)
    if far_m <= reach_m:
        return Checked(values=p_m + quat)
    p_m = tuple(x * (reach_m / far_m) * (1.0 - 1e-12) for x in p_m)  # rounding must not put it outside again
    return Checked(values=p_m + quat, clipped=(0, 1, 2))


def check_pose_start(side: Side, values: Vector, settings: PoseSettings) -> Checked | Refusal:
    """Check where an end effector is before its stream starts there.

    Up to `start_margin_m` beyond the reach the start is moved to its end; further out it is refused with
    START_OUTSIDE_LIMITS.

    Args:
        side: Which arm.
        values: Measured pose: x, y, z [m], qx, qy, qz, qw.
        settings: Reach and margin.
    """
    reach_m = math.hypot(*values[:3])
    if reach_m > settings.reach_m + settings.start_margin_m:
        return Refusal(
            code=Code.START_OUTSIDE_LIMITS,
            message=f"the {side} arm is {reach_m:.4f} m from its shoulder, more than {settings.start_margin_m} m outside "
            f"[0, {settings.reach_m}] m (manual §4.0.4 or tighter configuration)",
            field=f"{side}_arm.p_m",
            value=f"{reach_m:.6g}",
            bound=f"[0, {settings.reach_m}]",
            unit="m",
        )
    return _inside(values, settings.reach_m)


def check_pose_tolerance(
    tolerance_m: float | None, tolerance_rad: float | None, settings: PoseSettings
) -> Gap | Refusal:
    """Return the settling tolerance of a pose, or refuse one outside [1e-4, 0.05] m and [1e-4, 0.2] rad.

    Args:
        tolerance_m: Of the position [m]; None for the configured one.
        tolerance_rad: Of the orientation [rad]; None for the configured one.
        settings: The configured ones.
    """
    refusal = check_tolerance(tolerance_m, "tolerance_m", 0.05, "m") or check_tolerance(tolerance_rad)
    if refusal is not None:
        return refusal
    return Gap(
        settings.settle_rad if tolerance_rad is None else tolerance_rad,
        settings.settle_m if tolerance_m is None else tolerance_m,
    )
