"""Section `arms` of a calibration file: read by the file's conventions, one robot's, and for the numbers it was found on."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from msgspec.structs import asdict

from gateway.errors import Code, ConfigError
from gateway.kinematics.calibration import load, read
from gateway.kinematics.calibration_file.arm_section import (
    MOST_OFFSET_RAD,
    ArmCalibration,
    arm_of,
    fingerprint,
    with_arms,
)
from gateway.kinematics.calibration_file.conventions import MANUAL
from gateway.kinematics.correction import ArmCorrection, corrected
from gateway.kinematics.description import nominal
from gateway.kinematics.frames import ee_frame
from gateway.kinematics.placement import Placement, rows_from_rpy
from gateway.kinematics.sight import Sight
from gateway.kinematics.solving.chain import ArmChain
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side
from tests.changed import replace
from tests.kinematics.arms import joints_at
from tests.kinematics.bodies import difference, nudged
from tests.kinematics.calibrations import OTHER_ROBOT, ROBOT, document, written

CORRECTION = ArmCorrection(
    offsets_rad=(0.004, -0.007, 0.011, -0.003, 0.009, -0.006, 0.015),
    ee=Placement((0.0015, -0.0025, 0.004), rows_from_rpy((0.006, -0.009, 0.0))),
    shoulder=Placement((0.001, 0.0, -0.002), rows_from_rpy((0.002, 0.0, 0.003))),
)


def entry(side=Side.LEFT, correction=CORRECTION):
    """Return what is written of an arm."""
    return ArmCalibration(
        side=side,
        correction=correction,
        description=nominal().source,
        numbers=fingerprint(nominal(), side),
        note="for tests",
    )


def file_with(row, **conventions):
    """Return a whole file with one arm."""
    return {"robot": asdict(ROBOT), "conventions": {**asdict(MANUAL), **conventions}, "arms": {"left": row}}


@pytest.mark.parametrize(
    "changes",
    [{}, {"translation_unit": "m", "angle_unit": "deg", "quaternion_order": "wxyz"}, {"translation_unit": "cm"}],
)
def test_what_is_written_is_read_again(tmp_path, changes):
    """In whatever conventions the file has: the same correction, to rounding."""
    conventions = replace(MANUAL, **changes)
    found = load(written(tmp_path, file_with(entry().row(conventions), **changes)), ROBOT).arms[Side.LEFT]
    np.testing.assert_allclose(found.correction.offsets_rad, CORRECTION.offsets_rad, atol=1e-15)
    assert max(difference(found.correction.ee, CORRECTION.ee)) < 1e-12
    assert max(difference(found.correction.shoulder, CORRECTION.shoulder)) < 1e-12
    assert found.note == "for tests" and found.numbers == fingerprint(nominal(), Side.LEFT)


def test_the_numbers_are_in_the_units_that_the_file_names():
    """Degrees and metres where it says so; frames that are not displaced are left out."""
    row = entry().row(replace(MANUAL, angle_unit="deg", translation_unit="m"))
    assert row["joint_zero_offsets"][6] == pytest.approx(0.8594, abs=1e-4)
    assert row["nominal_ee_T_ee"]["translation"] == pytest.approx([0.0015, -0.0025, 0.004])
    plain = entry(correction=ArmCorrection(offsets_rad=(0.001,) * 7)).row(MANUAL)
    assert not [key for key in plain if "_T_" in key]


def test_it_belongs_to_one_robot(tmp_path):
    """Refused on another one, and without a robot's name even for looking (A.4)."""
    content = file_with(entry().row(MANUAL))
    with pytest.raises(ConfigError) as caught:
        load(written(tmp_path, content), OTHER_ROBOT)
    assert caught.value.code is Code.FOREIGN_CALIBRATION
    del content["robot"]
    with pytest.raises(ConfigError, match="section 'robot'"):
        read(written(tmp_path, content))


def test_it_moves_the_frames_of_that_arm(tmp_path):
    """`Sight` of a calibrated robot: the hand is where the corrected arm has it; the other arm is as described."""
    content = {**document(), "arms": {"left": entry().row(MANUAL)}}
    sight, plain = Sight.of(load(written(tmp_path, content), ROBOT)), Sight.of()
    joints = {side: joints_at(HOME_Q_RAD[side]) for side in Side}
    placed = {
        side: [one.tree.locate(f"{side}_shoulder_base", ee_frame(side), joints).transform for one in (sight, plain)]
        for side in Side
    }
    wanted = ArmChain(corrected(nominal(), Side.LEFT, CORRECTION), Side.LEFT).forward(HOME_Q_RAD[Side.LEFT])
    np.testing.assert_allclose(placed[Side.LEFT][0].p_m, wanted.p_m, atol=1e-12)
    assert placed[Side.LEFT][0].distance_to_m(placed[Side.LEFT][1]) > 1e-3
    assert placed[Side.RIGHT][0].distance_to_m(placed[Side.RIGHT][1]) == 0.0


def test_on_other_numbers_it_means_nothing(tmp_path):
    """A URDF that differs in a millimetre is another body: refused, with both named; the same numbers elsewhere are not."""
    found = load(written(tmp_path, file_with(entry().row(MANUAL))), ROBOT)
    with pytest.raises(ConfigError, match="identified on other numbers") as caught:
        found.body(nudged(Side.LEFT, 4, xyz_m=(0.0, 0.0, 0.001)))
    assert caught.value.code is Code.BAD_CONFIG and "ta2 identify" in caught.value.hint
    elsewhere = replace(nominal(), source="the same, from another file")
    assert with_arms(elsewhere, found.arms).joints == found.body(nominal()).joints
    assert found.body(nudged(Side.RIGHT, 4, xyz_m=(0.0, 0.0, 0.001))), "the other arm does not matter"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"joint_zero_offsets": [0.0] * 6}, "7"),
        ({"joint_zero_offsets": [0.0] * 6 + [float("inf")]}, "not finite"),
        ({"joint_zero_offsets": [0.0] * 6 + [4.0]}, f"up to {MOST_OFFSET_RAD:g} rad is allowed: is rad its unit"),
        ({"joint_zero_offsets": None}, "are not numbers"),
        ({"nominal_ee_T_ee": {"translation": [0, 0, 150.0], "quaternion": [0, 0, 0, 1]}}, "is mm its unit"),
        ({"nominal_ee_T_ee": {"translation": [0, 0, 1.0], "quaternion": [0, 0, 0, 2]}}, "norm 2"),
        ({"nominal_ee_T_ee": {"translation": [0, 0, 1.0]}}, "translation and quaternion"),
        ({"source": "mechanical_design"}, "joint_identification"),
        ({"device_specific": False}, "one robot"),
        ({"numbers": None}, "numbers"),
        ({"note": 3}, "note"),
        ({"offsets": [0.0] * 7}, "is not known"),
    ],
)
def test_what_cannot_be_meant_is_refused(tmp_path, change, said):
    """With the arm, the value and the bound."""
    row = {**copy.deepcopy(entry().row(MANUAL)), **change}
    path = written(tmp_path, file_with(row))
    with pytest.raises(ConfigError) as caught:
        read(path)
    assert caught.value.code is Code.BAD_CONFIG and "arms.left" in str(caught.value) and said in str(caught.value)


def test_there_are_two_arms():
    """And no third."""
    with pytest.raises(ValueError, match="left, right"):
        arm_of("middle", {}, MANUAL)


def test_fingerprints_tell_numbers_apart():
    """Sides differ, a nudge shows, rounding does not."""
    ours = {fingerprint(nominal(), side) for side in Side}
    assert len(ours) == 2
    assert fingerprint(nudged(Side.LEFT, 2, xyz_m=(1e-6, 0.0, 0.0)), Side.LEFT) not in ours
    assert fingerprint(nudged(Side.LEFT, 2, xyz_m=(1e-12, 0.0, 0.0)), Side.LEFT) in ours
