"""Tests of the frame tree: the manual's chains (A.5), stamps of joints, stand-ins, trees that are none."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.errors import Code, Rejected, Stale
from gateway.kinematics.description import nominal
from gateway.kinematics.frames import ROOT, FixedEdge, FrameTree, Origin
from gateway.kinematics.nominal_frames import calibrated, nominal_edges
from gateway.kinematics.transform import Transform
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import Side, ValueRefused
from tests.kinematics.arms import WITNESSES, joints_at
from tests.kinematics.test_transform import random_transform

OTHER = {Side.LEFT: "right", Side.RIGHT: "left"}


def edge(name, *, own=True, **parts):
    """Return a fixed transform, calibrated unless said otherwise."""
    return FixedEdge(transform=Transform.of(name, **parts), origin=Origin.ARM_CAMERA_CALIBRATION, is_of_one_robot=own)


@pytest.fixture(scope="module")
def tree():
    """A robot with calibrations of its own for everything that A.4 names."""
    rng = np.random.default_rng(7)
    names = [
        "head_camera_center_T_head_left_camera",
        "head_camera_center_T_head_right_camera",
        "left_ee_T_left_wrist_camera",
        "right_ee_T_right_wrist_camera",
    ]
    own = [
        FixedEdge(transform=random_transform(rng, name), origin=Origin.STEREO_CALIBRATION, is_of_one_robot=True)
        for name in names
    ]
    return FrameTree(calibrated(nominal_edges(nominal()), own), WITNESSES)


def random_joints(rng, stamp_ns=0):
    """Return joints of both arms inside the limits, stamped one nanosecond apart."""
    return {
        side: joints_at(rng.uniform(JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side]), stamp_ns + n)
        for n, side in enumerate(Side)
    }


@pytest.mark.parametrize("side", Side)
def test_the_chains_of_the_manual(tree, side):
    """The three chains that A.5 writes out, left and right, multiplied as it says."""
    joints = random_joints(np.random.default_rng(8), stamp_ns=1000)

    def fixed(frame):
        return tree.edge(frame).transform

    base, head, ee, wrist = f"{side}_base_virtual", f"head_{side}_camera", f"{side}_ee", f"{side}_wrist_camera"
    center = fixed("head_camera_center")
    placed = WITNESSES[side].forward(joints[side].q_rad)
    reach = Transform.of(f"{base}_T_{ee}", p_m=placed.p_m, rotation=placed.rows)

    found = tree.locate(ROOT, head)
    np.testing.assert_allclose(found.transform.matrix, (center @ fixed(head)).matrix, atol=1e-12)
    found = tree.locate(base, head)
    np.testing.assert_allclose(found.transform.matrix, (fixed(base).inverse @ center @ fixed(head)).matrix, atol=1e-12)
    assert found.stamps_ns == {} and found.stamp_ns is None
    found = tree.locate(ROOT, wrist, joints)
    np.testing.assert_allclose(found.transform.matrix, (fixed(base) @ reach @ fixed(wrist)).matrix, atol=1e-12)
    assert found.transform.name == f"{ROOT}_T_{wrist}"
    assert found.edges == (f"{ROOT}_T_{base}", f"{base}_T_{ee}", f"{ee}_T_{wrist}")
    assert found.stamps_ns == {side: joints[side].stamp_ns} and found.stamp_ns == joints[side].stamp_ns
    assert found.stand_ins == ()


def test_every_pair_of_frames_agrees_with_every_way_around(tree):
    """a_T_b is the inverse of b_T_a, and a_T_c = a_T_b @ b_T_c for any third frame."""
    rng = np.random.default_rng(9)
    joints = random_joints(rng)
    frames = tree.frames
    for _ in range(200):
        a, b, c = rng.choice(frames, size=3)
        a_T_b, b_T_c = (tree.locate(*pair, joints).transform for pair in ((a, b), (b, c)))
        np.testing.assert_allclose((a_T_b @ b_T_c).matrix, tree.locate(a, c, joints).transform.matrix, atol=1e-12)
        np.testing.assert_allclose(a_T_b.inverse.matrix, tree.locate(b, a, joints).transform.matrix, atol=1e-12)


def test_a_chain_through_both_arms_has_both_stamps(tree):
    """From hand to hand the older joints date the result; which arms are needed can be asked before."""
    joints = {side: joints_at(HOME_Q_RAD[side], stamp) for side, stamp in zip(Side, (900, 700), strict=True)}
    found = tree.locate("left_wrist_camera", "right_ee", joints)
    assert found.stamps_ns == {Side.LEFT: 900, Side.RIGHT: 700} and found.stamp_ns == 700
    assert tree.sides_between("left_wrist_camera", "right_ee") == (Side.LEFT, Side.RIGHT)
    assert tree.sides_between("left_wrist_camera", "left_ee") == ()
    assert tree.sides_between("left_ee", "head_left_camera") == (Side.LEFT,)
    assert tree.locate("left_wrist_camera", "left_ee").stamps_ns == {}, "fixed on one hand, whatever its joints do"


def test_a_frame_in_itself_is_at_rest(tree):
    """No joints, no edges."""
    found = tree.locate("left_ee", "left_ee")
    np.testing.assert_array_equal(found.transform.matrix, np.eye(4))
    assert found.edges == () and found.transform.name == "left_ee_T_left_ee"


def test_poses_of_the_arm_are_those_in_its_shoulder_frame(tree):
    """`*_shoulder_base_T_*_ee` is what the robot reports as current_ee_pose (§4.0.1): forward kinematics and no more."""
    joints = random_joints(np.random.default_rng(10))
    for side in Side:
        placed = WITNESSES[side].forward(joints[side].q_rad)
        found = tree.locate(f"{side}_shoulder_base", f"{side}_ee", joints).transform
        np.testing.assert_allclose(found.p_m, placed.p_m, atol=1e-12)
        np.testing.assert_allclose(found.rotation, placed.rows, atol=1e-12)


@pytest.mark.parametrize("side", Side)
def test_missing_joints_are_told_and_never_made_up(tree, side):
    """PART_STALE names the arm; joints of the other one are no help."""
    other = Side(OTHER[side])
    for joints in (None, {other: joints_at(HOME_Q_RAD[other])}):
        with pytest.raises(Stale, match=f"{side} arm") as caught:
            tree.locate(ROOT, f"{side}_wrist_camera", joints)
        assert caught.value.code is Code.PART_STALE


@pytest.mark.parametrize("pair", [("virtual_base", "camera"), ("base_link", "left_ee")])
def test_an_unknown_frame_lists_those_there_are(tree, pair):
    """WRONG_FRAME, with the names in the hint."""
    with pytest.raises(Rejected) as caught:
        tree.locate(*pair)
    assert caught.value.code is Code.WRONG_FRAME
    assert "left_wrist_camera" in caught.value.hint and "virtual_base" in caught.value.hint


def test_what_is_not_of_this_robot_is_told_on_every_way_through_it():
    """Nominal numbers may stand where A.4 wants a calibration, but each result names them."""
    own = edge("left_ee_T_left_wrist_camera", p_m=(0.1, 0.0, 0.0))
    mixed = FrameTree(calibrated(nominal_edges(nominal()), [own]), WITNESSES)
    joints = random_joints(np.random.default_rng(11))
    assert mixed.locate(ROOT, "left_wrist_camera", joints).stand_ins == ()
    found = mixed.locate("left_wrist_camera", "head_left_camera", joints)
    assert found.stand_ins == ("head_camera_center_T_head_left_camera",)
    assert mixed.locate(ROOT, "left_ee", joints).stand_ins == (), "A.3 is nominal on every robot: no stand-in"
    assert mixed.edge("left_ee") is None and mixed.edge(ROOT) is None
    assert mixed.parent("left_ee") == "left_base_virtual" and mixed.parent(ROOT) is None


def test_the_tree_is_that_of_the_manual(tree):
    """A.2, and beside it three frames of ours: the shoulder's and the wrist pairs' other eyes."""
    drawn = {frame: set(tree.children(frame)) for frame in tree.frames if tree.children(frame)}
    expected = {
        "virtual_base": {"head_camera_center", "left_base_virtual", "right_base_virtual"},
        "head_camera_center": {"head_left_camera", "head_right_camera"},
    }
    for side in Side:
        expected[f"{side}_base_virtual"] = {f"{side}_ee", f"{side}_shoulder_base"}
        expected[f"{side}_ee"] = {f"{side}_wrist_camera"}
        expected[f"{side}_wrist_camera"] = {f"{side}_wrist_right_camera"}
    assert drawn == expected
    assert len(tree.frames) == len(set(tree.frames)) == 14


@pytest.mark.parametrize(
    ("extra", "match"),
    [
        (edge("left_base_virtual_T_left_ee"), "two places"),
        (edge("virtual_base_T_left_wrist_camera"), "two places"),
        (edge("left_ee_T_virtual_base"), "two places"),
        (edge("nowhere_T_lamp"), "nothing places nowhere"),
    ],
)
def test_what_is_no_tree_is_refused(extra, match):
    """A frame has one place, and everything hangs on virtual_base; joints move the end effector, nothing fixes it (A.5)."""
    with pytest.raises(ValueRefused, match=match):
        FrameTree((*nominal_edges(nominal()), extra), WITNESSES)


def test_a_loop_and_a_missing_shoulder_are_refused():
    """Two frames that hang on each other hang on nothing; without its shoulder frame an arm's poses have no place."""
    edges = nominal_edges(nominal())
    with pytest.raises(ValueRefused, match="does not hang"):
        FrameTree((*edges, edge("one_T_two"), edge("two_T_one")), WITNESSES)
    with pytest.raises(ValueRefused, match="left_shoulder_base is missing"):
        FrameTree([e for e in edges if e.transform.child != "left_shoulder_base"], WITNESSES)
