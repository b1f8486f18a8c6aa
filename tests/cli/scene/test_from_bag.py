"""Tests of a recording as a scene."""

from __future__ import annotations

import pytest

from tests.cli.scene.rrd import read

from tests.recording.bags import said, written


def test_a_bag_is_drawn_from_its_begin_on_at_the_rate_that_was_asked_for(shell, tmp_path):
    """Joints, body, hands and what was said of episodes; no gateway is asked."""
    bag = written(tmp_path / "bag", seconds=2.0, words=[said("start", 1, 0.5, task="wave"), said("stop", 1, 1.5)])
    ended = shell.run("view", "--bag", str(bag), "--save", str(tmp_path / "a.rrd"), "--rate", "10")
    assert ended.status == 0, ended.err
    assert ended.out.strip() == str(tmp_path / "a.rrd") and shell.names == []
    found = read(tmp_path / "a.rrd")
    rows = found["joints/left/measured"]["scalars"]
    assert 18 <= len(rows) <= 20 and rows[5] == pytest.approx([0.5] * 7)
    assert len(found["virtual_base/chest/body"]["lengths"]) == len(rows)
    assert found["virtual_base/left_base_virtual/left_shoulder_base/measured"]["translation"]
    assert found["events"]["text"] == [["episode 1: start wave"], ["episode 1: stop"]]


def test_a_bag_without_joints_is_refused(shell, tmp_path):
    """With what tells more."""
    bag = written(tmp_path / "bag", seconds=0.5, change=lambda topic, *row: None if "_arm" in topic.name else row)
    ended = shell.run("view", "--bag", str(bag), "--save", str(tmp_path / "a.rrd"))
    assert ended.status == 2 and "no joints of an arm were recorded -> `ta2 bag info`" in ended.err


def test_no_bag_is_refused(shell, tmp_path):
    """In a line, before a window is opened or a file begun."""
    ended = shell.run("view", "--bag", str(tmp_path / "nothing"), "--save", str(tmp_path / "a.rrd"))
    assert ended.status == 2 and "there is no" in ended.err and "name a folder or file that exists" in ended.err
    assert not (tmp_path / "a.rrd").exists()
