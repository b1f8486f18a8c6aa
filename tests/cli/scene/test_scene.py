"""Tests of what is drawn: read back from a file of Rerun."""

from __future__ import annotations

import numpy as np
import pytest

from tests.cli.scene.rrd import read, rr

from gateway.cli.scene.scene import Scene
from gateway.kinematics.collision import CollisionModel
from gateway.kinematics.description import nominal
from gateway.kinematics.frames import ROOT
from gateway.kinematics.sight import robot_frames
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import shoulder_frame
from gateway.values import ArmState, Side

BODY = CollisionModel(nominal())
TREE = robot_frames(nominal(), BODY.chains)
HOME = {side: tuple(HOME_Q_RAD[side]) for side in Side}
HANDS = {side: ((0.1, 0.2, 0.3), (0.0, 0.0, 1.0, 0.0)) for side in Side}


@pytest.fixture
def drawn(tmp_path):
    """Return what a function draws, as it is read back."""

    def draw(action):
        stream = rr.RecordingStream("test")
        scene = Scene(stream, TREE, BODY)
        stream.save(tmp_path / "a.rrd")
        action(scene)
        stream.disconnect()
        return read(tmp_path / "a.rrd")

    return draw


def turned(quat_xyzw, v):
    """Return a direction turned by a unit quaternion."""
    u, w = np.array(quat_xyzw[:3]), quat_xyzw[3]
    return np.array(v) + 2.0 * np.cross(u, np.cross(u, v) + w * np.array(v))


def test_the_body_is_where_the_collision_model_has_it(drawn):
    """Each capsule begins at one end of its line and reaches to the other; its chest is midway between the shoulders."""
    found = drawn(lambda scene: scene.show(1, HOME, {}, {}))
    body = {name: values[-1] for name, values in found[f"{ROOT}/chest/body"].items()}
    segments = BODY.posture(HOME).segments
    assert len(body["lengths"]) == len(segments) == len(body["colors"]) == len(body["labels"])
    for n, (x, y, z, u, v, w, square) in enumerate(segments):
        assert body["translations"][n] == pytest.approx((x, y, z), abs=1e-6)
        assert body["lengths"][n] == pytest.approx(square**0.5, abs=1e-6)
        reach = turned(body["quaternions"][n], (0.0, 0.0, body["lengths"][n]))
        assert reach == pytest.approx((u, v, w), abs=1e-5)
    shoulders = [TREE.locate(ROOT, shoulder_frame(side)).transform.p_m for side in Side]
    (chest,) = found[f"{ROOT}/chest"]["translation"]
    assert chest[0] == pytest.approx(np.mean(shoulders, axis=0), abs=1e-6)


def test_a_capsule_that_hangs_straight_down_lies_along_it(drawn):
    """No division by nothing."""
    from gateway.cli.scene.scene import _along

    for direction in ((0.0, 0.0, -1.0), (0.0, 0.0, 2.0), (1e-12, 0.0, -1.0), (0.3, -0.4, 0.0)):
        quat = _along(*direction)
        assert np.linalg.norm(quat) == pytest.approx(1.0)
        assert turned(quat, (0.0, 0.0, np.linalg.norm(direction))) == pytest.approx(direction, abs=1e-6)
    assert np.linalg.norm(_along(0.0, 0.0, 0.0)) == 1.0


def test_hands_are_drawn_by_the_model_and_as_the_robot_says(drawn):
    """Each in its parent; joints, setpoints and positions over time."""
    found = drawn(lambda scene: scene.show(1, HOME, {Side.LEFT: HOME[Side.LEFT]}, HANDS))
    states = {side: ArmState(q_rad=HOME[side], dq_radps=(), tau_nm=(), stamp_ns=0) for side in Side}
    for side in Side:
        mount = f"{ROOT}/{side}_base_virtual"
        place = TREE.locate(f"{side}_base_virtual", f"{side}_ee", states).transform
        hand = found[f"{mount}/{side}_ee"]
        assert hand["translation"][-1][0] == pytest.approx(place.p_m, abs=1e-6)
        assert abs(np.dot(hand["quaternion"][-1][0], place.quat_xyzw)) == pytest.approx(1.0, abs=1e-6)
        assert found[f"{mount}/{side}_shoulder_base/measured"]["translation"][-1][0] == pytest.approx((0.1, 0.2, 0.3))
        assert found[f"joints/{side}/measured"]["scalars"][-1] == pytest.approx(HOME[side])
        assert found[f"hands/{side}"]["scalars"][-1] == pytest.approx((0.1, 0.2, 0.3))
    assert found["joints/left/setpoint"]["scalars"] and not found["joints/right/setpoint"]["scalars"]


def test_the_nearest_pair_is_joined_while_somebody_says_it(drawn):
    """By a line between their nearest points, whose length is their distance and both radii; then it is gone."""
    near = BODY.posture(HOME).nearest()

    def two(scene):
        scene.show(1, HOME, {}, {}, (near.second, near.first))
        scene.show(2, HOME, {}, {}, ("left_palm", "nobody"))

    found = drawn(two)
    (ends,), after = found[f"{ROOT}/chest/nearest"]["strips"]
    assert ends[0] == pytest.approx(near.first_m, abs=1e-6) and ends[1] == pytest.approx(near.second_m, abs=1e-6)
    assert not after and found["gap"]["scalars"] == [[pytest.approx(near.gap_m)]]


def test_an_arm_of_which_nothing_is_known_is_not_made_up(drawn):
    """The other one is shown, the body is not."""
    found = drawn(lambda scene: scene.show(1, {Side.LEFT: HOME[Side.LEFT]}, {}, {}))
    assert found["joints/left/measured"]["scalars"] and not found["joints/right/measured"]["scalars"]
    assert f"{ROOT}/chest/body" not in found


def test_of_an_arm_that_is_not_known_any_more_nothing_stays(drawn):
    """Rerun shows what it was told last: what was drawn is cleared once, hands are put nowhere, until they are known again."""
    near = BODY.posture(HOME).nearest()
    left = {Side.LEFT: HOME[Side.LEFT]}

    def lost(scene):
        scene.show(1, HOME, HOME, HANDS, (near.first, near.second))
        scene.show(2, left, HOME, {Side.LEFT: HANDS[Side.LEFT]})
        scene.show(3, left, HOME, {Side.LEFT: HANDS[Side.LEFT]})
        scene.show(4, HOME, HOME, HANDS)

    found = drawn(lost)
    hands = [f"{ROOT}/right_base_virtual/right_{name}" for name in ("ee", "shoulder_base/measured")]
    for path in (f"{ROOT}/chest/body", f"{ROOT}/chest/nearest", "gap", "joints/right/measured", "hands/right"):
        assert found[path]["is_recursive"] == [[False]], path
    for path in hands:
        places = found[path]["quaternion"]  # in no order of time: they are written apart
        assert len(places) == 3 and places.count([[0.0] * 4]) == 1 and not found[path]["is_recursive"]
    for path in ("joints/left/measured", "joints/right/setpoint", "hands/left"):
        assert not found[path]["is_recursive"], path


def test_words_keep_their_level_and_pictures_are_halved(drawn):
    """As Rerun names levels; a picture is JPEG."""

    def told(scene):
        for level in ("info", "warning", "error"):
            scene.tell(1, level, f"a {level}")
        scene.picture(2, {"head_left_eye": np.zeros((64, 48, 3), np.uint8)})

    found = drawn(told)
    assert found["events"]["level"] == [["INFO"], ["WARN"], ["ERROR"]]
    assert found["events"]["text"] == [["a info"], ["a warning"], ["a error"]]
    assert found["cameras/head_left_eye"]["media_type"] == [["image/jpeg"]]
