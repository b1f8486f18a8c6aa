"""Tests of `ta2 dataset`: what a person and a script read of it."""

from __future__ import annotations

import pytest

from tests.dataset.motion import moving


def test_a_dataset_is_built_and_judged_with_two_commands(shell, tmp_path):
    """Words for a person: how much there is, what is zero and why, where to look."""
    bag = moving(tmp_path / "bag", 2.0)
    ended = shell.run("dataset", "build", str(bag), "--out", str(tmp_path / "set"))
    assert ended.status == 0 and "1 episode, " in ended.out and "task      wave" in ended.out
    assert "zero      observation.state: nothing was recorded of kinco_velocity" in ended.out
    ended = shell.run("dataset", "check", str(tmp_path / "set"))
    assert ended.status == 0 and ended.out.strip().endswith("fit for training")


def test_a_script_reads_the_same_as_json(shell, tmp_path):
    """Counts, what was left out, findings; status 1 for what is not fit."""
    bag = moving(tmp_path / "bag", 2.0)
    arguments = (
        "--out",
        str(tmp_path / "set"),
        "--format",
        "v3.0",
        "--fps",
        "20",
        "--dims",
        "48",
        "--task",
        "bow",
        "--json",
    )
    found = shell.run("dataset", "build", str(bag), *arguments).json
    assert (
        found["ok"]
        and found["episodes"] == 1
        and found["tasks"] == ["bow"]
        and found["rows"] == pytest.approx(39, abs=1)
    )
    assert shell.run("dataset", "check", str(tmp_path / "set"), "--json").json["version"] == "v3.0"
    (tmp_path / "set/meta/stats.json").write_text("{")
    ended = shell.run("dataset", "check", str(tmp_path / "set"), "--json")
    assert ended.status == 1 and not ended.json["ok"] and ended.json["findings"][0]["level"] == "error"


def test_an_own_layout_is_taken(shell, tmp_path):
    """From TOML."""
    layout = tmp_path / "own.toml"
    layout.write_text(
        '[[feature]]\nname = "action"\n[[feature.part]]\nnames = ["x"]\n'
        'source = [{ topic = "/left_arm/joint_states", field = "position", first = 3 }]\n'
    )
    bag = moving(tmp_path / "bag", 2.0)
    ended = shell.run("dataset", "build", str(bag), "--out", str(tmp_path / "set"), "--layout", str(layout))
    assert ended.status == 0 and "zero" not in ended.out


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("--fps", "0"), "rows per second"),
        (("--fps", "300"), "up to 200"),
        (("--least-rows", "0"), "a number of rows from 1"),
        (("--format", "v2.0"), "v2.0"),
        (("--dims", "14"), "14"),
    ],
)
def test_what_cannot_be_is_refused_before_a_bag_is_read(shell, tmp_path, arguments, why):
    """Status 2, with the bounds."""
    ended = shell.run("dataset", "build", str(tmp_path / "bag"), "--out", str(tmp_path / "set"), *arguments)
    assert ended.status == 2 and why in ended.err


def test_what_is_no_bag_or_no_dataset_is_refused_in_one_line(shell, tmp_path):
    """Status 1, as any refusal."""
    ended = shell.run("dataset", "build", str(tmp_path / "nothing"), "--out", str(tmp_path / "set"))
    assert ended.status == 1 and "there is no " in ended.err
    ended = shell.run("dataset", "check", str(tmp_path))
    assert ended.status == 1 and "is no dataset of LeRobot" in ended.err
