"""Tests of commands under a second name: in the file only, marked, and never counted twice."""

from __future__ import annotations

import pytest

from cdr_types import decode, encode
from cdr_types.messages.geometry_msgs import Point, Pose
from cdr_types.messages.sensor_msgs import JointState
from cdr_types.messages.std_msgs import Float32
from gateway.dataset.building import Choices, build
from gateway.dataset.lerobot_reader import Dataset
from gateway.recording.bag_check import check
from gateway.recording.bag_reader import Bag
from gateway.recording.editing import cut
from gateway.recording.recorder import Recorder
from gateway.recording.topics import recorded_topics
from gateway.robot.topics import gripper_command, joint_command, pose_command
from gateway.robot.vector_layout import effort_of_command
from gateway.settings.settings import LinkSettings
from gateway.values import Side
from tests.changed import replace
from tests.dataset.motion import moving
from tests.recording.bags import BEGIN_NS, joints, payload

SETTINGS = LinkSettings()
TOPICS = recorded_topics(SETTINGS, aliases=True)
NAMES = [topic.name for topic in TOPICS]


def recorded(folder, seconds=2.0, commands=(), topics=TOPICS):
    """Record states, and commands: after how many ns, on which topic, what. Return the folder and what was told at the end."""
    now_ns = 10**9
    recorder = Recorder(
        folder,
        topics,
        {"model": "standard"},
        wall_ns=lambda: BEGIN_NS,
        clock=lambda: now_ns,
        free_bytes=lambda _: 10**12,
    )
    rows = [
        (now_ns + round(n * 1e9 / topic.rate_hz), number, payload(topic, now_ns))
        for number, topic in enumerate(topics)
        if topic.rate_hz
        for n in range(int(seconds * topic.rate_hz))
    ]
    rows += [(now_ns + after_ns, NAMES.index(name), data) for after_ns, name, data in commands]
    for row in sorted(rows):
        recorder.take(row[1], row[0], row[2])
    recorder.step(now_ns)
    recorder.finish()
    return folder, recorder.progress(now_ns)


def test_aliases_follow_all_other_topics_and_have_no_key():
    """So nobody listens to them, and numbers stay as they are; a namespace is theirs, too."""
    plain = recorded_topics(SETTINGS)
    assert TOPICS[: len(plain)] == plain and not any(topic.key or topic.is_state for topic in TOPICS[len(plain) :])
    assert {topic.name: topic.alias_of for topic in TOPICS[len(plain) :]} == {
        f"/{side}_{mine}": its
        for side in Side
        for mine, its in (
            ("arm/joint_cmd", joint_command(side)),
            ("arm/target_ee_pose", pose_command(side)),
            ("gripper/joint_cmd", gripper_command(side)),
        )
    }
    named = recorded_topics(replace(SETTINGS, namespace="robot1"), aliases=True)[-1]
    assert named.name.startswith("/robot1/") and named.alias_of.startswith("/robot1/api/")


@pytest.fixture
def commanded(tmp_path):
    """Return a recording in which everything was commanded once, a gripper also with what is no command."""
    pose = encode(Pose(position=Point(x=0.1, y=0.2, z=0.3)))
    commands = [
        (1, joint_command(Side.LEFT), joints(1)),
        (2, pose_command(Side.RIGHT), pose),
        (3, gripper_command(Side.LEFT), encode(Float32(data=0.5))),
        (4, gripper_command(Side.LEFT), encode(Float32(data=float("nan")))),
        (5, gripper_command(Side.LEFT), b"rubbish"),
    ]
    return recorded(tmp_path / "bag", commands=commands)


def test_commands_are_there_again_as_the_robot_has_them_inside(commanded):
    """Joints and poses byte for byte, a gripper's command as torque (manual §4.4); what is no command is not."""
    with Bag(commanded[0]) as bag:
        said = {(m.topic, m.log_ns - BEGIN_NS): m.payload for m in bag.messages([n for n in NAMES if "joint_cmd" in n])}
        (pose,) = bag.messages(["/right_arm/target_ee_pose"])
    (torque,) = [data for (name, _), data in said.items() if name == "/left_gripper/joint_cmd"]
    assert decode(torque, JointState).effort == [pytest.approx(effort_of_command(0.5))]
    assert said["/left_arm/joint_cmd", 1] == said[joint_command(Side.LEFT), 1] == joints(1)
    assert decode(pose.payload, Pose).position.z == pytest.approx(0.3)


def test_aliases_are_marked_in_the_file_and_in_what_is_cut_of_it(commanded, tmp_path, shell):
    """And shown as what they are."""
    with Bag(commanded[0]) as bag:
        cut(bag, tmp_path / "part", to_s=0.5)
    for folder in (commanded[0], tmp_path / "part"):
        with Bag(folder) as bag:
            found = {topic.name: topic.alias_of for topic in bag.topics if topic.count and topic.alias_of}
        assert found == {
            "/left_arm/joint_cmd": joint_command(Side.LEFT),
            "/left_gripper/joint_cmd": gripper_command(Side.LEFT),
            "/right_arm/target_ee_pose": pose_command(Side.RIGHT),
        }
    ended = shell.run("bag", "info", str(commanded[0]))
    assert f"alias   /left_arm/joint_cmd of {joint_command(Side.LEFT)}\n" in ended.out


def test_they_are_never_counted_twice(commanded):
    """Neither while recording nor when the bag is judged; what is wrong is told of the topic itself alone."""
    folder, progress = commanded
    with Bag(folder) as bag:
        checked = check(bag)
        aliases = sum(topic.count for topic in bag.topics if topic.alias_of)
        assert aliases == 3 and checked.messages == progress.messages == bag.message_count - aliases
    assert {f.topic for f in checked.findings if f.level == "error"} == {gripper_command(Side.LEFT)}


def test_a_dataset_takes_what_was_said_itself(layout, tmp_path):
    """The same with aliases and without."""
    plain = recorded_topics(SETTINGS)
    with Bag(moving(tmp_path / "moved", 1.0)) as bag:
        rows = [(m.log_ns - BEGIN_NS, m.topic, m.payload) for m in bag.messages([t.name for t in plain])]
    columns = []
    for topics in (plain, TOPICS):
        folder, _ = recorded(tmp_path / f"bag{len(topics)}", 0.0, rows, topics)
        out = tmp_path / f"set{len(topics)}"
        build([folder], out, Choices(layout=layout, least_rows=10))
        (episode,) = Dataset(out).episodes()
        columns.append(episode.columns["action"].tolist())
        sources = (out / "meta/teleavatar.json").read_text()
        assert '"/api/left_arm/joint_cmd"' in sources and '"/left_arm/joint_cmd"' not in sources
    assert columns[0] == columns[1]
