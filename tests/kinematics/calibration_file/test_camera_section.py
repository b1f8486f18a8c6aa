"""Tests of a camera's section: intrinsics at their size, R | T as said, turns that level, and refusals with the reason."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.kinematics.calibration_file.camera_section import camera_of
from gateway.kinematics.calibration_file.conventions import MANUAL
from gateway.kinematics.cameras.eyes import EYES
from gateway.kinematics.cameras.lens import Fisheye, Pinhole
from gateway.kinematics.transform import Points
from gateway.values import ValueRefused
from tests.changed import replace
from tests.kinematics.calibrations import LEVEL, PAIR, camera, wrist_camera
from tests.kinematics.lenses import EXAMPLE_K

PLAIN = {key: value for key, value in camera().items() if not key.startswith("RRaw")}


def test_a_fisheye_pair_is_read():
    """KL, DL at 1920 × 1920, R | T in mm; the view of the stream is half of it (§5.2, §5.5)."""
    found = camera_of("head", camera(), MANUAL)
    assert isinstance(found.pair.left, Fisheye) and found.pair.left.k == EXAMPLE_K
    assert found.pair.left.intrinsics.fx_px == 957.752 and found.pair.right.intrinsics.cy_px == 955.4
    assert found.view_pair.left.intrinsics.size_px == (960, 960)
    np.testing.assert_allclose(found.view_pair.left.intrinsics.fx_px, PAIR.left.intrinsics.fx_px)
    np.testing.assert_allclose(found.pair.right_T_left.matrix, PAIR.right_T_left.matrix, atol=1e-12)
    assert found.edge.transform.name == "head_left_camera_T_head_right_camera" and found.edge.is_of_one_robot


def test_the_files_own_turns_are_used():
    """RRawL_Row and RRawR_Row level the views; without them our own turns do, to the same picture here."""
    for section in (camera(), PLAIN):
        found = camera_of("head", section, MANUAL).rectification(math.radians(90))
        np.testing.assert_allclose(found.level_R_left, LEVEL.level_R_left, atol=1e-12)
        np.testing.assert_allclose(found.level_R_right, LEVEL.level_R_right, atol=1e-12)
        assert found.pinhole.intrinsics.size_px == (960, 960)
    assert camera_of("head", PLAIN, MANUAL).levels is None


def test_both_views_of_the_composite_are_levelled():
    """A dot that a thing 0.7 m away makes in both raw views is in one row of both levelled ones, f b / z apart (§5.2)."""
    found = camera_of("head", camera(), MANUAL)
    tables = found.level_tables(math.radians(80))
    pair, rectification = found.view_pair, found.rectification(math.radians(80))
    thing = np.array([0.12, -0.08, 0.7])
    in_eyes = {"head_left_eye": thing, "head_right_eye": (pair.right_T_left @ Points("head_left_camera", thing)).xyz_m}
    composite = np.zeros((2720, 1280, 3), np.uint8)
    at = {}
    for view, lens in zip(tables, (pair.left, pair.right), strict=True):
        x0, y0, x1, y1 = EYES[view].box_px
        rows, columns = np.indices((y1 - y0, x1 - x0))
        u, v = lens.project(in_eyes[view]).px
        dot = 255 * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / 18)
        composite[y0:y1, x0:x1] = dot[..., None]
        levelled = tables[view].apply(composite[y0:y1, x0:x1])[..., 0].astype(float)
        at[view] = np.array([(columns * levelled).sum(), (rows * levelled).sum()]) / levelled.sum()
    apart = at["head_left_eye"] - at["head_right_eye"]
    assert abs(apart[1]) < 0.1, "one row"
    depth = (rectification.level_R_left @ thing)[2]
    assert rectification.depth_m(apart[0]) == pytest.approx(depth, rel=0.003)


def test_r_and_t_of_the_other_direction_are_the_same_pair():
    """A file that gives the right eye in the left one's frame says left_T_right, and gets the same eyes."""
    inverse = PAIR.right_T_left.inverse
    section = {**PLAIN, "R": inverse.rotation.tolist(), "T": (1e3 * inverse.p_m).tolist()}
    other = replace(MANUAL, stereo_extrinsics="left_T_right")
    found = camera_of("head", section, other)
    np.testing.assert_allclose(found.pair.right_T_left.matrix, PAIR.right_T_left.matrix, atol=1e-12)
    with pytest.raises(ValueRefused, match=r"cameras\.head: the right eye.*given the other way"):
        camera_of("head", section, MANUAL)
    silent = replace(MANUAL, stereo_extrinsics="")
    with pytest.raises(ValueRefused, match="stereo_extrinsics is missing"):
        camera_of("head", section, silent)


def test_a_pinhole_pair_is_read():
    """A wrist's pair: frames of the left and the right eye, pictures of 640 × 400."""
    found = camera_of("left_wrist", wrist_camera(), MANUAL)
    assert isinstance(found.pair.left, Pinhole)
    assert found.view_pair.right.intrinsics.size_px == (640, 400)
    assert found.edge.transform.name == "left_wrist_camera_T_left_wrist_right_camera"


@pytest.mark.parametrize("key", ["model", "width", "height", "KL", "KR", "R", "T"])
def test_what_a_section_needs(key):
    """Each is missed by name."""
    with pytest.raises(ValueRefused, match=f"cameras.head: {key} is missing"):
        camera_of("head", {k: v for k, v in camera().items() if k != key}, MANUAL)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"skew": 0.0}, "skew is not known"),
        ({"model": "plumb_bob"}, "model 'plumb_bob' is not known"),
        ({"model": "pinhole"}, "DL does not belong"),
        ({"width": 1920.0}, "whole numbers"),
        ({"height": True}, "whole numbers"),
        ({"width": 1280, "height": 800}, "KL: .*(another shape|principal point)"),
        ({"KL": [957, 957, 953]}, "numbers are needed"),
        ({"KR": [957, 957, 953, 2000]}, "KR: the principal point"),
        ({"DR": [0, 0, 0, math.nan]}, "not finite"),
        ({"R": (2 * np.eye(3)).tolist()}, "R is .* from orthonormal"),
        ({"T": [65.0, 0, 0]}, "not to its right"),
        ({"RRawL_Row": np.eye(3).tolist(), "RRawR_Row": np.eye(3).tolist()}, "from parallel and level"),
    ],
)
def test_what_cannot_be_meant_is_refused(change, match):
    """With the camera's name and the reason."""
    with pytest.raises(ValueRefused, match=f"cameras.head: .*{match}|cameras.head: {match}"):
        camera_of("head", {**camera(), **change}, MANUAL)


@pytest.mark.parametrize("key", ["DL", "DR"])
def test_a_fisheye_needs_its_distortion(key):
    """Four zeros may be said, silence may not."""
    with pytest.raises(ValueRefused, match=f"{key} is missing: k1"):
        camera_of("head", {k: v for k, v in camera().items() if k != key}, MANUAL)


@pytest.mark.parametrize("key", ["RRawL_Row", "RRawR_Row"])
def test_turns_come_together(key):
    """One eye's alone levels nothing."""
    with pytest.raises(ValueRefused, match="come together"):
        camera_of("head", {k: v for k, v in camera().items() if k != key}, MANUAL)
