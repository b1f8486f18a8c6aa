"""Writing into a robot's calibration file: only that robot's, everything else in it kept, whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from msgspec.structs import asdict

from gateway.errors import Code, GatewayError, failure
from gateway.kinematics.calibration import RobotIdentity, load, read
from gateway.kinematics.calibration_file.arm_section import ArmCalibration
from gateway.kinematics.calibration_file.conventions import MANUAL, Conventions
from gateway.kinematics.calibration_file.dynamics_section import DynamicsCalibration

__all__ = ["robot_to_write_for", "write_arms", "write_dynamics"]


def robot_to_write_for(path: Path, robot: RobotIdentity | None) -> RobotIdentity:
    """Return the robot whose calibration a file is or will be; to be asked before anything is measured.

    Args:
        path: The file, there already or not.
        robot: Which robot this is, if somebody said so.

    Raises:
        ConfigError: BAD_CONFIG, nobody said which robot this is, or the file cannot be used; FOREIGN_CALIBRATION, it is
            another robot's.
    """
    if robot is None:
        raise _refused(f"{path}: a calibration belongs to one robot, and nobody said which this is", "--serial S")
    if path.suffix != ".json":
        raise _refused(f"{path}: what was found is written as JSON", "name a .json file")
    if not path.parent.is_dir():
        raise _refused(f"{path}: there is no folder {path.parent}", "name a folder that is there")
    if path.exists():
        load(path, robot)
    return robot


def write_arms(path: Path, robot: RobotIdentity, arms: Sequence[ArmCalibration]) -> None:
    """Write arms into a file, in the conventions that it has already; arguments and errors as for `write_dynamics`."""
    _write(path, robot, "arms", lambda conventions: {arm.side.value: arm.row(conventions) for arm in arms})


def write_dynamics(path: Path, robot: RobotIdentity, arms: Sequence[DynamicsCalibration]) -> None:
    """Write arms' dynamics into a file.

    The file is read again before it takes the place of the old one: what could not be loaded is never left behind.

    Args:
        path: The file, there already or not.
        robot: Whose it is.
        arms: What was found; takes the place of what the file says of the same arms.

    Raises:
        ConfigError: BAD_CONFIG, it cannot be written.
    """
    _write(path, robot, "dynamics", lambda conventions: {arm.side.value: arm.row() for arm in arms})


def _write(path: Path, robot: RobotIdentity, section: str, rows: Callable[[Conventions], dict[str, Any]]) -> None:
    try:
        document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        document = {"robot": asdict(robot), "conventions": asdict(MANUAL), **document}
        conventions = Conventions.of(document["conventions"])
        document[section] = {**document.get(section, {}), **rows(conventions)}
        draft = path.with_name(f".{path.stem}.draft.json")
        draft.write_text(json.dumps(document, ensure_ascii=False, indent=2) + "\n", encoding="utf-8")
        try:
            read(draft)
            os.replace(draft, path)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        raise _refused(f"{path}: {error.strerror or error}", "name a place that can be written") from None


def _refused(message: str, hint: str) -> GatewayError:
    return failure(Code.BAD_CONFIG, message, hint=hint)
