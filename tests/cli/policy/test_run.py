"""Tests of `ta2 policy run`: what it refuses before anybody owns the robot, and --dry. Played: tests/e2e/test_policy.py."""

from __future__ import annotations

import numpy as np
import pytest

from tests.client.robot_world import RobotWorld
from tests.policy.server import Scripted

MAP = '[observation]\n[actions]\ncolumns = ["left_arm", "left_gripper_effort", "right_arm", "right_gripper_effort"]\n'


@pytest.fixture
def robot(shell, tmp_path):
    """A shell whose commands find a robot in joint mode; and a map without pictures."""
    shell.world = RobotWorld()
    (tmp_path / "map.toml").write_text(MAP)
    return shell


def run(robot, tmp_path, server, *words):
    """Run it with a map without pictures."""
    return robot.run("policy", "run", "--server", server, "--map", str(tmp_path / "map.toml"), *words)


@pytest.fixture
def served():
    """Makes a server of a policy."""
    opened = []

    def serve(policy, metadata=None):
        opened.append(Scripted(policy, metadata))
        return opened[-1].url

    yield serve
    for server in opened:
        server.close()


def still(robot, off_rad=0.0, steps=10):
    """A policy that stays where the arms are, or so far away in the right arm's joint 2."""
    arms = robot.world.pair.see().arms
    row = [*arms["left"].measured.q_rad, 0.0, *arms["right"].measured.q_rad, 0.0]
    row[9] += off_rad
    return lambda _: {"actions": np.tile(np.float32(row), (steps, 1))}


def test_it_needs_a_server_and_knows_its_numbers(shell):
    """Usage, status 2."""
    for words in ((), ("--server", "ws://h:1", "--hz", "0"), ("--server", "ws://h:1", "--resize", "5")):
        assert shell.run("policy", "run", *words).status == 2
    ended = shell.run("policy", "run", "--server", "http://h", "--map", "vendor_openpi")
    assert ended.status != 0


def test_what_cannot_be_played_is_refused_before_anything_moves(robot, tmp_path, served):
    """A file that is no map, a server that is none, nobody there, a key that cannot be read: with the status for each."""
    for words, status, said in (
        (("--map", "nothing.toml"), 2, "the policy's map nothing.toml"),
        (("--api-key-file", str(tmp_path / "no")), 2, "the key in"),
    ):
        ended = run(robot, tmp_path, "ws://127.0.0.1:1", *words)
        assert ended.status == status and said in ended.err
    assert run(robot, tmp_path, "http://127.0.0.1:1").status == 2
    gone = run(robot, tmp_path, "ws://127.0.0.1:1", "--json")
    assert gone.status == 3 and gone.json["error"]["code"] == "DISCONNECTED"
    failed = run(robot, tmp_path, served(lambda _: "Traceback\nKeyError: 'images'"), "--json")
    assert failed.status == 1 and failed.json["error"]["code"] == "POLICY_FAILED"
    wrong = run(robot, tmp_path, served(lambda _: {"actions": np.zeros((30, 14))}), "--json")
    assert wrong.status == 1 and wrong.json["error"]["code"] == "WRONG_SHAPE" and wrong.json["error"]["bound"]
    assert not robot.world.pair.sent_on("/api/left_arm/joint_cmd") and not robot.world.pair.see().lease.owned


def test_a_task_that_the_policy_does_not_know_is_refused(robot, tmp_path, served):
    """With those that it knows."""
    url = served(still(robot), {"available_tasks": ["fold", "pick"]})
    ended = run(robot, tmp_path, url, "--prompt", "fly")
    assert ended.status == 1 and "no task 'fly' -> --prompt one of 'fold', 'pick'" in ended.err
    assert run(robot, tmp_path, url, "--prompt", "fold", "--dry", "--seconds", "0.05").status == 0


def test_a_first_step_that_is_far_away_is_refused_with_the_joint(robot, tmp_path, served):
    """Before anybody is asked; and --dry says it of each chunk."""
    url = served(still(robot, 0.15))
    ended = run(robot, tmp_path, url)
    assert ended.status == 1 and "JUMP_TOO_FAR" in ended.err and "right arm's joint 2" in ended.err
    assert "--approach" in ended.err and not robot.world.pair.see().lease.owned


def test_dry_judges_and_tells_and_sends_nothing(robot, tmp_path, served):
    """Steps, range, distance and what the gateway would say; as JSON for scripts, with where the rate comes from."""
    told = run(robot, tmp_path, served(still(robot, 0.15), {"fps": 45}), "--dry", "--seconds", "0.05", "--json")
    assert told.status == 0, told.err
    facts = told.json
    assert facts["ok"] and facts["dry"] and facts["hz"] == 45 and facts["hz_from"] == "as the server says"
    assert facts["steps"] == 10 and facts["first_step_rad"] == pytest.approx(0.15, abs=0.01) and facts["chunks"] >= 1
    low, high = facts["range"]["right_arm"]
    assert low == high and len(low) == 7 and facts["range"]["left_gripper"] == [pytest.approx(0.1)] * 2
    assert "the right arm's joint 2, 0 over 1 rad/s: the gateway would follow it" in told.err
    assert not robot.world.pair.sent_on("/api/left_arm/joint_cmd") and not robot.world.pair.see().lease.owned
    plain = run(robot, tmp_path, served(still(robot), {}), "--dry", "--seconds", "0.05")
    assert (
        plain.status == 0
        and "30 steps a second, as nobody says otherwise" in plain.err
        and "chunks, inference" in plain.out
    )
    asked = run(robot, tmp_path, served(still(robot)), "--dry", "--seconds", "0.05", "--hz", "20", "--json").json
    assert asked["hz"] == 20 and asked["hz_from"] == "as asked for"


def test_dry_tells_what_the_gateway_would_refuse(robot, tmp_path, served):
    """And counts it: the policy is too fast for this robot, or leaves its limits."""
    arms = robot.world.pair.see().arms
    row = np.float32([*arms["left"].measured.q_rad, 0.0, *arms["right"].measured.q_rad, 0.0])
    rows = np.tile(row, (10, 1))
    rows[5:, 0] += 0.5
    told = run(
        robot, tmp_path, served(lambda _: {"actions": rows}), "--dry", "--seconds", "0.05", "--smoothing", "0", "--json"
    )
    assert told.status == 0 and told.json["would_refuse"] == told.json["chunks"] and told.json["over_speed"] >= 1
    assert "the gateway would refuse it: TOO_FAST: left arm point" in told.err


def test_what_the_gateway_refuses_is_shown_and_the_lease_given_back(robot, tmp_path, served):
    """With the gateway's own words; nothing was begun, so nothing is left held."""
    assert robot.run("estop").status == 0
    ended = run(robot, tmp_path, served(still(robot)), "--json", "--seconds", "1")
    assert ended.status == 1 and ended.json["error"]["code"] == "LATCHED" and ended.json["chunks"] == 0
    assert "`ta2 recover`" in ended.err and not robot.world.pair.see().lease.owned
