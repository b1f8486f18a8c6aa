"""Which body the settings name: our own, a URDF's, each with this robot's calibration or without."""

from __future__ import annotations

import pytest
from msgspec.structs import asdict

from gateway.errors import Code, ConfigError
from gateway.kinematics.calibration_file.arm_section import ArmCalibration, fingerprint
from gateway.kinematics.calibration_file.conventions import MANUAL
from gateway.kinematics.configured import configured
from gateway.kinematics.correction import ArmCorrection, corrected
from gateway.kinematics.description import nominal
from gateway.settings.settings import LinkSettings, ModelSettings, Settings
from gateway.values import Side
from tests.kinematics import calibrations, urdfs
from tests.kinematics.bodies import nudged
from tests.kinematics.calibrations import OTHER_ROBOT, ROBOT

LINK = LinkSettings(serial=ROBOT.serial, model=ROBOT.model)
CORRECTION = ArmCorrection(offsets_rad=(0.004, -0.007, 0.011, -0.003, 0.009, -0.006, 0.015))


def calibration(tmp_path, description):
    """Write what would be identified on the left arm of a description; return the file."""
    arm = ArmCalibration(
        side=Side.LEFT,
        correction=CORRECTION,
        description=description.source,
        numbers=fingerprint(description, Side.LEFT),
        note="for tests",
    )
    rows = {"robot": asdict(ROBOT), "conventions": asdict(MANUAL), "arms": {"left": arm.row(MANUAL)}}
    return calibrations.written(tmp_path, rows)


def named(link=LINK, **files):
    """Return the description of settings that name these files."""
    return configured(Settings(link=link, model=ModelSettings(**{key: str(path) for key, path in files.items()})))


def test_nothing_named_is_our_own_numbers():
    """The very same object: nothing is copied, nothing is read twice."""
    assert configured(Settings()) is nominal()


def test_a_urdf_takes_the_place_of_our_numbers(tmp_path):
    """Mapped by joint name; what it lacks is told by name."""
    other = nudged(Side.LEFT, 4, xyz_m=(0.0, 0.0, 0.01))
    found = named(urdf=urdfs.written(other, tmp_path / "other.urdf"))
    assert found.joints["armL4_joint"].xyz_m == other.joints["armL4_joint"].xyz_m
    poor = tmp_path / "poor.urdf"
    poor.write_text((tmp_path / "other.urdf").read_text().replace("armR3_joint", "shoulder_pan"))
    with pytest.raises(ConfigError, match="lacks 1 of what is needed: joint 'armR3_joint'") as refused:
        named(urdf=poor)
    assert refused.value.code is Code.BAD_CONFIG and refused.value.hint


def test_a_calibration_corrects_the_numbers_it_was_identified_on(tmp_path):
    """Ours or a URDF's; on others it means nothing."""
    assert named(calibration=calibration(tmp_path, nominal())).joints == (
        corrected(nominal(), Side.LEFT, CORRECTION).joints
    )
    path = urdfs.written(nudged(Side.LEFT, 4, xyz_m=(0.0, 0.0, 0.01)), tmp_path / "own.urdf")
    theirs = named(urdf=path)
    file = calibration(tmp_path, theirs)
    assert named(urdf=path, calibration=file).joints == corrected(theirs, Side.LEFT, CORRECTION).joints
    with pytest.raises(ConfigError, match="identified on other numbers") as refused:
        named(calibration=file)
    assert "ta2 identify" in refused.value.hint


@pytest.mark.parametrize(
    ("link", "why"),
    [
        (LinkSettings(serial=OTHER_ROBOT.serial, model=OTHER_ROBOT.model), "this robot is TA2-0043"),
        (LinkSettings(serial=ROBOT.serial, model="lite"), "this robot is TA2-0042"),
        (LinkSettings(model=ROBOT.model), "nobody said which robot this is"),
    ],
)
def test_a_calibration_is_never_used_on_another_robot(tmp_path, link, why):
    """Another serial, another model, or none at all (manual A.4, A.6)."""
    with pytest.raises(ConfigError, match=why) as refused:
        named(link, calibration=calibration(tmp_path, nominal()))
    assert refused.value.code is Code.FOREIGN_CALIBRATION and refused.value.hint


def test_a_file_that_corrects_nothing_is_not_taken_for_a_calibration_of_arms(tmp_path):
    """Cameras only: whoever names it here believes in a correction that is none."""
    with pytest.raises(ConfigError, match="no section `arms`") as refused:
        named(calibration=calibrations.written(tmp_path, calibrations.document()))
    assert refused.value.field == "model.calibration" and "ta2 identify" in refused.value.hint


def test_a_file_that_is_not_there_is_told(tmp_path):
    """With its path."""
    with pytest.raises(ConfigError, match=r"gone\.json: No such file"):
        named(calibration=tmp_path / "gone.json")
