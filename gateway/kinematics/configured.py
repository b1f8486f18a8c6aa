"""Configured: the description of the body that the settings name: our own numbers or a URDF's, and this robot's calibration.

Whatever is wrong with one of the files is told before a daemon starts with other numbers than those it was told to use.
"""

from __future__ import annotations

from pathlib import Path

from gateway.errors import Code, failure
from gateway.kinematics.calibration import Calibration, RobotIdentity, load
from gateway.kinematics.description import Description, nominal
from gateway.kinematics.urdf import from_urdf
from gateway.settings.settings import Settings

__all__ = ["calibration", "configured"]


def configured(settings: Settings) -> Description:
    """Return the description that section [model] names, of the robot that section [robot] names.

    Raises:
        ConfigError: BAD_CONFIG, a file cannot be read, lacks something, holds nothing about arms, or was identified on
            other numbers; FOREIGN_CALIBRATION, it is another robot's, or nobody said which robot this is.
    """
    description = from_urdf(Path(settings.model.urdf).expanduser()) if settings.model.urdf else nominal()
    found = calibration(settings)
    return description if found is None else found.body(description)


def calibration(settings: Settings) -> Calibration | None:
    """Return what was measured on the robot that section [robot] names; None where section [model] names no file.

    Args:
        settings: All of them.

    Raises:
        ConfigError: As for `configured`.
    """
    model, link = settings.model, settings.link
    if not model.calibration:
        return None
    identity = RobotIdentity(serial=link.serial, model=link.model) if link.serial else None
    found = load(Path(model.calibration).expanduser(), identity)
    if not found.arms and not found.dynamics:
        raise failure(
            Code.BAD_CONFIG,
            f"{found.path}: has no section `arms` or `dynamics`: nothing in it corrects the model",
            field="model.calibration",
            value=model.calibration,
            hint="write it with `ta2 identify ... --out FILE`, or leave model.calibration empty",
        )
    return found
