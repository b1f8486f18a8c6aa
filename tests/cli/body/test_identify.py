"""Tests of `ta2 identify`: from a file and live, the report, the refusal with its advice, and the calibration it writes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace as shown_as

from gateway.cli.body.pairs import keep, read_pairs
from gateway.kinematics.calibration import RobotIdentity, load
from gateway.sim.robot.geometry import arm_geometry
from gateway.sim.robot.manual import Side as SimSide
from gateway.values import Side
from tests.kinematics.identities import EE_M, OFFSETS_RAD, measured, postures

IDENTITY = RobotIdentity(serial="TA2-0042", model="standard")


@pytest.fixture(scope="module")
def pairs(tmp_path_factory):
    """A file with the left arm in motion and the right one hardly."""
    path = tmp_path_factory.mktemp("pairs") / "pairs.jsonl"
    sides = {Side.LEFT: 0.8, Side.RIGHT: 0.05}
    keep({side: measured(side, postures(side, share=share)) for side, share in sides.items()}, path)
    return str(path)


class Moving:
    """Moves both arms of a scripted engine as a robot with these offsets would: 100 Hz joints, the pose 4 ms later."""

    def __init__(self, shell, share=0.8):
        self._shell, self._begun_ns = shell, shell.world.time_ns
        self._paths = {side: postures(side, 3000, share=share) for side in Side}

    def __call__(self):
        """Show the arms as they are now; times between the points of the path are interpolated."""
        now_ns = self._shell.world.time_ns
        arms = {}
        for side in Side:
            q, there = (self._at(side, now_ns - age_ns) for age_ns in (7_000_000, 3_000_000))
            pose = arm_geometry(SimSide(side.value)).forward(there + OFFSETS_RAD)
            old = self._shell.world.engine.snapshot.arms[side.value]
            motors = shown_as(old.measured, q_rad=tuple(q.tolist()), age_ns=7_000_000)
            arms[side.value] = shown_as(
                old, measured=motors, p_m=pose.position_m, quat_xyzw=pose.quat_xyzw, pose_age_ns=3_000_000
            )
        self._shell.world.engine.show(arms=arms)

    def _at(self, side, time_ns):
        step = max(0.0, (time_ns - self._begun_ns) / 50_000_000) + 1
        path = self._paths[side]
        index = int(step)
        return path[index] + (step - index) * (path[index + 1] - path[index])


def test_one_arm_is_found_and_the_other_refused(shell, pairs):
    """Each number with its sigma, residuals before, after and on pairs left out; the reason and the joint to move."""
    ended = shell.run("identify", pairs)
    assert ended.status == 1 and shell.names == [], "nobody was asked, nothing was driven"
    left, right = ended.out.split("right arm:")
    assert left.startswith("left arm: identified from ")
    for number, offset in enumerate(OFFSETS_RAD, start=1):
        (line,) = [line for line in left.splitlines() if f"joint {number} zero" in line]
        value, mark, sigma, unit = line.split()[3:7]
        assert abs(float(value) - 1e3 * offset) < 0.2 and mark == "±" and 0 < float(sigma) < 0.07 and unit == "mrad"
    assert "residual as described" in left and "residual corrected" in left and "on pairs not fitted" in left
    assert "not identified: parameters cannot be told apart" in right
    assert "joint 6 zero with ee turn about y" in right or "ee turn about y with joint 6 zero" in right
    assert "-> move, beside what has moved and slowly: joint 7 from" in right
    assert all(len(line) < 200 for line in left.splitlines())


def test_json_has_everything(shell, pairs):
    """Numbers in radians and metres, the covariance, singular values, and the reason as a name."""
    ended = shell.run("identify", pairs, "--json")
    left, right = ended.json["arms"]["left"], ended.json["arms"]["right"]
    np.testing.assert_allclose(left["joint_zero_offsets_rad"], OFFSETS_RAD, atol=0.2e-3)
    np.testing.assert_allclose(left["nominal_ee_T_ee"]["p_m"], EE_M, atol=0.2e-3)
    assert left["identified"] is True and len(left["covariance"]) == len(left["parameters"]) == 12
    assert left["after"]["position_m"] < 5e-4 < left["before"]["position_m"]
    assert right["identified"] is False and right["why"] == "BLURRED" and right["excitation"]["blurred"]
    assert right["excitation"]["advice"][0]["joint"] == 7 and right["excitation"]["least"] == 0.05


def test_what_is_found_becomes_this_robots_calibration(shell, pairs, tmp_path):
    """Only the arm that was found; loaded on this robot, shown by `ta2 frames`, refused on another."""
    path = tmp_path / "TA2-0042.json"
    ended = shell.run("identify", pairs, "--out", str(path), "--serial", "TA2-0042")
    assert ended.status == 1 and "left of robot TA2-0042 (standard) written" in ended.err
    found = load(path, IDENTITY)
    assert set(found.arms) == {Side.LEFT}
    np.testing.assert_allclose(found.arms[Side.LEFT].correction.offsets_rad, OFFSETS_RAD, atol=0.2e-3)
    assert "postures" in found.arms[Side.LEFT].note
    plain, own = (
        shell.run("frames", "--json", *words).json["transforms"]["left_base_virtual_T_left_ee"]["matrix"]
        for words in ([], ["--calibration", str(path), "--serial", "TA2-0042"])
    )
    assert np.abs(np.array(plain) - np.array(own)).max() > 1.0, "millimetres"
    assert shell.run("frames", "--calibration", str(path), "--serial", "other").status == 2


def test_nothing_is_written_when_nothing_is_found(shell, pairs, tmp_path):
    """No file with no arms in it."""
    path = tmp_path / "TA2-0042.json"
    ended = shell.run("identify", pairs, "--arm", "right", "--out", str(path), "--serial", "TA2-0042")
    assert ended.status == 1 and not path.exists() and "left arm" not in ended.out


@pytest.mark.thorough
def test_live_it_looks_on_and_keeps_what_it_saw(shell, tmp_path):
    """From the gateway's snapshots, paired by arrival; progress each second on standard error; no request is sent.

    It ends as soon as both arms are identified, long before the time is over.
    """
    shell.world.on_tick = Moving(shell)
    kept = tmp_path / "seen.jsonl"
    ended = shell.run("identify", "--live", "--seconds", "150", "--keep", str(kept), "--json")
    assert ended.status == 0 and shell.names == ["ta2 identify"] and shell.world.engine.names() == []
    for side in ("left", "right"):
        np.testing.assert_allclose(ended.json["arms"][side]["joint_zero_offsets_rad"], OFFSETS_RAD, atol=0.2e-3)
    progress = [line for line in ended.err.splitlines() if line.startswith("at most ")]
    assert 9 <= len(progress) <= 60 and "gain" in progress[0] and "move joint" in progress[0]
    assert progress[-1].count(", enough") == 2, progress[-1]
    assert 400 < len(read_pairs(kept)[Side.LEFT]) < 3000
    again = shell.run("identify", str(kept), "--json")
    for side in ("left", "right"):
        one, other = (end.json["arms"][side]["joint_zero_offsets_rad"] for end in (again, ended))
        np.testing.assert_allclose(one, other, atol=1e-9, err_msg="the file gives the same")


def test_live_an_arm_that_stands_still_is_told_so(shell):
    """While it is looked at, and in the end."""
    ended = shell.run("identify", "--live", "--seconds", "2", "--arm", "left")
    assert ended.status == 1 and "left: stands still" in ended.err and "too few postures" in ended.out


def test_without_poses_there_is_nothing_to_compare(shell):
    """A robot that publishes none: one line that says where to look."""
    arms = shell.world.engine.snapshot.arms
    shell.world.engine.show(arms={side: shown_as(arm, pose_age_ns=None) for side, arm in arms.items()})
    ended = shell.run("identify", "--live", "--seconds", "1")
    assert (
        ended.err.splitlines()[-1].startswith("PART_STALE: no pairs of joints and pose") and "ta2 topics" in ended.err
    )


@pytest.mark.parametrize(
    ("words", "count"),
    [
        (["--joints-only"], 7),
        pytest.param(["--shoulder"], 17, marks=pytest.mark.thorough),
        (["--joints-only", "--shoulder"], 12),
    ],
)
def test_what_is_fitted_can_be_chosen(shell, pairs, words, count):
    """Joints alone, with the shoulder's frame; the fit of the joints alone says so when that does not explain it."""
    row = shell.run("identify", pairs, "--arm", "left", "--json", *words).json["arms"]["left"]
    assert len(row["excitation"]["singular_values"]) == count


def test_a_urdf_of_ones_own_is_what_it_is_compared_with(shell, pairs, tmp_path):
    """A file that is not there is refused; the option reaches the model."""
    ended = shell.run("identify", pairs, "--urdf", str(tmp_path / "none.urdf"))
    assert ended.status == 2 and ended.err.startswith("BAD_CONFIG: ")
    settings = tmp_path / "a.toml"
    settings.write_text(f'[model]\nurdf = "{tmp_path / "configured.urdf"}"\n')
    configured = shell.run("identify", pairs, "--config", str(settings))
    assert configured.status == 2 and "configured.urdf" in configured.err, "what the gateway uses is what is identified"


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["pairs.jsonl", "--live"],
        ["--live", "--seconds", "0"],
        ["pairs.jsonl", "--arm", "middle"],
        ["/none/pairs.jsonl"],
        ["/none/pairs.jsonl", "--out", "x.json"],
    ],
)
def test_what_makes_no_sense_is_a_usage_error(shell, words):
    """Neither source or both, no time, no such arm, no such file, and nobody's calibration."""
    assert shell.run("identify", *words).status == 2


def test_whose_file_it_is_is_asked_before_anything_is_measured(shell, tmp_path):
    """Nobody looks on for a minute in vain."""
    ended = shell.run("identify", "--live", "--out", str(tmp_path / "x.json"))
    assert ended.status == 2 and shell.names == [] and "nobody said which" in ended.err


@pytest.mark.thorough
def test_pairs_of_a_file_may_be_old(shell, pairs, tmp_path):
    """Stamps are not needed where both streams are of the same instants: the order of the lines is the order of time."""
    rows = [{**json.loads(line), "stamp_ns": 0} for line in Path(pairs).read_text().splitlines()]
    path = tmp_path / "unstamped.jsonl"
    path.write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
    rows = [shell.run("identify", str(one), "--arm", "left", "--json").json["arms"]["left"] for one in (pairs, path)]
    first, second = (row["joint_zero_offsets_rad"] for row in rows)
    np.testing.assert_allclose(first, second, atol=0.1e-3)
    assert abs(rows[0]["lag_s"]) < 1e-3 and rows[1]["lag_s"] == 0.0, "without stamps there is no lag to be found"
