"""Validation: whether a request may pass. Every refusal has a stable code, the value, the bound, its unit and a remedy.

Pure functions of what is known; they move nothing. `latched`, `check_mode` and `check_arms` answer for the robot's
condition, the other `check_*` functions for the input itself. Rejecting is the rule; clipping is opt-in per command and
reported. A refusal without a hint of its own gets the one of its code (`errors.CODES`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from msgspec import Struct, field

from gateway.core.motion.bounds import not_finite, within, wrong_count
from gateway.errors import Code, Refusal
from gateway.messages.incoming import OnLimit
from gateway.robot.topics import ARM_JOINTS
from gateway.settings.settings import ArmSettings
from gateway.values import ARM_DOF, CurrentMode, Side, Space, Vector

__all__ = [
    "Checked",
    "Fitness",
    "check_arms",
    "check_expiry",
    "check_goal",
    "check_mode",
    "check_speed",
    "check_start",
    "check_tolerance",
    "latched",
]

MS = 1_000_000
S = 1_000_000_000

CONTROL_MODES = {Space.JOINT: "joint", Space.POSE: "end-effector"}
"""Control modes of an arm, as the robot's configuration page calls them (manual §2.3)."""
CONTROL_HINTS = {
    Space.JOINT: "move it with move_to() or a stream of joints, or set it to end-effector mode in the robot's web page",
    Space.POSE: "move it with move_pose() or a stream of poses, or set it to joint mode in the robot's web page",
}
"""What to do with an arm that is in a mode."""

MIN_SPEED = 0.001
"""Slowest speed factor: a joint then needs an hour for its range."""


class Checked(Struct, frozen=True, kw_only=True):
    """A goal or a start inside the limits.

    Attributes:
        values: Seven joints [rad], or x, y, z [m], qx, qy, qz, qw with norm 1.
        clipped: Indices of the values that were moved to a limit; of a goal only where clipping was asked for.
    """

    values: Vector
    clipped: tuple[int, ...] = ()


class Fitness(Struct, frozen=True, kw_only=True):
    """What must be known of the robot to let a motion of some arms pass.

    Attributes:
        mode: `/api/current_mode`; None when unknown.
        part_fresh: Per side, whether its state is fresh.
        streaming: Per side, whether its stream runs since the last `enable`.
        spaces: Per side, the space in which it would be moved or held.
        stale_ns: State older than this is not fresh [ns].
    """

    mode: CurrentMode | None
    part_fresh: Mapping[Side, bool]
    streaming: Mapping[Side, bool]
    spaces: Mapping[Side, Space] = field(default_factory=lambda: dict.fromkeys(Side, Space.JOINT))
    stale_ns: int = 100 * MS


def latched(latches: Mapping[Code, str]) -> Refusal | None:
    """Refuse with all causes when something is latched."""
    if not latches:
        return None
    causes = "; ".join(f"{code}: {message}" for code, message in latches.items())
    return Refusal(
        code=Code.LATCHED, message=f"motion is latched off ({causes})", field="latches", value=", ".join(latches)
    )


def check_mode(mode: CurrentMode | None) -> Refusal | None:
    """Refuse unless the robot is known to be in API mode (manual §3.1.1)."""
    if mode is None:
        return Refusal(
            code=Code.MODE_UNKNOWN,
            message="/api/current_mode has not been heard for 3 s (manual §4.11.2)",
            field="mode",
            value="unknown",
            bound="API",
        )
    if not mode.api:
        return Refusal(
            code=Code.MODE_VR,
            message="the robot is in VR mode and takes no API commands (manual §3.1.1)",
            field="mode",
            value="VR",
            bound="API",
        )
    return None


def check_arms(fitness: Fitness, sides: Sequence[Side]) -> Refusal | None:
    """Refuse unless every named arm is enabled, in the control mode of its motion, streaming and fresh."""
    refusal = check_mode(fitness.mode)
    if refusal is not None or fitness.mode is None:
        return refusal
    for side in sides:
        if not fitness.mode.arm_enabled[side]:
            return Refusal(
                code=Code.ARM_DISABLED,
                message=f"the {side} arm is disabled in the robot's system configuration (manual §2.3)",
                field=f"{side}_arm",
                value="disabled",
                bound="enabled",
            )
        space = fitness.mode.space(side)
        if space is not fitness.spaces[side]:
            is_mode, needed = CONTROL_MODES[space], CONTROL_MODES[fitness.spaces[side]]
            return Refusal(
                code=Code.WRONG_CONTROL_MODE,
                message=f"the {side} arm is in {is_mode} mode, {needed} mode is needed (manual §2.3, §4.11.2)",
                field=f"{side}_arm",
                value=is_mode,
                bound=needed,
                hint=CONTROL_HINTS[space],
            )
        if not fitness.part_fresh[side]:
            bound = f"{fitness.stale_ns / MS:g}"
            return Refusal(
                code=Code.PART_STALE,
                message=f"the state of the {side} arm is older than {bound} ms",
                field=f"{side}_arm",
                bound=bound,
                unit="ms",
            )
        if not fitness.streaming[side]:
            return Refusal(
                code=Code.NOT_ENABLED,
                message=f"the {side} arm was not enabled by the last enable()",
                field=f"{side}_arm",
            )
    return None


def check_speed(speed: float) -> Refusal | None:
    """Refuse a speed factor outside [0.001, 1]: slower ones have no plan that is of use to anybody."""
    return within("speed", speed, MIN_SPEED, 1.0, hint="give 1 for the configured velocity limit, or less")


def check_tolerance(
    tolerance: float | None, field: str = "tolerance_rad", most: float = 0.2, unit: str = "rad"
) -> Refusal | None:
    """Refuse a settling tolerance outside [1e-4, 0.2] rad, or [1e-4, `most`] of another unit."""
    if tolerance is None:
        return None
    hint = "stay inside the bound, or leave the tolerance away for the configured one"
    return within("tolerance", tolerance, 1e-4, most, unit, field=field, hint=hint)


def check_expiry(expiry_ns: int | None) -> Refusal | None:
    """Refuse an expiry of targets outside [0.05, 3] s."""
    if expiry_ns is None:
        return None
    hint = "stay inside the bound, or leave the expiry away for the configured one"
    return within("expiry", expiry_ns / S, 0.05, 3.0, "s", field="expiry_ns", hint=hint)


def check_goal(side: Side, q_rad: Sequence[float], settings: ArmSettings, on_limit: OnLimit) -> Checked | Refusal:
    """Return the goal to use, or why it is none: WRONG_SHAPE, NOT_FINITE or OUT_OF_RANGE (configured limits).

    Joints are in the order of manual §4.0.3 [rad].
    """
    name = f"{side}_arm"
    if len(q_rad) != ARM_DOF:
        return wrong_count(f"the {side} arm's goal", len(q_rad), ARM_DOF, name, "its joints (manual §4.0.3)")
    goal = list(q_rad)
    clipped: list[int] = []
    for n, value in enumerate(goal):
        low, high = settings.lower_rad[side][n], settings.upper_rad[side][n]
        if not math.isfinite(value):
            joint = f"{side} arm joint {n + 1} ({ARM_JOINTS[side][n]})"
            return not_finite(joint, value, f"{name}[{n}]", f"[{low}, {high}]", "rad")
        if low <= value <= high:
            continue
        if on_limit is OnLimit.CLIP:
            goal[n] = min(max(value, low), high)
            clipped.append(n)
            continue
        return Refusal(
            code=Code.OUT_OF_RANGE,
            message=(
                f"{side} arm joint {n + 1} ({ARM_JOINTS[side][n]}): {value:.4f} rad is outside "
                f"[{low:.2f}, {high:.2f}] rad (manual §4.13 or tighter configuration)"
            ),
            field=f"{name}[{n}]",
            value=f"{value:.6g}",
            bound=f"[{low}, {high}]",
            unit="rad",
        )
    return Checked(values=tuple(goal), clipped=tuple(clipped))


def check_start(side: Side, q_rad: Vector, settings: ArmSettings) -> Checked | Refusal:
    """Check where an arm is before its stream starts there.

    Up to `start_margin_rad` beyond a limit the start is moved to the limit (`clipped` says which joints); further out it
    is refused with START_OUTSIDE_LIMITS.
    """
    start = list(q_rad)
    clipped: list[int] = []
    for n, value in enumerate(q_rad):
        low, high = settings.lower_rad[side][n], settings.upper_rad[side][n]
        if low <= value <= high:
            continue
        if value < low - settings.start_margin_rad or value > high + settings.start_margin_rad:
            return Refusal(
                code=Code.START_OUTSIDE_LIMITS,
                message=(
                    f"{side} arm joint {n + 1} is at {value:.4f} rad, more than {settings.start_margin_rad} rad outside "
                    f"[{low:.2f}, {high:.2f}] rad (manual §4.13 or tighter configuration)"
                ),
                field=f"{side}_arm[{n}]",
                value=f"{value:.6g}",
                bound=f"[{low}, {high}]",
                unit="rad",
            )
        start[n] = min(max(value, low), high)
        clipped.append(n)
    return Checked(values=tuple(start), clipped=tuple(clipped))
