"""Tests of what policies are shown: each number at its place, nothing made up, pictures as openpi resizes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from msgspec import structs

from gateway.client import connect
from gateway.client.state.reading import RobotState
from gateway.errors import Code, Stale
from gateway.policy.observing import Observer, resized, state_vector
from gateway.policy.policy_map import load_map
from gateway.robot.vector_layout import STATE_NAMES
from tests.client.robot_world import RobotWorld

VENDOR = load_map("vendor_openpi").observation


@dataclass
class Picture:
    """A frame whose views say which they are."""

    age: float = 0.01

    def __getitem__(self, name):
        return np.full((400, 640, 3), len(name), np.uint8)


@pytest.fixture
def robot():
    """A connected client of a robot in joint mode."""
    world = RobotWorld()
    with connect(transport=world.transport(), name="tester") as robot:
        yield robot


def changed(state, **parts):
    """The same state with other views of some parts."""
    return RobotState(state.age, structs.replace(state.view, **parts), 0)


def test_every_part_is_at_its_place_by_name(robot) -> None:
    """Joints, grippers, efforts, poses and chassis; what nobody publishes is zero, and named."""
    state = robot.state
    vector, unknown = state_vector(state)
    named = dict(zip(STATE_NAMES, vector, strict=True))
    assert vector.dtype == np.float32 and vector.shape == (72,) and unknown == {"kinco_velocity"}
    for side in ("left", "right"):
        arm, gripper = state.arm(side), getattr(state, f"{side}_gripper")
        for n in range(7):
            assert named[f"{side}_joint{n + 1}_position"] == np.float32(arm.q[n])
            assert named[f"{side}_joint{n + 1}_velocity"] == np.float32(arm.dq[n])
            assert named[f"{side}_joint{n + 1}_effort"] == np.float32(arm.tau[n])
        assert named[f"{side}_gripper_position"] == np.float32(gripper.q[0])
        assert named[f"{side}_gripper_effort"] == np.float32(gripper.tau[0])
        assert [named[f"{side}_ee_position_{axis}"] for axis in "xyz"] == list(np.float32(arm.pose.p))
        assert [named[f"{side}_ee_orientation_{axis}"] for axis in "xyzw"] == list(np.float32(arm.pose.quat_xyzw))
    assert [named[f"chassis_motor{n}_position"] for n in (1, 2, 3)] == list(np.float32(state.chassis.q))


def test_what_was_never_heard_is_named_and_an_arm_is_needed(robot) -> None:
    """Zeros of a gripper are told; an arm that nobody hears, or any part that has fallen silent, is an error."""
    state = robot.state
    _, unknown = state_vector(changed(state, grippers={}, chassis=None))
    assert {"left_gripper_position", "right_gripper_effort", "chassis_motor2_velocity"} < unknown and len(unknown) == 16
    view = state.view
    silent = structs.replace(view.arms["left"], measured=None)
    old = structs.replace(view.arms["right"].measured, age_ns=150_000_000)
    older = structs.replace(view.grippers["left"], age_ns=600_000_000)
    for parts, words in (
        ({"arms": {**view.arms, "left": silent}}, "left arm is inf"),
        (
            {"arms": {**view.arms, "right": structs.replace(view.arms["right"], measured=old)}},
            "right arm is 0.15 s old",
        ),
        ({"grippers": {**view.grippers, "left": older}}, "left gripper is 0.60 s old, 0.5 s is the bound"),
        (
            {"arms": {**view.arms, "left": structs.replace(view.arms["left"], pose_age_ns=700_000_000)}},
            "left arm's pose is 0.70 s",
        ),
    ):
        with pytest.raises(Stale) as caught:
            state_vector(changed(state, **parts))
        assert caught.value.code is Code.PART_STALE and words in caught.value.message


def test_an_observation_has_the_vendors_keys(robot) -> None:
    """48 dims, three views as they come, the prompt; and when the arms were there."""
    state = robot.state
    seen = Observer(VENDOR, "fold it", lambda: state, Picture, lambda: 10_000_000_000).observe()
    assert set(seen.values) == {"observation/state", "prompt", *VENDOR.images} and seen.values["prompt"] == "fold it"
    assert seen.values["observation/state"].shape == (48,) and seen.uncovered == ()
    assert seen.values["observation/images/left_color"][0, 0, 0] == len("left_wrist_right_eye")
    assert seen.observed_ns == 10_000_000_000 - round(1e9 * max(state.left_arm.age, state.right_arm.age))
    np.testing.assert_array_equal(seen.measured["right"], state.right_arm.q)


def test_dims_by_name_and_what_of_them_is_not_known(robot) -> None:
    """In the map's order; without pictures nobody asks for one."""
    layout = structs.replace(VENDOR, state=("kinco_velocity", "right_joint2_position"), images={}, prompt_key="")
    state = robot.state
    seen = Observer(layout, "", lambda: state, lambda: pytest.fail("no picture is needed")).observe()
    assert list(seen.values) == ["observation/state"] and seen.uncovered == ("kinco_velocity",)
    np.testing.assert_array_equal(seen.values["observation/state"], np.float32([0.0, state.right_arm.q[1]]))


@pytest.mark.parametrize(("picture", "words"), [(None, "none yet"), (Picture(age=0.7), "0.70 s old, 0.5 s is")])
def test_old_pictures_are_not_shown(robot, picture, words) -> None:
    """A policy that sees what was is not asked."""
    with pytest.raises(Stale, match=words):
        Observer(VENDOR, "", lambda: robot.state, lambda: picture).observe()


def test_a_picture_that_grew_old_while_the_arms_were_waited_for_is_not_shown(robot) -> None:
    """It is taken, and its age judged, once there is a state to go with it."""
    pictures = [Picture()]

    def look() -> RobotState:
        pictures[:] = [Picture(age=0.7)]
        return robot.state

    with pytest.raises(Stale, match=r"0\.70 s old"):
        Observer(VENDOR, "", look, lambda: pictures[0]).observe()


def test_pictures_are_resized_whole_with_bars_between_which_they_are_centred(robot) -> None:
    """As openpi's own: 400 x 640 becomes 140 rows of 224, 42 black ones on either side."""
    wide = resized(np.full((400, 640, 3), 200, np.uint8), 224)
    assert wide.shape == (224, 224, 3) and wide.dtype == np.uint8
    assert not wide[:42].any() and not wide[182:].any() and (wide[42:182] == 200).all()
    square = np.random.default_rng(1).integers(0, 255, (224, 224, 3), np.uint8)
    np.testing.assert_array_equal(resized(square, 224), square)
    state = robot.state
    seen = Observer(structs.replace(VENDOR, resize=32), "", lambda: state, Picture).observe()
    assert seen.values["observation/images/head_camera"].shape == (32, 32, 3)
