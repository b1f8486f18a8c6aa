"""The data file: complete, a tree, and the two arms mirror images where the robot is."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import pytest

from gateway.kinematics.description import DATA_FILE, ROOT, Kind, arm_joint, ee_frame, nominal, shoulder_joint
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import shoulder_frame
from gateway.values import Side

ROOT_FOLDER = Path(__file__).parents[2]


def test_every_joint_hangs_on_the_base_or_on_the_child_of_one_before_it():
    """A tree with its root at `base_link`, parents first: whoever builds a model needs one pass."""
    known = {ROOT}
    for name, joint in nominal().joints.items():
        assert joint.name == name
        assert joint.parent in known
        assert joint.child not in known
        known.add(joint.child)


def test_a_moving_joint_has_a_unit_axis_and_a_range_and_a_fixed_one_neither():
    """A joint with a wrong axis would turn by another angle than it says."""
    for joint in nominal().joints.values():
        assert math.hypot(*joint.axis) == (0.0 if joint.kind is Kind.FIXED else 1.0)
        assert (joint.lower < joint.upper < math.inf) == (joint.kind in (Kind.REVOLUTE, Kind.PRISMATIC))


@pytest.mark.parametrize("side", list(Side))
def test_the_robots_own_limits_lie_around_the_descriptions_ranges(side):
    """The description is narrower on joints 1 and 2 and the same elsewhere (manual §4.13)."""
    for number, joint in enumerate(nominal().arm(side)):
        low, high = JOINT_LOWER_RAD[side][number], JOINT_UPPER_RAD[side][number]
        assert low <= joint.lower < joint.upper <= high
        assert number < 2 or (low, high) == (joint.lower, joint.upper)


@pytest.mark.parametrize("side", list(Side))
def test_an_arm_is_found_by_its_frames(side):
    """Shoulder and end-effector frame exist, and all seven joints lie between body and end effector."""
    description = nominal()
    above = [joint.name for joint in description.above(ee_frame(side))]
    assert above[2:] == [*(arm_joint(side, number) for number in range(1, 8)), f"{side}_ee_joint"]
    assert description.joints[shoulder_joint(side)].child == shoulder_frame(side)


def test_every_link_that_moves_has_a_mass_and_every_mass_a_link():
    """A physics model from these numbers has no link without mass; the whole robot weighs about 85 kg."""
    description = nominal()
    moved = {joint.child for joint in description.joints.values() if joint.kind is not Kind.FIXED}
    assert moved | {ROOT, "body_link"} == set(description.inertias)
    assert sum(inertia.mass_kg for inertia in description.inertias.values()) == pytest.approx(85.2, abs=1.0)
    for inertia in description.inertias.values():
        ixx, _, _, iyy, _, izz = inertia.inertia_kgm2
        assert ixx + iyy > izz and iyy + izz > ixx and izz + ixx > iyy


def test_each_camera_has_two_eyes_apart():
    """Head and wrists."""
    description = nominal()
    assert set(description.cameras) == {"head", "left_wrist", "right_wrist"}
    for camera in description.cameras.values():
        assert 0.04 < camera.baseline_m < 0.08


def test_the_data_file_is_read_from_beside_its_module_wherever_the_process_runs(tmp_path):
    """An installed package has no checkout around it; nothing of pinocchio is needed to read the numbers."""
    read = "from gateway.kinematics.description import nominal; count = len(nominal().joints)"
    code = f"import sys; {read}; print(count, 'pinocchio' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env={"PYTHONPATH": str(ROOT_FOLDER)}, capture_output=True, text=True
    )
    assert done.stdout.split() == [str(len(nominal().joints)), "False"], done.stderr
    assert DATA_FILE.parent.name == "kinematics"
