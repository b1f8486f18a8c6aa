"""Tests of `ta2 dataset`: what a person and a script read of it."""

from __future__ import annotations

import re

import pytest

from tests.dataset.motion import OWN, moving


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
        (("--least-rows", "0"), "number of rows from 1"),
        (("--format", "v2.0"), "v2.0"),
        (("--dims", "14"), "14"),
    ],
)
def test_what_cannot_be_is_refused_before_a_bag_is_read(shell, tmp_path, arguments, why):
    """Status 2, with the bounds."""
    ended = shell.run("dataset", "build", str(tmp_path / "bag"), "--out", str(tmp_path / "set"), *arguments)
    assert ended.status == 2 and why in ended.err


def test_what_is_no_bag_or_no_dataset_is_refused_in_one_line(shell, tmp_path):
    """Status 2: a word of the command line names no such file."""
    ended = shell.run("dataset", "build", str(tmp_path / "nothing"), "--out", str(tmp_path / "set"))
    assert ended.status == 2 and "there is no " in ended.err
    ended = shell.run("dataset", "check", str(tmp_path))
    assert ended.status == 2 and "meta/info.json: No such file or directory -> name the folder of a" in ended.err


OWN_LAYOUT = ("--least-rows", "10", "--layout")


@pytest.fixture
def sets(shell, tmp_path):
    """Return two datasets of bags without pictures."""
    (tmp_path / "own.toml").write_text(OWN)
    found = []
    for name in ("a", "b"):
        bag = moving(tmp_path / f"bag-{name}", 1.0, facts={"task": name})
        out = str(tmp_path / name)
        shell.run("dataset", "build", str(bag), "--out", out, *OWN_LAYOUT, str(tmp_path / "own.toml"))
        found.append(out)
    return found


def test_datasets_are_merged_and_split(shell, sets, tmp_path):
    """How much is in what was made, in words and as JSON; status 1 for what cannot be."""
    ended = shell.run("dataset", "merge", *sets, "--out", str(tmp_path / "both"))
    assert ended.status == 0 and re.fullmatch(r".*both: 2 episodes, \d+ rows\n", ended.out)
    part = shell.run(
        "dataset", "split", str(tmp_path / "both"), "--episodes", "1", "--out", str(tmp_path / "one"), "--json"
    )
    assert part.json["ok"] and part.json["episodes"] == 1 and part.json["folder"].endswith("one")
    assert shell.run("dataset", "diff", str(tmp_path / "one"), sets[1]).out == "they hold the same\n"
    ended = shell.run("dataset", "split", sets[0], "--episodes", "0,2-3", "--out", str(tmp_path / "two"))
    assert ended.status == 2 and "has no episode 2, 3" in ended.err
    ended = shell.run("dataset", "merge", *sets, "--out", sets[0])
    assert ended.status == 1 and "is not empty" in ended.err


def test_what_differs_is_listed_with_status_1(shell, sets):
    """A line each; as JSON with places and sizes."""
    ended = shell.run("dataset", "diff", *sets)
    assert ended.status == 1 and ended.out == "episode 0: tasks: a or b\nthey differ\n"
    found = shell.run("dataset", "diff", *sets, "--json").json
    assert not found["ok"] and found["differences"][0]["where"] == "episode 0"


def test_a_dataset_is_shown_in_words_and_as_a_picture(shell, sets, tmp_path):
    """Episodes, rows, tasks, names and units; one episode on request."""
    ended = shell.run("dataset", "show", sets[0])
    assert ended.status == 0 and "LeRobot v2.1, 1 episode, " in ended.out and "task      a\n" in ended.out
    assert "vector    observation.state: 3 dimensions\n            a .. c [rad]\n" in ended.out
    found = shell.run("dataset", "show", sets[0], "--json").json
    assert found["vectors"]["action"] == [[["a", "b", "c"], "rad"]] and found["tasks"] == ["a"] and not found["file"]
    ended = shell.run("dataset", "show", sets[0], "--episode", "0")
    assert re.search(r"^episode   0: \d+ rows, \d\.\d s, a$", ended.out, re.MULTILINE)
    ended = shell.run("dataset", "show", sets[0], "--episode", "1")
    assert ended.status == 1 and "has no episode 1" in ended.err
    pytest.importorskip("matplotlib")
    ended = shell.run("dataset", "show", sets[0], "--out", str(tmp_path / "a.html"))
    assert ended.status == 0 and (tmp_path / "a.html").read_text(encoding="utf-8").startswith("<!doctype html>")
    ended = shell.run("dataset", "show", sets[0], "--out", str(tmp_path / "nowhere/a.png"))
    assert ended.status == 2 and "cannot be shown" in ended.err and "nowhere" in ended.err


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("split", "set", "--episodes", "5-3", "--out", "new"), "names no episode"),
        (("split", "set", "--episodes", "x", "--out", "new"), "number of an episode"),
        (("show", "set", "--out", "a.bmp"), "is no .png and no .html"),
    ],
)
def test_what_makes_no_sense_is_refused_before_a_dataset_is_read(shell, arguments, why):
    """Status 2, with what it has to be."""
    ended = shell.run("dataset", *arguments)
    assert ended.status == 2 and why in ended.err
