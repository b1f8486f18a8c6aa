"""Tests of the nominal frames: the manual's printed matrices, the mounts of the description, directions that make sense."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.kinematics.description import nominal
from gateway.kinematics.frames import DEVICE_EDGES, NOMINAL_EDGES, FrameTree, Origin
from gateway.kinematics.nominal_frames import REPLACEABLE, nominal_edges, rotation_of_rpy
from gateway.values import Side
from tests.kinematics.arms import WITNESSES, joints_at

PRINTED_MM = {
    "virtual_base_T_head_camera_center": [
        [0, -0.4384, 0.8988, 0],
        [-1, 0, 0, 0],
        [0, -0.8988, -0.4384, 0],
        [0, 0, 0, 1],
    ],
    "virtual_base_T_left_base_virtual": [[1, 0, 0, -105.61], [0, 1, 0, 220.00], [0, 0, 1, -193.11], [0, 0, 0, 1]],
    "virtual_base_T_right_base_virtual": [[1, 0, 0, -105.61], [0, 1, 0, -220.00], [0, 0, 1, -193.11], [0, 0, 0, 1]],
}
"""A.3, as the manual prints it."""

EDGES = {edge.transform.name: edge for edge in nominal_edges(nominal())}


@pytest.mark.parametrize("name", NOMINAL_EDGES)
def test_the_nominal_transforms_are_those_the_manual_prints(name):
    """A.3, to its last digit, with its millimetres as metres."""
    printed = np.array(PRINTED_MM[name], dtype=float)
    matrix = EDGES[name].transform.matrix
    np.testing.assert_allclose(matrix[:3, :3], printed[:3, :3], atol=5e-5)
    np.testing.assert_allclose(matrix[:3, 3], printed[:3, 3] / 1e3, atol=5e-6)
    assert EDGES[name].origin is Origin.MECHANICAL_DESIGN and not EDGES[name].is_stand_in


def test_the_description_and_the_manual_agree_to_a_millimetre():
    """The published description puts mounts and head where A.3 has them; what is left is told in the notes."""
    joints = nominal().joints
    for side in Side:
        name = f"virtual_base_T_{side}_base_virtual"
        off = np.abs(EDGES[name].transform.p_m - joints[f"{side}_shoulder_base_joint"].xyz_m)
        assert 0.0005 < off.max() < 0.0006, "0.56 mm in height"
        assert "0.56 mm" in EDGES[f"{side}_base_virtual_T_{side}_shoulder_base"].note
    eye = rotation_of_rpy(joints["eye_joint"].rpy_rad)
    base = rotation_of_rpy(joints["virtual_base_joint"].rpy_rad)
    np.testing.assert_allclose(base.T @ eye, EDGES[NOMINAL_EDGES[0]].transform.rotation, atol=1e-12)


def test_calibrated_transforms_have_stand_ins_that_say_so():
    """Each of A.4 has one, from the design, with a note; and so has the other eye of each wrist (§5.5)."""
    assert set(DEVICE_EDGES) < set(REPLACEABLE) < set(EDGES)
    for name in REPLACEABLE:
        assert not EDGES[name].is_of_one_robot and "stand-in" in EDGES[name].note
        assert EDGES[name].is_stand_in is (name in DEVICE_EDGES)


def test_eyes_stand_in_pairs_about_their_mounts():
    """The head's are 65 mm apart about virtual_base, left one on the left; a wrist's 50 mm."""
    tree = FrameTree(EDGES.values(), WITNESSES)
    left, right = (tree.locate("virtual_base", f"head_{side}_camera").transform.p_m for side in Side)
    np.testing.assert_allclose(left, (0, 0.0325, 0), atol=1e-12)
    np.testing.assert_allclose(right, (0, -0.0325, 0), atol=1e-12)
    for side in Side:
        between = tree.locate(f"{side}_wrist_camera", f"{side}_wrist_right_camera").transform
        np.testing.assert_allclose(between.p_m, (0.05, 0, 0), atol=1e-12)


@pytest.mark.parametrize("side", Side)
def test_a_wrist_camera_sits_where_the_description_mounts_it_and_looks_along_the_hand(side):
    """The middle of the pair is at the mount, 54 mm off the hand's axis; it looks 20° inwards, to the finger tips."""
    camera = nominal().cameras[f"{side}_wrist"]
    (joint,) = [joint for joint in nominal().joints.values() if joint.child == f"{side}_ee"]
    ee_R_hand = rotation_of_rpy(joint.rpy_rad).T
    left_eye = EDGES[f"{side}_ee_T_{side}_wrist_camera"].transform
    middle = left_eye.p_m + left_eye.rotation @ (0.025, 0.0, 0.0)
    np.testing.assert_allclose(middle, ee_R_hand @ (np.array(camera.xyz_m) - joint.xyz_m), atol=1e-12)
    ahead = ee_R_hand.T @ left_eye.rotation @ (0, 0, 1)
    np.testing.assert_allclose(ahead, (math.cos(math.radians(20)), math.sin(math.radians(20)), 0), atol=1e-12)
    assert np.isclose(np.linalg.norm(left_eye.rotation @ (1, 0, 0)), 1.0)


def test_the_witness_moves_the_wrist_camera_with_the_arm():
    """Turning joint 7 of the left arm turns its camera about that joint, and leaves the other's alone."""
    tree = FrameTree(EDGES.values(), WITNESSES)
    q = [0.0, 0.9, 0.0, 1.0, 0.0, 0.0, 0.0]
    before, after = (
        tree.locate("virtual_base", "left_wrist_camera", {Side.LEFT: joints_at([*q[:6], q7])}).transform
        for q7 in (0.0, 0.4)
    )
    assert before.angle_to_rad(after) == pytest.approx(0.4, abs=1e-9)
    assert before.distance_to_m(after) > 0.02
