"""Tests of the eyes: views, frames, sizes, stand-in lenses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.kinematics.cameras.eyes import CAMERAS, EYES, eyes_of, nominal_lens
from gateway.kinematics.description import nominal
from gateway.kinematics.frames import FrameTree
from gateway.kinematics.nominal_frames import nominal_edges
from tests.kinematics.arms import WITNESSES


def test_the_views_are_those_of_the_manual():
    """Six, with the sizes of §5.2, tiling the composite without overlap but for the two black bars beside the head."""
    sizes = {view: eye.size_px for view, eye in EYES.items()}
    assert sizes == {
        "head_left_eye": (960, 960),
        "head_right_eye": (960, 960),
        "left_wrist_left_eye": (640, 400),
        "left_wrist_right_eye": (640, 400),
        "right_wrist_left_eye": (640, 400),
        "right_wrist_right_eye": (640, 400),
    }
    seen = np.zeros((2720, 1280), int)
    for eye in EYES.values():
        x0, y0, x1, y1 = eye.box_px
        seen[y0:y1, x0:x1] += 1
    assert seen.max() == 1 and seen[:, 160:1120].min() == 1 and seen[1920:].min() == 1
    assert not seen[:1920, :160].any() and not seen[:1920, 1120:].any()


def test_every_eye_has_a_frame_of_its_own_and_the_right_one_is_on_the_right():
    """Six frames of the tree; x of an optical frame points right (A.2)."""
    tree = FrameTree(nominal_edges(nominal()), WITNESSES)
    assert len({eye.frame for eye in EYES.values()}) == 6
    for camera in CAMERAS:
        left, right = eyes_of(camera)
        assert left.view.endswith("left_eye") and right.view.endswith("right_eye")
        p_m = tree.locate(left.frame, right.frame).transform.p_m
        np.testing.assert_allclose(p_m, (nominal().cameras[camera].baseline_m, 0, 0), atol=1e-12)
    with pytest.raises(KeyError, match="there are head"):
        eyes_of("chest")


@pytest.mark.parametrize("camera", CAMERAS)
def test_a_stand_in_lens_sees_the_published_field_of_view(camera):
    """Its edges look half the field of view aside, and it has the size of the view."""
    description = nominal().cameras[camera]
    lens = nominal_lens(description)
    left, _ = eyes_of(camera)
    assert lens.intrinsics.size_px == left.size_px
    width, height = left.size_px
    across, down = (math.radians(angle) / 2 for angle in description.field_of_view_deg)
    x, _, z = lens.rays((width - 0.5, (height - 1) / 2))
    assert math.atan2(x, z) == pytest.approx(across)
    _, y, z = lens.rays(((width - 1) / 2, -0.5))
    assert math.atan2(-y, z) == pytest.approx(down)


def test_the_stand_in_is_near_the_one_calibration_that_is_known():
    """957.8 px at the full size, 4 % more than by the field of view."""
    assert nominal_lens(nominal().cameras["head"]).intrinsics.fx_px == pytest.approx(957.752 / 2, rel=0.05)
