"""Tests of `ta2 bag`: what a person and a script read of a recording."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gateway.robot.topics import arm_state
from gateway.values import Side
from tests.recording.bags import joints, pressed, said, written

LEFT = arm_state(Side.LEFT)


@pytest.mark.parametrize("verb", ["info", "topics"])
def test_info_shows_what_a_bag_holds(shell, tmp_path, verb):
    """Length, size, each topic with type, number and rate; the same as JSON."""
    folder = written(tmp_path / "bag")
    ended = shell.run("bag", verb, str(folder))
    (line,) = [line for line in ended.out.splitlines() if line.startswith(LEFT)]
    assert line.split() == [LEFT, "sensor_msgs/msg/JointState", "600", "200.3"]
    assert ended.status == 0 and "3.0 s from" in ended.out and "model   standard" in ended.out
    found = shell.run("bag", verb, str(folder), "--json").json
    assert {"name": LEFT, "type_name": "sensor_msgs/msg/JointState", "count": 600, "alias_of": ""} in found["topics"]
    assert found["messages"] == sum(topic["count"] for topic in found["topics"])


def test_info_lists_episodes(shell, tmp_path):
    """When each began, how long it was, and what came of it; of a bag without, nothing but in JSON."""
    words = (said("start", 1, 0.5, task="wave [once]"), said("mark", 1, 1), said("stop", 1, 1.5), said("failure", 1, 2))
    folder = written(tmp_path / "bag", words=(*words, said("start", 2, 2), said("discard", 2, 2.5)))
    lines = [line.split() for line in shell.run("bag", "info", str(folder)).out.splitlines()]
    assert ["1", "0.50", "1.00", "failure", "1", "wave", "[once]"] in lines
    assert ["2", "2.00", "1.00", "discarded", "unfinished", "0"] in lines
    assert [e["task"] for e in shell.run("bag", "info", str(folder), "--json").json["episodes"]] == ["wave [once]", ""]
    plain = str(written(tmp_path / "plain", task="pick"))
    assert "outcome" not in shell.run("bag", "info", plain).out
    assert [e["task"] for e in shell.run("bag", "info", plain, "--json").json["episodes"]] == ["pick"]


def test_what_buttons_mark_is_listed_as_what_was_said(shell, tmp_path):
    """Of a bag of the robot's own recorder, by `info` and by `list`."""
    folder = pressed(tmp_path / "marked", ["", "x", "", "y", "", "x", "", "y"])
    lines = [line.split() for line in shell.run("bag", "info", str(folder)).out.splitlines()]
    assert ["1", "1.00", "2.00", "0"] in lines and ["2", "5.00", "2.00", "0"] in lines
    assert len(shell.run("bag", "info", str(folder), "--json").json["episodes"]) == 2
    assert shell.run("bag", "list", str(tmp_path)).out.splitlines()[0].endswith(", 2 episodes")


def test_list_shows_the_bags_of_a_folder_the_newest_first(shell, tmp_path):
    """With their episodes; what cannot be read, or is being recorded, says why; what is no bag is passed over."""
    old = written(tmp_path / "old", words=(said("start", 1, 0.5), said("stop", 1, 1.5), said("success", 1, 2)))
    new = written(tmp_path / "new", task="pick")
    going = tmp_path / "going"
    going.mkdir()
    (going / "going.mcap.active").touch()
    (tmp_path / "notes").mkdir()
    (tmp_path / "torn.mcap").write_bytes(b"no bag")
    for age, path in enumerate((going, new, old, tmp_path / "torn.mcap")):
        os.utime(path, (1e9 - age, 1e9 - age))
    found = shell.run("bag", "list", str(tmp_path), "--json").json
    assert [Path(bag["bag"]).name for bag in found["bags"]] == ["going", "new", "old", "torn.mcap"]
    assert "still being recorded" in found["bags"][0]["problem"] and found["bags"][3]["problem"]
    assert found["bags"][1]["task"] == "pick" and found["bags"][2]["episodes"][0]["outcome"] == "success"
    lines = shell.run("bag", "list", str(tmp_path)).out.splitlines()
    assert len(lines) == found["count"] == 4 and lines[2].endswith(", 1 episode")
    assert lines[1].endswith(" s, no episodes pick")
    (tmp_path / "empty").mkdir()
    assert shell.run("bag", "list", str(tmp_path / "empty")).out == f"no bags in {tmp_path / 'empty'}\n"
    ended = shell.run("bag", "list", str(tmp_path / "nothing"))
    assert ended.status == 2 and "name a folder" in ended.err


def test_check_says_that_nothing_is_wrong(shell, tmp_path):
    """With a status that a script can go by."""
    ended = shell.run("bag", "check", str(written(tmp_path / "bag")))
    assert ended.status == 0 and ended.out.strip().endswith("nothing is wrong")


def test_check_names_what_is_wrong_the_worst_first(shell, tmp_path):
    """Topic, figure and what helps; status 1 when it is not fit for use."""

    def spoil(topic, at_ns, data):
        if topic.name == LEFT:
            return at_ns, joints(at_ns, value=float("nan"))
        return None if topic.name == arm_state(Side.RIGHT) else (at_ns, data)

    folder = written(tmp_path / "bag", 3.0, spoil)
    ended = shell.run("bag", "check", str(folder))
    assert ended.status == 1 and ended.out.strip().endswith("not fit for use")
    assert f"ERROR   {LEFT}: 600 of 600 messages hold NaN or infinity" in ended.out
    found = shell.run("bag", "check", str(folder), "--json")
    assert found.status == 1 and not found.json["ok"]
    assert [finding["level"] for finding in found.json["findings"]] == ["error", "error"]


def test_what_is_no_bag_is_refused_in_one_line(shell, tmp_path):
    """Status 2: a word of the command line names no such file; without words for those who write programs."""
    ended = shell.run("bag", "info", str(tmp_path / "nothing"))
    assert "protocol.py" not in ended.err
    assert ended.status == 2 and ended.err.startswith("BAD_REQUEST: there is no ")


def test_bags_and_tables_are_made_of_bags(shell, tmp_path):
    """Cut, merge and export: a line each, the same as JSON."""
    words = (said("start", 1, 0.5), said("stop", 1, 1.5))
    folder, part, both = str(written(tmp_path / "bag", words=words)), str(tmp_path / "part"), str(tmp_path / "both")
    cut = shell.run("bag", "cut", folder, "--out", part, "--from", "0", "--to", "1")
    assert cut.status == 0 and cut.out == f"{part}/part_0.mcap: 1423 messages, 1 episodes\n" and "cut: 100%" in cut.err
    found = shell.run("bag", "merge", folder, part, "--out", both, "--json").json
    assert found["file"] == f"{both}/both_0.mcap" and found["episodes"] == 2
    tables = shell.run("bag", "export", folder, "--out", str(tmp_path / "csv"), "--topic", LEFT)
    assert tables.out == f"{tmp_path}/csv/left_arm.joint_states.csv: 600 rows, 24 columns\n"
    found = shell.run("bag", "export", part, "--out", str(tmp_path / "parquet"), "--format", "parquet", "--json").json
    assert {table["topic"]: table["rows"] for table in found["tables"]}[LEFT] == 200
    refused = shell.run("bag", "cut", folder, "--out", str(tmp_path / "no"), "--episode", "5", "--json")
    assert refused.status == 1 and "has no episode 5; there are: 1" in refused.json["error"]["message"]
