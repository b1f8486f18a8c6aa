"""Tests of sight: points of any frame in any view, by the robot's own calibration or by stand-ins that say so."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.errors import Code, Rejected, Stale
from gateway.kinematics.calibration import load
from gateway.kinematics.cameras.eyes import EYES
from gateway.kinematics.description import nominal
from gateway.kinematics.sight import Sight, robot_frames
from gateway.kinematics.transform import Points
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side
from tests.changed import replace
from tests.kinematics.arms import WITNESSES, joints_at
from tests.kinematics.calibrations import ROBOT, document, written

JOINTS = {side: joints_at(HOME_Q_RAD[side], 1000 + n) for n, side in enumerate(Side)}


@pytest.fixture
def by_design():
    """A robot without a calibration."""
    return Sight(robot_frames(nominal(), WITNESSES), nominal())


@pytest.fixture
def own(tmp_path):
    """A robot with the calibration of head and left wrist."""
    calibration = load(written(tmp_path, document()), ROBOT)
    return Sight(robot_frames(nominal(), WITNESSES, calibration), nominal(), calibration)


def test_what_is_ahead_of_the_head_is_in_the_middle_of_its_views(by_design):
    """A point 1 m away on the common axis is in the middle row, moved by half the baseline to either side."""
    for view, sign in (("head_left_eye", 1), ("head_right_eye", -1)):
        seen = by_design.project(view, Points("head_camera_center", [0.0, 0.0, 1.0]))
        lens = by_design.lens(view)
        u = lens.intrinsics.cx_px + sign * lens.intrinsics.fx_px * np.arctan(0.0325)
        np.testing.assert_allclose(seen.projection.px, (u, 479.5), atol=1e-9)
        assert seen.projection.is_visible and seen.is_lens_stand_in and seen.located.stamps_ns == {}
        assert seen.located.stand_ins == (f"head_camera_center_T_head_{'left' if sign > 0 else 'right'}_camera",)


@pytest.mark.parametrize("side", Side)
def test_a_hand_sees_its_own_fingers_and_the_head_sees_the_hand_at_home(by_design, side):
    """The point between the finger tips, some 0.2 m ahead of the wrist, at the manual's initial position (§6.6)."""
    tip = Points(f"{side}_ee", [0.2, 0.0, 0.0])
    for view in (f"{side}_wrist_left_eye", f"{side}_wrist_right_eye", "head_left_eye", "head_right_eye"):
        seen = by_design.project(view, tip, JOINTS)
        assert seen.projection.is_visible, view
    head = by_design.project("head_left_eye", tip, JOINTS)
    assert head.located.stamps_ns == {side: JOINTS[side].stamp_ns}
    u = head.projection.px[0]
    assert bool(u < 480) is (side is Side.LEFT), "the left hand is on the left of the picture"


def test_directions_of_pixels_lead_back_to_the_point(own):
    """In every view, in a frame that moves: eye + distance × ray is the point that was projected."""
    rng = np.random.default_rng(1)
    for view, eye in EYES.items():
        in_eye = Points(eye.frame, rng.uniform((-0.2, -0.2, 0.4), (0.2, 0.2, 1.0), (20, 3)))
        points = own.tree.locate("left_ee", eye.frame, JOINTS).transform @ in_eye
        seen = own.project(view, points, JOINTS)
        rays, located = own.rays(view, seen.projection.px, "left_ee", JOINTS)
        distance = np.linalg.norm(in_eye.xyz_m, axis=-1, keepdims=True)
        np.testing.assert_allclose(located.transform.p_m + distance * rays, points.xyz_m, atol=1e-9)


def test_a_robots_own_lenses_are_used_and_the_others_say_so(own, by_design):
    """Head and left wrist are this robot's; the right wrist's are stand-ins."""
    assert own.lens("head_left_eye").intrinsics.fx_px == pytest.approx(957.752 / 2)
    assert own.lens("head_right_eye").intrinsics.fx_px == pytest.approx(955.1 / 2)
    point = Points("virtual_base", [0.4, 0.0, -0.3])
    stand_ins = {view: own.project(view, point, JOINTS).is_lens_stand_in for view in EYES}
    assert [view for view, is_one in stand_ins.items() if is_one] == ["right_wrist_left_eye", "right_wrist_right_eye"]
    assert own.project("head_left_eye", point).located.stand_ins == ()
    assert own.project("right_wrist_left_eye", point, JOINTS).located.stand_ins == ("right_ee_T_right_wrist_camera",)
    moved = own.project("head_left_eye", point).projection.px - by_design.project("head_left_eye", point).projection.px
    assert np.linalg.norm(moved) > 2.0, "a calibration makes a difference"


def test_a_pair_sees_depth(own):
    """The two views of the head, levelled by their calibration, give back the distance of a point."""
    point = Points("head_left_camera", [0.1, -0.05, 0.8])
    left = own.project("head_left_eye", point).projection.px
    right = own.project("head_right_eye", point).projection.px
    rays = [
        own.rays(view, px, "head_left_camera")[0] for view, px in (("head_left_eye", left), ("head_right_eye", right))
    ]
    eyes = [own.rays(f"head_{s}_eye", left, "head_left_camera")[1].transform.p_m for s in ("left", "right")]
    distances, *_ = np.linalg.lstsq(np.stack((rays[0], -rays[1]), -1), eyes[1] - eyes[0], rcond=None)
    np.testing.assert_allclose(eyes[0] + distances[0] * rays[0], point.xyz_m, atol=1e-9)


def test_the_robots_own_kinematics_agree_with_the_witness(by_design):
    """`Sight.of` takes the gateway's own model: every frame where the simulator's geometry has it."""
    own = Sight.of()
    for frame in own.tree.frames:
        mine, other = (sight.tree.locate("virtual_base", frame, JOINTS).transform for sight in (own, by_design))
        assert mine.distance_to_m(other) < 1e-9 and mine.angle_to_rad(other) < 1e-7
    turned = replace(
        nominal(), cameras={**nominal().cameras, "head": replace(nominal().cameras["head"], baseline_m=0.08)}
    )
    moved = Sight.of(description=turned).tree.locate("virtual_base", "head_left_camera").transform.p_m
    np.testing.assert_allclose(moved, (0, 0.04, 0), atol=1e-12)


def test_unknown_views_and_missing_joints_are_refused(by_design):
    """BAD_REQUEST lists the six; the composite is no eye; joints that are needed must be there."""
    for view in ("head_camera", "head_middle_eye"):
        for ask in (by_design.lens, lambda view: by_design.project(view, Points("virtual_base", np.zeros(3)))):
            with pytest.raises(Rejected) as caught:
                ask(view)
            assert caught.value.code is Code.BAD_REQUEST and "head_right_eye" in caught.value.hint
    with pytest.raises(Stale, match="left arm"):
        by_design.project("head_left_eye", Points("left_ee", np.zeros(3)))
