"""Tests of whole datasets: that they say what the robot did, are made the same way each time, and hide nothing."""

from __future__ import annotations

import json

import numpy as np
import pytest

from gateway.dataset import building as module
from gateway.dataset.building import PROVENANCE, Choices, build
from gateway.dataset.layout import ACTION, ACTION_SHIFT_S, STATE, vendor_layout
from gateway.dataset.lerobot_reader import Dataset
from gateway.errors import Rejected
from gateway.recording.episodes import EpisodeEvent, as_message
from gateway.recording.topics import EPISODES, TEXT, RecordedTopic, recorded_topics
from gateway.robot.topics import ee_pose, gripper_state
from gateway.robot.vector_layout import STATE_NAMES, effort_of_command
from gateway.settings.settings import LinkSettings
from gateway.values import Side
from tests.dataset.motion import BEGIN_NS, NAMESPACE, angle, grip, moving, position
from tests.recording.bags import joints

TOPIC = RecordedTopic(name=EPISODES, type_name=TEXT)


def choices(**changes):
    """Return the maker's layout, but for what is said."""
    return Choices(**{"layout": vendor_layout(), "least_rows": 10, **changes})


def said(*words):
    """Return what was said: event, seconds after the begin, and the episode."""
    return [
        (
            TOPIC,
            round(s * 1e9),
            as_message(EpisodeEvent(event=event, episode=n, at_ns=BEGIN_NS + round(s * 1e9), **more)),
        )
        for event, s, n, more in words
    ]


def files(folder):
    """Return every file with its bytes."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_each_number_is_what_the_robot_did_at_that_instant(tmp_path, version):
    """State and action, by name: joints within what they move in 100 µs, hands, torques; though messages came late."""
    built = build([moving(tmp_path / "bag", 4.0)], tmp_path / "set", choices(version=version))
    assert (built.episodes, built.tasks) == (1, ("wave",)) and built.rows == pytest.approx(179, abs=2)
    (episode,) = Dataset(tmp_path / "set").episodes()
    begin_ns = json.loads((tmp_path / "set" / PROVENANCE).read_text())["episodes"][0]["begin_ns"]
    times = (begin_ns - BEGIN_NS) / 1e9 + np.arange(built.rows) / 45.0
    state, action = (dict(zip(STATE_NAMES, episode.columns[feature].T, strict=True)) for feature in (STATE, ACTION))
    for side in Side:
        for joint in range(7):
            name = f"{side}_joint{joint + 1}_position"
            assert np.allclose(state[name], [position(f"/{side}_arm", joint, t) for t in times], atol=1e-3)
            commanded = [position(f"/{side}_arm", joint, t + ACTION_SHIFT_S) for t in times]
            assert np.allclose(action[name], commanded, atol=1e-3)
        assert np.allclose(state[f"{side}_ee_position_x"], times, atol=1e-3)
        assert np.allclose(
            np.abs(state[f"{side}_ee_orientation_z"]), [abs(np.sin(angle(t) / 2)) for t in times], atol=1e-3
        )
        torque = [effort_of_command(grip(t + ACTION_SHIFT_S)) for t in times]
        assert np.allclose(action[f"{side}_gripper_effort"], torque, atol=0.03)
    assert not action["left_gripper_position"].any() and not state["kinco_velocity"].any()
    assert "left_gripper_position" in built.uncovered[ACTION] and built.uncovered[STATE] == ("kinco_velocity",)


def test_the_same_bags_give_the_same_bytes(tmp_path):
    """Every file of both formats."""
    bags = [moving(tmp_path / name, 2.0) for name in ("a", "b")]
    for version in ("v2.1", "v3.0"):
        for name in ("one", "two"):
            build(bags, tmp_path / version / name, choices(version=version))
        assert files(tmp_path / version / "one") == files(tmp_path / version / "two")


def test_what_is_broken_off_goes_on_where_it_was_and_ends_the_same(tmp_path, monkeypatch):
    """Bags that were read are not read again; nothing is called a dataset before it is one."""
    bags = [moving(tmp_path / name, 2.0) for name in ("a", "b")]
    build(bags, tmp_path / "whole", choices())
    read, convert = [], module._convert

    def breaking(path, video, folder, chosen, on_progress):
        read.append(path.name)
        convert(path, video, folder, chosen, on_progress)
        if read == ["a", "b"]:
            (folder / "bag.json").unlink()
            raise KeyboardInterrupt

    monkeypatch.setattr(module, "_convert", breaking)
    with pytest.raises(KeyboardInterrupt):
        build(bags, tmp_path / "set", choices())
    assert not (tmp_path / "set").exists()
    build(bags, tmp_path / "set", choices())
    assert read == ["a", "b", "b"] and not (tmp_path / "set.building").exists()
    assert files(tmp_path / "set") == files(tmp_path / "whole")


def test_other_choices_begin_anew(tmp_path, monkeypatch):
    """What was kept for others is thrown away."""
    bag = moving(tmp_path / "a", 2.0)
    monkeypatch.setattr(module, "write_dataset", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    for fps in (45.0, 30.0):
        with pytest.raises(KeyboardInterrupt):
            build([bag], tmp_path / "set", choices(fps=fps))
    monkeypatch.undo()
    assert build([bag], tmp_path / "set", choices(fps=30.0)).rows == pytest.approx(60, abs=2)


def test_episodes_are_taken_as_they_were_said_and_judged(tmp_path):
    """Discarded ones never, failures unless only successes are wanted; each with its own task."""
    more = said(
        ("start", 0.2, 1, {"task": "wave"}), ("stop", 0.8, 1, {}), ("success", 0.9, 1, {}),
        ("start", 1.0, 2, {"task": "wave"}), ("stop", 1.6, 2, {}), ("discard", 1.7, 2, {}),
        ("start", 2.0, 3, {"task": "bow"}), ("stop", 2.6, 3, {}), ("failure", 2.7, 3, {}),
    )  # fmt: skip
    bag = moving(tmp_path / "bag", 3.0, more=more)
    built = build([bag], tmp_path / "set", choices())
    assert (built.episodes, built.tasks, built.rows) == (2, ("wave", "bow"), 54)
    assert built.left_out == {"episode discarded": 1}
    only = build([bag], tmp_path / "only", choices(success_only=True, task="greet"))
    assert (only.episodes, only.tasks) == (1, ("greet",))
    assert only.left_out == {"episode discarded": 1, "episode not judged a success": 1}


def test_a_gap_splits_an_episode(tmp_path):
    """And both parts say from where they are."""
    bag = moving(tmp_path / "bag", 4.0, lambda topic, t_s: topic.name != ee_pose(Side.LEFT) or not 1.5 < t_s < 2.2)
    built = build([bag], tmp_path / "set", choices())
    assert built.episodes == 2 and built.left_out == {
        f"row: no value of {ee_pose(Side.LEFT)}": pytest.approx(31, abs=3)
    }
    facts = json.loads((tmp_path / "set" / PROVENANCE).read_text())
    assert [(e["bag"], e["number"], e["outcome"]) for e in facts["episodes"]] == [("bag", 1, "")] * 2
    assert facts["left_out"] == built.left_out and facts["choices"]["fps"] == 45.0


def test_bags_of_the_robot_itself_have_what_was_commanded_inside(tmp_path):
    """Its own commands are taken before public ones: of grippers the torque, as it was given to the motor."""
    inside = [RecordedTopic(name=f"/{side}_{part}/joint_cmd", type_name="sensor_msgs/msg/JointState", is_stamped=True)
              for side in Side for part in ("arm", "gripper")]  # fmt: skip
    more = [
        (topic, n * 10_000_000, joints(BEGIN_NS + n * 10_000_000, 7 if "arm" in topic.name else 1, -0.7))
        for topic in inside
        for n in range(200)
    ]
    bag = moving(tmp_path / "bag", 2.0, more=more)
    build([bag], tmp_path / "set", choices(by_arrival=True))
    (episode,) = Dataset(tmp_path / "set").episodes()
    action = dict(zip(STATE_NAMES, episode.columns[ACTION][20], strict=True))
    assert action["left_joint1_position"] == action["right_gripper_effort"] == pytest.approx(-0.7)
    assert action["left_gripper_velocity"] == pytest.approx(-0.7)


def test_a_robot_behind_a_bridge_with_a_namespace_gives_the_same_dataset(tmp_path):
    """The bag notes it."""
    topics = recorded_topics(LinkSettings(namespace=NAMESPACE))
    build([moving(tmp_path / "bag", 2.0, topics=topics, facts={"namespace": NAMESPACE})], tmp_path / "named", choices())
    build([moving(tmp_path / "bare" / "bag", 2.0)], tmp_path / "set", choices())
    named, bare = files(tmp_path / "named"), files(tmp_path / "set")
    assert {name for name, data in named.items() if data != bare[name]} == {PROVENANCE}
    with pytest.raises(Rejected, match="nothing of it was recorded"):
        build([moving(tmp_path / "unknown", 2.0, topics=topics)], tmp_path / "other", choices())


@pytest.mark.parametrize(
    ("prepare", "why"),
    [
        (lambda out: (out.mkdir(), (out / "x").touch()), "is not empty"),
        (lambda out: out.touch(), "is not empty"),
    ],
)
def test_a_folder_that_holds_anything_is_refused(tmp_path, prepare, why):
    """And keeps what it holds."""
    bag = moving(tmp_path / "bag", 1.0)
    prepare(tmp_path / "set")
    with pytest.raises(Rejected, match=why):
        build([bag], tmp_path / "set", choices())
    assert (tmp_path / "set").exists()


def test_an_empty_folder_is_taken(tmp_path):
    """As `mkdir` left it."""
    (tmp_path / "set").mkdir()
    build([moving(tmp_path / "bag", 1.0)], tmp_path / "set", choices())
    assert (tmp_path / "set/meta/info.json").exists()


def test_what_leaves_no_episode_is_refused_with_the_reasons(tmp_path):
    """And leaves nothing."""
    bag = moving(tmp_path / "bag", 1.0)
    with pytest.raises(Rejected, match=r"no episode is left: .* x row: less than 1000 rows in a row"):
        build([bag], tmp_path / "set", choices(least_rows=1000))
    missing = moving(tmp_path / "other", 1.0, lambda topic, t_s: topic.name != gripper_state(Side.LEFT))
    with pytest.raises(Rejected, match="left_gripper_position"):
        build([missing], tmp_path / "set", choices())
    assert not (tmp_path / "set").exists()


def test_a_disk_that_is_full_is_refused_in_one_line_and_what_is_done_is_kept(tmp_path, monkeypatch):
    """The next build goes on from there."""
    bags = [moving(tmp_path / name, 1.0) for name in ("a", "b")]
    store = module.store_episode
    stored = []

    def full(file, tables):
        if stored:
            raise OSError(28, "No space left on device")
        stored.append(file)
        store(file, tables)

    monkeypatch.setattr(module, "store_episode", full)
    with pytest.raises(Rejected, match=r"cannot be built: .*No space left on device"):
        build(bags, tmp_path / "set", choices())
    monkeypatch.undo()
    assert (tmp_path / "set.building/bag-0000/bag.json").exists()
    assert build(bags, tmp_path / "set", choices()).episodes == 2


def test_progress_is_told(tmp_path):
    """Of reading and of writing, to the end."""
    told = []
    build([moving(tmp_path / "bag", 1.0)], tmp_path / "set", choices(), lambda what, share: told.append((what, share)))
    assert ("reading bag", 1.0) in told and told[-1] == ("writing", 1.0)
