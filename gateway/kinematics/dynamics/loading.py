"""Loading: the dynamics that the settings ask for. pinocchio is imported here, when it is asked for, and nowhere before."""

from __future__ import annotations

from gateway.errors import Code, failure
from gateway.kinematics.calibration_file.arm_section import fingerprint
from gateway.kinematics.configured import calibration, configured
from gateway.kinematics.dynamics.observer import Dynamics
from gateway.kinematics.dynamics.parameters import nominal_parameters
from gateway.settings.settings import Settings
from gateway.values import Side

__all__ = ["load_dynamics"]


def load_dynamics(settings: Settings) -> dict[Side, Dynamics]:
    """Return the dynamics of both arms.

    Args:
        settings: All of them.

    Raises:
        ConfigError: BAD_CONFIG, pinocchio is not installed, or a file of the model cannot be used.
    """
    try:
        from gateway.kinematics.dynamics import arm_dynamics
    except ImportError as error:
        raise failure(
            Code.BAD_CONFIG,
            f"model.dynamics = true needs pinocchio, which is not installed ({error})",
            field="model.dynamics",
            value="true",
            hint="install it: pip install 'teleavatar-gateway[body]', or leave model.dynamics = false",
        ) from error
    description, found = configured(settings), calibration(settings)
    drives = {side: nominal_parameters(description, side) for side in Side}
    for side, arm in found.dynamics.items() if found is not None else ():
        if arm.numbers != fingerprint(description, side):
            raise failure(
                Code.BAD_CONFIG,
                f"{settings.model.calibration}: the {side} arm's dynamics were identified on other numbers than these",
                field="model.calibration",
                hint="run `ta2 identify --dynamics` again",
            )
        drives[side] = arm.drives
    return {side: arm_dynamics.ArmDynamics(description, side, drives[side]) for side in Side}
