"""Tests of `ta2 identify --dynamics`: a motion to follow, what is found of one that was kept or looked at, what is written."""

from __future__ import annotations

import json

import numpy as np
import pytest
from msgspec.structs import replace as shown_as

REASON = "pinocchio or MuJoCo is not installed: pip install 'teleavatar-gateway[body,sim]'"
pytest.importorskip("pinocchio", reason=REASON)
pytest.importorskip("mujoco", reason=REASON)

from gateway.kinematics.calibration import RobotIdentity, load
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import Side
from tests.kinematics.dynamics.swung import swung

IDENTITY = RobotIdentity(serial="TA2-0042", model="standard")


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A file with the left arm swung, and the right one not at all."""
    motion, path = swung().motion, tmp_path_factory.mktemp("kept") / "swung.jsonl"
    rows = zip(motion.at_s, motion.q_rad, motion.dq_radps, motion.tau_nm, strict=True)
    lines = [
        {
            "arm": "left",
            "stamp_ns": round(1e9 * at_s),
            "q_rad": q.tolist(),
            "dq_radps": dq.tolist(),
            "tau_nm": tau.tolist(),
        }
        for at_s, q, dq, tau in rows
    ]
    path.write_text("\n".join(map(json.dumps, lines)) + "\n")
    return str(path)


def test_one_arm_is_found_and_written_and_the_other_refused(shell, kept, tmp_path):
    """Each number with its standard deviation, what is left; the reason and what to do; into this robot's calibration."""
    out = tmp_path / "TA2-0042.json"
    ended = shell.run("identify", "--dynamics", kept, "--out", str(out), "--serial", "TA2-0042")
    assert ended.status == 1 and shell.names == [], "nobody was asked, nothing was driven"
    left, right = ended.out.split("right arm:")
    assert left.startswith("left arm: identified") and "scale" in left and "±" in left and "kg" in left
    assert "condition numbers" in left and "left now" in left
    assert "not identified: 0.0 s of motion is too short" in right and "->" in right
    found = load(out, IDENTITY).dynamics
    assert list(found) == [Side.LEFT] and "% of the range of effort" in found[Side.LEFT].note
    assert np.array(found[Side.LEFT].drives.scale) == pytest.approx(swung().scale, abs=0.2)


def test_everything_is_there_for_scripts(shell, kept):
    """As JSON, with standard deviations and residuals."""
    ended = shell.run("identify", "--dynamics", kept, "--arm", "left", "--json")
    row = ended.json["left"]
    assert ended.status == 0 and row["identified"] and len(row["scale"]) == len(row["sd"]["scale"]) == 7
    assert all(now < 0.05 * width for now, width in zip(row["after_nm"], row["range_nm"], strict=True))
    refused = shell.run("identify", "--dynamics", kept, "--arm", "right", "--json")
    assert refused.status == 1 and refused.json["right"]["identified"] is False and refused.json["right"]["hint"]


def test_it_looks_on_live_and_keeps_what_it_saw(shell, tmp_path):
    """Joints once each, with efforts; an arm that hardly moved is refused."""
    arms = shell.world.engine.snapshot.arms
    seven = (0.5,) * 7

    def show():
        measured = shown_as(
            arms["left"].measured, stamp_ns=shell.world.time_ns, q_rad=seven, dq_radps=seven, tau_nm=seven
        )
        shell.world.engine.show(arms={**arms, "left": shown_as(arms["left"], measured=measured)})

    shell.world.on_tick = show
    keep = tmp_path / "kept.jsonl"
    ended = shell.run("identify", "--dynamics", "--live", "--seconds", "2", "--arm", "left", "--keep", str(keep))
    assert ended.status == 1 and "too short" in ended.out
    rows = [json.loads(line) for line in keep.read_text().splitlines() if line]
    assert {row["arm"] for row in rows} <= {"left"}
    assert len({row["stamp_ns"] for row in rows}) == len(rows)


@pytest.mark.parametrize("words", [("--live", "--keep"), ("--live", "--dynamics", "--keep"), ("--excite",)])
def test_a_file_that_cannot_be_written_is_refused_before_anything_is_measured(shell, tmp_path, words):
    """What was measured with a moving robot is not lost for it."""
    ended = shell.run("identify", *words, str(tmp_path / "nowhere" / "kept.jsonl"), "--arm", "left")
    assert ended.status == 2 and f"argument {words[-1]}" in ended.err and "in a folder that is there" in ended.err
    assert shell.world.ticks == 5, "nothing but the shell's own wait"


SHORT = {"arm": "left", "stamp_ns": 1, "q_rad": [1], "dq_radps": [1], "tau_nm": [1]}


@pytest.mark.parametrize("line", ["{", '{"arm": "left"}', json.dumps(SHORT)])
def test_a_file_that_cannot_be_read_is_told_with_its_line(shell, tmp_path, line):
    """No JSON, a key that is missing, numbers that are."""
    path = tmp_path / "kept.jsonl"
    path.write_text(line + "\n")
    ended = shell.run("identify", "--dynamics", str(path))
    assert ended.status != 0 and "line 1" in ended.err
    assert "name a file that is there" in shell.run("identify", "--dynamics", str(tmp_path / "no.jsonl")).err


def test_a_motion_to_follow_is_written_inside_the_limits(shell, tmp_path):
    """As `ta2 follow` reads it, with how well it tells."""
    path = tmp_path / "swing.npz"
    ended = shell.run("identify", "--excite", str(path), "--arm", "right")
    assert ended.status == 0 and "condition number" in ended.out and "right arm" in ended.out
    with np.load(path) as arrays:
        q, times = arrays["right"], arrays["times"]
    assert q.shape == (len(times), 7) and times[-1] == pytest.approx(40.0)
    assert (q >= JOINT_LOWER_RAD[Side.RIGHT]).all() and (q <= JOINT_UPPER_RAD[Side.RIGHT]).all()
