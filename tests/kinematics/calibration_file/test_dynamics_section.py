"""Section `dynamics` of a calibration file: read as it is written, one robot's, and for the numbers it was found on."""

from __future__ import annotations

import json

import pytest
from msgspec.structs import asdict

from gateway.errors import Code, ConfigError
from gateway.kinematics.calibration import load, read
from gateway.kinematics.calibration_file.arm_section import fingerprint
from gateway.kinematics.calibration_file.conventions import MANUAL
from gateway.kinematics.calibration_file.dynamics_section import DynamicsCalibration, dynamics_of
from gateway.kinematics.configured import calibration, configured
from gateway.kinematics.description import nominal
from gateway.kinematics.dynamics.loading import load_dynamics
from gateway.kinematics.dynamics.parameters import DriveParameters
from gateway.settings.settings import LinkSettings, ModelSettings, Settings
from gateway.values import Side, ValueRefused
from tests.changed import replace
from tests.kinematics.calibrations import OTHER_ROBOT, ROBOT

DRIVES = DriveParameters(
    source="robot.json",
    scale=(1.05,) * 7,
    coulomb_nm=(0.4,) * 7,
    viscous_nmsprad=(0.2,) * 7,
    armature_kgm2=(0.03,) * 7,
    friction_sd_nm=(0.1,) * 7,
    unsure_part=0.0,
    heavier=((0.1, 0.01, 0.0, -0.02),) * 7,
)
FOUND = DynamicsCalibration(
    side=Side.LEFT,
    drives=DRIVES,
    description=nominal().source,
    numbers=fingerprint(nominal(), Side.LEFT),
    note="2.1 % left",
)


def written(folder, found=FOUND, robot=ROBOT):
    """Write a file with nothing else in it."""
    path = folder / "robot.json"
    document = {"conventions": asdict(MANUAL), "dynamics": {found.side.value: found.row()}}
    document |= {} if robot is None else {"robot": asdict(robot)}
    path.write_text(json.dumps(document))
    return path


def settings(path, serial=ROBOT.serial):
    """Settings that name a file, of a robot."""
    return Settings(
        link=LinkSettings(serial=serial, model=ROBOT.model), model=ModelSettings(calibration=str(path), dynamics=True)
    )


def test_a_section_is_read_as_it_was_written(tmp_path):
    """All numbers, and the file as what an estimate stands on."""
    path = written(tmp_path)
    assert load(path, ROBOT).dynamics[Side.LEFT] == replace(FOUND, drives=replace(DRIVES, source=str(path)))
    assert calibration(settings(path)).dynamics and configured(settings(path)) is not None
    assert dynamics_of("left", {k: v for k, v in FOUND.row().items() if k != "note"}, "x").note == ""


def test_dynamics_are_of_one_robot(tmp_path):
    """Nobody else's, and of somebody."""
    with pytest.raises(ConfigError) as caught:
        load(written(tmp_path), OTHER_ROBOT)
    assert caught.value.code is Code.FOREIGN_CALIBRATION
    with pytest.raises(ConfigError) as caught:
        read(written(tmp_path, robot=None))
    assert "section 'robot'" in str(caught.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"extra": 1}, "other keys"),
        ({"source": "guess"}, "not as `ta2 identify --dynamics` writes it"),
        ({"device_specific": False}, "for one robot"),
        ({"note": 3}, "not as"),
        ({"scale": [1.0] * 6}, "7"),
        ({"scale": [1.0] * 6 + [0.1]}, "in what unit"),
        ({"scale": [float("nan")] * 7}, "dynamics.left"),
        ({"coulomb_nm": [-1.0] * 7}, "no drive has"),
        ({"heavier": [[0.0] * 3] * 7}, "dynamics.left"),
    ],
)
def test_what_cannot_be_meant_is_refused(change, words):
    """With the arm that it is about."""
    with pytest.raises(ValueRefused, match=r"dynamics\.left") as caught:
        dynamics_of("left", {**FOUND.row(), **change}, "robot.json")
    assert words in str(caught.value)


def test_another_arm_and_a_missing_key_are_refused():
    """There are two arms, and nothing is assumed."""
    with pytest.raises(ValueRefused, match="middle"):
        dynamics_of("middle", FOUND.row(), "robot.json")
    with pytest.raises(ValueRefused, match="other keys"):
        dynamics_of("left", {"source": "motion_identification"}, "robot.json")


def test_the_observer_stands_on_what_was_identified(tmp_path):
    """For the arm that was; and only on the numbers that it was identified on."""
    pytest.importorskip("pinocchio", reason="pinocchio is not installed: pip install 'teleavatar-gateway[body]'")
    path = written(tmp_path)
    arms = load_dynamics(settings(path))
    assert arms[Side.LEFT].drives == replace(DRIVES, source=str(path))
    assert arms[Side.RIGHT].drives.source == "nominal"
    with pytest.raises(ConfigError) as caught:
        load_dynamics(settings(written(tmp_path, replace(FOUND, numbers="another body"))))
    assert caught.value.code is Code.BAD_CONFIG and "ta2 identify --dynamics" in caught.value.hint
