"""Tests of `ta2 policy run`: what it refuses before anybody owns the robot, and --dry. Played: tests/e2e/test_policy.py."""

from __future__ import annotations

import time
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from tests.client.robot_world import RobotWorld
from tests.policy.lerobot_server import Scripted as LeRobotScripted
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


@pytest.mark.parametrize(("age_s", "status"), [(0.1, 0), (0.7, 1)])
def test_the_policy_is_shown_no_damaged_picture(robot, tmp_path, served, monkeypatch, age_s, status):
    """The newest undamaged one, at most 0.5 s old: one that was predicted from what is lost looks like a scene, too."""

    class Picture(dict):
        age = age_s

    def pictures(source, *, port, strict=False):  # a video whose newest picture is damaged, and black
        newest = Picture(head_left_eye=np.full((400, 640, 3), 200 if strict else 0, np.uint8))
        return nullcontext(SimpleNamespace(latest=newest, wait_frame=lambda timeout: newest))

    monkeypatch.setattr("gateway.video.video.Video", pictures)
    monkeypatch.setattr("gateway.video.receiving.source.robot_address", lambda *_: "127.0.0.1")
    images = '[observation.images]\n"head" = "head_left_eye"\n'
    (tmp_path / "map.toml").write_text(MAP.replace("[actions]", f"{images}[actions]"))
    shown, stays = [], still(robot)
    url = served(lambda asked: (shown.append(asked["head"].min()), stays(asked))[1])
    ended = run(robot, tmp_path, url, "--dry", "--seconds", "0.05", "--json")
    assert ended.status == status and set(shown) <= {200}
    assert bool(shown) if status == 0 else "PART_STALE" in ended.err


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


def test_lerobots_server_needs_a_policy_to_load_and_others_do_not(robot, tmp_path):
    """An option of another kind of server is refused, by its name, as is the want of one."""
    ours = ("--server", "grpc://127.0.0.1:1")
    for words, said in (
        (ours, "--policy is needed"),
        ((*ours, "--policy", "act:x", "--api-key-file", "key"), "--api-key-file is not for"),
        (("--server", "ws://127.0.0.1:1", "--policy", "act:x"), "--policy is not for"),
        (("--local", "a:b", "--device", "cuda"), "--device is not for"),
        ((*ours, "--policy", "act"), "names no policy"),
        (("--server", "grpc://127.0.0.1", "--policy", "act:x"), "no address of a policy server"),
    ):
        ended = robot.run("policy", "run", *words)
        assert ended.status != 0 and said in ended.err
    gone = robot.run("policy", "run", *ours, "--policy", "act:x", "--json")
    assert gone.status == 3 and gone.json["error"]["code"] == "DISCONNECTED"


def test_lerobots_server_is_judged_as_any_other(robot, tmp_path):
    """With --dry: its answers are chunks of the map's columns; state and task arrive under LeRobot's keys."""
    arms = robot.world.pair.see().arms
    row = [*arms["left"].measured.q_rad, 0.0, *arms["right"].measured.q_rad, 0.0]
    server = LeRobotScripted(lambda seen: np.tile(np.float32(row), (10, 1)))
    keys = '[observation]\nstate_key = "observation.state"\nprompt_key = "task"\n'
    (tmp_path / "map.toml").write_text(keys + MAP.partition("\n")[2])
    words = ("--policy", "act:here", "--prompt", "fold", "--dry", "--seconds", "0.5", "--json")
    try:
        ended = run(robot, tmp_path, server.url, *words)
    finally:
        server.close()
    assert ended.status == 0, ended.err
    assert ended.json["steps"] == 10 and ended.json["would_refuse"] == 0
    assert server.taught[0].policy_type == "act" and server.seen[0].observation["task"] == "fold"


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


def test_the_first_step_counts_however_long_a_server_took_to_load_its_model(robot, tmp_path, served, monkeypatch):
    """Not the last one of a chunk that is over by then: a policy may go far in one."""
    arms = robot.world.pair.see().arms
    rows = np.tile(np.float32([*arms["left"].measured.q_rad, 0.0, *arms["right"].measured.q_rad, 0.0]), (10, 1))
    rows[:, 3] += np.linspace(0.0, 0.3, 10)
    assert robot.run("estop").status == 0  # what refuses it once its first step was found near
    later_ns = time.monotonic_ns
    clock = SimpleNamespace(monotonic=time.monotonic, monotonic_ns=lambda: later_ns() + 60_000_000_000)
    monkeypatch.setattr("gateway.cli.policy.run.time", clock)
    ended = run(robot, tmp_path, served(lambda _: {"actions": rows}), "--json", "--seconds", "1")
    assert "  begins 0.0" in ended.err and ended.json["error"]["code"] == "LATCHED"


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


@pytest.mark.parametrize(
    ("rate", "told"), [(120, "120"), ("45", "'45'"), (0, "0"), (float("nan"), "nan"), (True, "True")]
)
def test_a_rate_in_the_metadata_that_is_none_is_refused(robot, tmp_path, served, rate, told):
    """Not passed over: it would be played at 30. What was asked for counts instead."""
    url = served(still(robot), {"fps": rate})
    refused = run(robot, tmp_path, url, "--dry", "--seconds", "0.05")
    assert refused.status == 1 and "--hz" in refused.err
    assert f"BAD_REQUEST: fps in the policy's metadata is {told}, a rate is above 0 and up to 100 Hz" in refused.err
    assert run(robot, tmp_path, url, "--dry", "--seconds", "0.05", "--hz", "20").status == 0


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


def test_it_needs_one_policy_and_looks_in_one_way(shell):
    """A server or a function; a judge or a shadow: usage, status 2."""
    for words in (
        ("--server", "ws://h:1", "--local", "a:b"),
        ("--local", "bad"),
        ("--local", "a:"),
        ("--local", "./a.py:b"),
        ("--local", "a:b", "--dry", "--shadow"),
    ):
        assert shell.run("policy", "run", *words).status == 2


LOCAL = """
import numpy as np

def act(observation):
    state = observation["observation/state"]
    return np.tile(np.float32([*state[0:7], 0.0, *state[8:15], 0.0]), (10, 1))

act.metadata = {"fps": 20}

def fails(observation):
    raise ValueError("no such towel")
"""


@pytest.fixture
def towels(tmp_path, monkeypatch):
    """A module of the working directory."""
    (tmp_path / "towels.py").write_text(LOCAL)
    monkeypatch.chdir(tmp_path)
    return ("--map", str(tmp_path / "map.toml"), "--timeout", "30")


def test_a_function_is_a_policy(robot, towels):
    """Of the current folder, with its own rate; it is named where a server would be."""
    told = robot.run("policy", "run", "--local", "towels:act", *towels, "--dry", "--seconds", "0.1", "--json")
    assert told.status == 0, told.err
    assert told.json["hz"] == 20 and told.json["chunks"] >= 1 and told.json["would_refuse"] == 0
    assert "policy: towels:act, left and right, 10 steps" in told.err


def test_a_function_that_raises_is_told_before_anything_moves(robot, towels):
    """With what it said, and its traceback."""
    ended = robot.run("policy", "run", "--local", "towels:fails", *towels)
    assert ended.status == 1 and "the local policy towels:fails failed: ValueError: no such towel" in ended.err
    assert not robot.world.pair.see().lease.owned


def test_a_shadow_owns_nothing_and_tells_how_far_it_is_from_what_was_done(robot, tmp_path, served):
    """Per arm, in numbers and in words; it asks nobody whether a chunk would be followed, and needs no answer to begin."""
    url = served(still(robot, off_rad=0.15, steps=300))
    told = run(robot, tmp_path, url, "--shadow", "--seconds", "1", "--json")
    assert told.status == 0 and told.json["shadow"] and not told.json["dry"] and "would_refuse" not in told.json
    away = told.json["differences"]
    assert away["left"]["measured"]["rms_rad"] == pytest.approx(0.0, abs=0.002)
    assert away["right"]["measured"]["rms_rad"] == pytest.approx(0.15 / np.sqrt(7), abs=0.002)
    assert away["right"]["measured"]["worst_rad"] == pytest.approx(0.15, abs=0.005) and "commanded" not in away["right"]
    assert not robot.world.pair.sent_on("/api/left_arm/joint_cmd") and not robot.world.pair.see().lease.owned
    plain = run(robot, tmp_path, url, "--shadow", "--seconds", "1")
    assert "right arm: the policy was 0.0567 rad RMS from what was measured" in plain.out
    assert "the gateway would" not in plain.err


def test_a_plot_that_cannot_be_drawn_is_refused_before_anything_moves(robot, tmp_path, served, monkeypatch):
    """No picture's name; no matplotlib, with what installs it."""
    url = served(still(robot))
    assert "matplotlib draws .png or .svg" in run(robot, tmp_path, url, "--plot", "a.txt").err
    monkeypatch.setattr("gateway.cli.policy.run.find_spec", lambda name: None)
    ended = run(robot, tmp_path, url, "--plot", "a.png")
    assert ended.status == 1 and "pip install 'teleavatar-gateway[demo]'" in ended.err


def test_what_was_told_and_measured_is_drawn(robot, tmp_path, served):
    """A file that is a picture; one that cannot be written is told, and the run is as good as without."""
    pytest.importorskip("matplotlib")
    url = served(still(robot))
    file = tmp_path / "policy.svg"
    assert run(robot, tmp_path, url, "--dry", "--seconds", "0.2", "--plot", str(file)).status == 0
    assert "<svg" in file.read_text()
    ended = run(robot, tmp_path, url, "--dry", "--seconds", "0.1", "--plot", str(tmp_path / "no" / "a.png"))
    assert ended.status == 0 and "no plot: " in ended.err and "No such file" in ended.err
