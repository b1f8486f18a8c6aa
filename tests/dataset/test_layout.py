"""Tests of layouts: the maker's, and one's own."""

from __future__ import annotations

import pytest

from gateway.dataset.episode import INTEGERS
from gateway.dataset.layout import ACTION, STATE, load, vendor_layout
from gateway.errors import Rejected
from gateway.robot.topics import TOPICS
from gateway.robot.vector_layout import STATE_NAMES

OWN = """
[[feature]]
name = "observation.state"

[[feature.part]]
names = ["x", "y"]
unit = "rad"
source = [{ topic = "/left_arm/joint_states", field = "position", first = 2, rule = "linear", stale_s = 0.5 }]
"""


@pytest.mark.parametrize("size", [48, 62, 72])
def test_the_makers_vectors_have_his_names_in_his_order(size):
    """Each shorter one is a prefix of the longer: readers address dimensions absolutely."""
    layout = vendor_layout(size)
    assert [feature.name for feature in layout.feature] == [STATE, ACTION]
    assert all(feature.names == STATE_NAMES[:size] for feature in layout.feature)


def test_vectors_of_other_sizes_are_refused():
    """With the sizes there are."""
    with pytest.raises(Rejected, match="64") as refused:
        vendor_layout(64)
    assert refused.value.refusal.bound == "48, 62, 72"


def test_public_topics_are_the_robots_own():
    """A source under `/api/` is a topic of the manual's table."""
    public = {source.topic for f in vendor_layout().feature for part in f.part for source in part.source}
    assert {topic for topic in public if topic.startswith("/api/")} <= set(TOPICS)


def test_joints_and_the_grippers_torques_are_needed():
    """What the maker's policies read and are taught; the rest is taken where it was recorded."""
    state, action = vendor_layout().feature
    assert [p.label for p in state.part if p.need == "always"] == [
        "left_joint1_position .. left_joint7_position", "left_gripper_position",
        "right_joint1_position .. right_joint7_position", "right_gripper_position",
    ]  # fmt: skip
    assert [p.label for p in action.part if p.need == "always"] == [
        "left_joint1_position .. left_joint7_position", "right_joint1_position .. right_joint7_position",
        "left_gripper_effort", "right_gripper_effort",
    ]  # fmt: skip


def test_an_own_layout_is_read_from_toml(tmp_path):
    """Topic, field, unit and rule of each part."""
    (tmp_path / "own.toml").write_text(OWN)
    (feature,) = load(tmp_path / "own.toml").feature
    (part,) = feature.part
    assert (feature.name, feature.names, part.unit, part.need) == ("observation.state", ("x", "y"), "rad", "always")
    assert (part.source[0].first, part.source[0].rule, part.source[0].stale_s) == (2, "linear", 0.5)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ('rule = "linear"', 'rule = "cubic"', "cubic"),
        ('rule = "linear"', 'rule = "slerp"', "four numbers of a quaternion, not 2"),
        ('["x", "y"]', '["x", "x"]', "x: the same name for more than one dimension"),
        ('["x", "y"]', "[]", "names"),
        ("stale_s = 0.5", "stale_s = 0", "stale_s"),
        ("first = 2", "first = -1", "first"),
        ("unit =", "units =", "units"),
        (OWN.strip(), OWN + OWN, "observation.state: the same name for more than one feature"),
        (OWN.strip(), "", "feature"),
        (OWN.strip(), "[[", "toml"),
    ],
)
def test_a_layout_that_cannot_be_used_is_refused_by_name(tmp_path, old, new, why):
    """What is wrong, and in which file."""
    path = tmp_path / "own.toml"
    path.write_text(OWN.replace(old, new) if old != OWN.strip() else new)
    with pytest.raises(Rejected) as refused:
        load(path)
    assert why in str(refused.value) and str(path) in str(refused.value)


@pytest.mark.parametrize(
    "name",
    ["timestamp", *INTEGERS, "task", "observation/state", "observation.images.head_camera", "observation.images.x"],
)
def test_a_feature_cannot_have_a_name_of_lerobots_own_or_of_a_camera(tmp_path, name):
    """It would take the column's place, or the camera its; LeRobot takes no slash."""
    path = tmp_path / "own.toml"
    path.write_text(OWN.replace("observation.state", name))
    with pytest.raises(Rejected, match="cannot be the name of a feature") as refused:
        load(path)
    assert refused.value.refusal.value == name and "LeRobot's own" in refused.value.refusal.bound


def test_a_layout_that_is_not_there_is_refused(tmp_path):
    """As any file."""
    with pytest.raises(Rejected, match=r"nothing\.toml"):
        load(tmp_path / "nothing.toml")
