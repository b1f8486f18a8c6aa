"""What chassis and lift may be asked for, and when: pure functions, as those of `validation.py`.

Neither needs the arms' FSM to be enabled (manual §4.5, §4.6), nor to be heard; but a robot that plays a recording or is
driven from VR (FSM 3-6) is not ours to drive. Both need API mode and their switch in the robot's configuration, which
`/api/current_mode` shows. Velocities are refused outside the limits, never clipped.
"""

from __future__ import annotations

import math

from gateway.codes import Code
from gateway.core.limits.validation import check_mode
from gateway.core.motion.bounds import not_finite
from gateway.errors import Refusal
from gateway.robot.limits import HARD_CHASSIS_V_MPS, HARD_CHASSIS_W_RADPS
from gateway.settings.settings import ChassisSettings, LiftSettings
from gateway.values import OWN_FSM, CurrentMode, FsmState, Vector

__all__ = ["check_chassis", "check_chassis_velocity", "check_lift", "check_lift_velocity", "no_lift"]

NAMES = ("vx_mps", "vy_mps", "wz_radps")


def no_lift() -> Refusal:
    """Return the refusal of whatever is asked of a lift that the model does not have."""
    return Refusal(
        code=Code.NO_LIFT,
        message="this model of the robot has no lift (manual §1.2)",
        field="lift",
        value="none",
        bound="the lift model",
    )


def check_chassis(mode: CurrentMode | None, fsm: int | None) -> Refusal | None:
    """Refuse unless the robot is in API mode with its chassis enabled, and its FSM not somebody else's."""
    refusal = check_mode(mode) or _check_fsm(fsm)
    if refusal is not None or (mode is not None and mode.chassis_enabled):
        return refusal
    return Refusal(
        code=Code.CHASSIS_DISABLED,
        message="the chassis is disabled in the robot's system configuration (manual §2.3)",
        field="chassis",
        value="disabled",
        bound="enabled",
    )


def check_lift(mode: CurrentMode | None, fsm: int | None) -> Refusal | None:
    """Refuse unless the robot is in API mode with its lift servo enabled, and its FSM neither in ERROR nor another's."""
    refusal = check_mode(mode) or _check_fsm(fsm)
    if refusal is not None or mode is None:
        return refusal
    if not mode.lift_enabled:
        return Refusal(
            code=Code.LIFT_DISABLED,
            message="the lift servo is disabled in the robot's system configuration (manual §2.3)",
            field="lift",
            value="disabled",
            bound="enabled",
        )
    if fsm == FsmState.ERROR:
        return Refusal(
            code=Code.FSM_ERROR,
            message="the robot's FSM is ERROR (-1), in which the robot stops its lift (manual §4.6)",
            field="fsm_state",
            value=str(int(FsmState.ERROR)),
        )
    return None


def _check_fsm(fsm: int | None) -> Refusal | None:
    """Refuse beside VR or playback, which move the robot themselves; an FSM that is not heard says nothing."""
    if fsm is None or fsm in OWN_FSM:
        return None
    return Refusal(
        code=Code.FSM_BUSY,
        message=f"the robot's FSM is {fsm}: VR single arm, playback or unknown (manual §4.11.1)",
        field="fsm_state",
        value=str(fsm),
        bound="-1, 0, 1, 2",
    )


def check_chassis_velocity(velocity: Vector, settings: ChassisSettings) -> Refusal | None:
    """Refuse a velocity that is not finite, or faster than the configured limits.

    Args:
        velocity: vx, vy [m/s], wz [rad/s].
        settings: The limits; the speed over the ground counts, whatever its direction.
    """
    for name, value in zip(NAMES, velocity, strict=True):
        if not math.isfinite(value):
            return not_finite(name, value, name)
    speed_mps = math.hypot(*velocity[:2])
    if speed_mps > settings.v_mps:
        return _too_fast(
            "vx_mps, vy_mps", "the speed over the ground", speed_mps, settings.v_mps, "m/s", HARD_CHASSIS_V_MPS
        )
    if abs(velocity[2]) > settings.w_radps:
        return _too_fast("wz_radps", "the turning", velocity[2], settings.w_radps, "rad/s", HARD_CHASSIS_W_RADPS)
    return None


def check_lift_velocity(velocity: float, settings: LiftSettings) -> Refusal | None:
    """Refuse a velocity that is not finite, or outside the configured part of full speed."""
    if not math.isfinite(velocity):
        return not_finite("velocity", velocity, "velocity")
    if abs(velocity) > settings.v_max:
        return _too_fast("velocity", "the velocity of the lift", velocity, settings.v_max, "", 1.0)
    return None


def _too_fast(field: str, what: str, value: float, bound: float, unit: str, hard: float) -> Refusal:
    in_unit = f" {unit}" if unit else ""
    return Refusal(
        code=Code.OUT_OF_RANGE,
        message=f"{what} is {value:.4g}{in_unit}, at most {bound:g}{in_unit} is configured (hard bound {hard:g}{in_unit})",
        field=field,
        value=f"{value:.6g}",
        bound=f"[{-bound:g}, {bound:g}]",
        unit=unit,
        hint="stay inside the bound",
    )
