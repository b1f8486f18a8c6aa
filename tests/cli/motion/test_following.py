"""Tests of `ta2 follow` against the real engine and the simulated robot, in virtual time."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest
from msgspec import structs

from gateway.messages.requests import Follow
from tests.changed import replace
from tests.client.robot_world import RobotWorld

DT_S = 0.05
SIDES = ("left", "right")
PERIOD_S = 0.01


@pytest.fixture
def robot(shell):
    """A shell whose commands find a robot in joint mode."""
    shell.world = RobotWorld()
    return shell


def swing(shell, *sides, count=40, size=0.1, off_rad=0.0, rate=2.0):
    """A swing of joint 4 that begins so far from where these arms hang."""
    ways = size * (1.0 - np.cos(rate * DT_S * np.arange(count)))[:, None] * np.eye(7)[3]
    arms = shell.world.pair.see().arms
    return {side: np.array(arms[side].measured.q_rad) + off_rad * np.eye(7)[3] + ways for side in sides}


def saved(tmp_path, points, **more):
    """A file of these points."""
    np.savez(tmp_path / "way.npz", **points, **more)
    return str(tmp_path / "way.npz")


def commanded(shell, side="left"):
    """Every setpoint of joint 4 that reached the wire, in order."""
    return np.array([frame.values[3] for _, frame in shell.world.pair.sent_on(f"/api/{side}_arm/joint_cmd")])


def test_a_file_is_judged_followed_and_told_of(robot, tmp_path):
    """Enabled, followed with progress by the trajectory's own time, settled, disabled; both arms on one clock."""
    points = swing(robot, *SIDES)
    ended = robot.run("follow", saved(tmp_path, points, dt=DT_S), "--json")
    assert ended.status == 0, ended.err
    told = ended.json
    assert told["ok"] and told["points"] == 40 and told["sides"] == ["left", "right"] and not told["held"]
    assert told["duration_s"] == pytest.approx(39 * DT_S) and told["error_rad"] < 0.05 and told["skipped"] == 0
    for said in (
        "left and right through 40 points of way.npz, 1.9 s",
        "left arm  begins 0.0",
        "follow:",
        "enable: READY",
    ):
        assert said in ended.err
    assert robot.names == ["ta2 follow"]
    for side in SIDES:
        assert commanded(robot, side).max() == pytest.approx(points[side][:, 3].max(), abs=2e-3)
        assert commanded(robot, side)[-1] == pytest.approx(points[side][-1][3], abs=1e-9)
    assert robot.world.pair.state in ("READ_ONLY", "STOPPING", "IDLE")


def test_one_arm_of_a_file_is_followed_slower_and_left_held(robot, tmp_path):
    """`--arm`, `--stretch` and `--hold`; the other arm does not move."""
    points = swing(robot, *SIDES)
    ended = robot.run("follow", saved(tmp_path, points, dt=DT_S), "--arm", "right", "--stretch", "2", "--hold")
    assert ended.status == 0, ended.err
    assert "after 3.9 s; held" in ended.out and "60 s" in ended.err and "left arm" not in ended.err
    assert np.ptp(commanded(robot, "left")) < 1e-9 and np.ptp(commanded(robot, "right")) > 0.15


def test_check_says_what_would_be_and_nobody_needs_to_own_the_robot(robot, tmp_path):
    """Nothing moves, nobody is asked."""
    file = saved(tmp_path, swing(robot, "left", off_rad=0.05), dt=DT_S)
    ended = robot.run("follow", file, "--check", "--smoothing", "0.1")
    assert ended.status == 0, ended.err
    assert "good: the gateway would follow it" in ended.out and "begins 0.05" in ended.out and "smoothing" in ended.out
    told = robot.run("follow", file, "--check", "--json").json
    assert told["ok"] and told["away"]["left"][3] == pytest.approx(0.05, abs=0.01) and told["points"] == 40
    assert not robot.world.pair.frames and not robot.world.pair.see().lease.owned


@pytest.mark.parametrize("words", [["--check"], []])
def test_what_cannot_be_followed_is_refused_with_its_line_before_anything_moves(robot, tmp_path, words):
    """The first point to blame, value, bound, and what to do in words of the shell."""
    points = swing(robot, "left")["left"]
    points[30:, 3] += 0.4
    text = "# a step\n" + "".join(",".join(map(str, [n * DT_S, *row])) + "\n" for n, row in enumerate(points))
    (tmp_path / "way.csv").write_text(text)
    ended = robot.run("follow", str(tmp_path / "way.csv"), "--arm", "left", *words)
    assert ended.status == 1
    assert ended.err.startswith("TOO_FAST: way.csv line ") and "left arm point 2" in ended.err
    assert "rad/s" in ended.err and "--stretch " in ended.err and "is slow enough" in ended.err
    assert not robot.world.pair.frames
    factor = ended.err.partition("--stretch ")[2].partition(" ")[0]
    slower = robot.run("follow", str(tmp_path / "way.csv"), "--arm", "left", "--stretch", factor, "--check")
    assert slower.status == 0, slower.err


def test_arms_that_are_far_from_the_beginning_go_there_when_that_is_asked_for(robot, tmp_path):
    """Else it is refused, and says how."""
    file = saved(tmp_path, swing(robot, "left", off_rad=0.3), dt=DT_S)
    ended = robot.run("follow", file)
    assert ended.status == 1 and ended.err.startswith("JUMP_TOO_FAR: left arm joint 4")
    assert "or move there first: --approach" in ended.err and not robot.world.pair.frames
    ended = robot.run("follow", file, "--approach", "--speed", "1")
    assert ended.status == 0, ended.err
    assert "moved there first" in ended.err and "approach:" in ended.err
    steps = np.abs(np.diff(commanded(robot)))
    assert steps.max() <= 1.0 * PERIOD_S * 1.001, "no faster than the limit, on the way to the beginning and on it"


def test_a_long_file_goes_in_parts_and_the_arms_do_not_stop_between(robot, tmp_path):
    """More points than one request takes: the same motion, as if it were one."""
    times_s = np.arange(900) * 0.01
    hung = swing(robot, "left", count=1)["left"]
    points = {"left": hung + (0.1 * (1.0 - np.cos(0.8 * times_s)))[:, None] * np.eye(7)[3]}
    ended = robot.run("follow", saved(tmp_path, points, times=times_s), "--json", "--smoothing", "0.1")
    assert ended.status == 1 and "smoothing" in ended.err  # needs points that are evenly spaced: --dt
    ended = robot.run("follow", saved(tmp_path, points, dt=0.01), "--json")
    assert ended.status == 0, ended.err
    assert ended.json["points"] == 900 and ended.json["duration_s"] == pytest.approx(8.99)
    motions = robot.world.pair.see().motions
    assert [motion.state for motion in motions] == ["superseded", "superseded", "reached"]
    sent = commanded(robot)
    begun = next(n for n in range(len(sent)) if abs(sent[n : n + 100] - points["left"][100:200, 3]).max() < 1e-4)
    beside = np.abs(sent[begun : begun + 700] - points["left"][100:800, 3])
    assert beside.max() < 1e-3, f"{beside.argmax()}: it left the recorded way where two parts meet"
    speeds = np.diff(sent) / PERIOD_S
    assert np.abs(np.diff(speeds)).max() / PERIOD_S < 3.0 * 1.001


def test_a_part_that_is_refused_on_the_way_leaves_the_arms_held(robot, tmp_path, monkeypatch):
    """What is under way ends without its successor: braked, held, and told so."""
    times_s = np.arange(900) * 0.01
    hung = swing(robot, "left", count=1)["left"]
    points = {"left": hung + (0.1 * (1.0 - np.cos(0.8 * times_s)))[:, None] * np.eye(7)[3]}
    engine = robot.world.pair.engine
    take = engine.receive

    def receive(event, now_ns):
        request = getattr(event, "request", None)
        if isinstance(request, Follow) and request.start_at_ns is not None:  # a later part, under an epoch that is none
            event = replace(event, request=structs.replace(request, epoch=2**40))
        take(event, now_ns)

    monkeypatch.setattr(engine, "receive", receive)
    ended = robot.run("follow", saved(tmp_path, points, dt=0.01))
    assert ended.status == 1 and "NOT_OWNER" in ended.err and "held with their grip" in ended.err


@pytest.mark.parametrize("words", [(), ("--check",)])
def test_the_other_control_mode_is_refused_before_anything_is_asked_for(robot, tmp_path, words):
    """With the way out; a judgement is none that leaves it out."""
    poses = np.tile([0.3, 0.1, -0.2, 0.0, 0.0, 0.0, 1.0], (10, 1))
    ended = robot.run("follow", saved(tmp_path, {"left": poses}, dt=DT_S), "--space", "pose", *words)
    assert ended.status == 1 and ended.err.startswith("WRONG_CONTROL_MODE: the left arm is in joint mode")
    assert "--space joint" in ended.err and not robot.world.pair.frames


def test_poses_are_followed_by_an_end_effector_from_its_approach_on(shell, tmp_path):
    """In the arm's own frame; the approach is a straight motion of its own."""
    shell.world = RobotWorld(left_mode="pose")
    pose = shell.world.pair.see().arms["left"]
    start = np.array([*pose.p_m, *pose.quat_xyzw])
    ways = 0.02 * (1.0 - np.cos(1.5 * DT_S * np.arange(40)))[:, None] * np.eye(7)[0]
    file = saved(tmp_path, {"left": start * [0.9, 0.9, 0.9, 1, 1, 1, 1] - ways}, dt=DT_S, space="pose")
    refused = shell.run("follow", file)
    assert refused.status == 1 and refused.err.startswith("JUMP_TOO_FAR")
    ended = shell.run("follow", file, "--approach", "--tolerance", "0.006", "0.06")
    assert ended.status == 0, ended.err
    assert "mm and 0.0" in ended.err and "mm after 1.9 s" in ended.out


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (["none.csv"], 2, "cannot be read"),
        (["way.npz", "--arm", "right"], 2, "no points for the right arm"),
        (["way.npz", "--arm", "left"], 2, "does not say when"),
        (["way.npz", "--dt", "0"], 2, "is not above 0"),
        (["way.npz", "--stretch", "0.5"], 2, "no factor from 1 to 100"),
        (["way.npz", "--dt", "x"], 2, "is no number"),
        (["way.npz", "--start-in", "1", "--start-at", "1"], 2, "not allowed"),
        (["way.npz", "--dt", "0.05", "--start-in", "20"], 1, "OUT_OF_RANGE"),
    ],
)
def test_what_was_typed_wrong_is_told(robot, tmp_path, monkeypatch, words, status, said):
    """The command line and the file end with status 2, what the gateway refuses with 1."""
    monkeypatch.chdir(tmp_path)
    saved(tmp_path, swing(robot, "left"))
    ended = robot.run("follow", *words)
    assert (ended.status, said in ended.err) == (status, True), ended.err


def test_ctrl_c_on_the_way_leaves_the_arms_held(robot, tmp_path):
    """As with every motion."""

    def interrupt():
        raise KeyboardInterrupt

    robot.world.after(4.0, interrupt)
    ended = robot.run("follow", saved(tmp_path, swing(robot, "left", count=120), dt=DT_S))
    assert ended.status == 130 and "interrupted: the arms are held" in ended.err
    assert all(abs(after - before) <= PERIOD_S * 1.001 for before, after in pairwise(commanded(robot)))


def test_it_begins_when_it_was_told_to(robot, tmp_path):
    """So long after enabling, or at an instant of the gateway's clock, which may have passed for some points."""
    points = swing(robot, "left", size=0.02)
    assert robot.run("follow", saved(tmp_path, points, dt=DT_S), "--start-in", "1.5").status == 0
    at_s = robot.world.pair.now_ns / 1e9 + 2.0
    ended = robot.run("follow", saved(tmp_path, points, dt=DT_S), "--start-at", str(at_s), "--json")
    assert ended.status == 0, ended.err
    assert json.loads(ended.out)["duration_s"] == pytest.approx(39 * DT_S)


@pytest.mark.parametrize("dt_s", [float("nan"), float("inf"), -1.0])
def test_a_time_from_point_to_point_that_is_none_is_refused_in_a_line(robot, tmp_path, dt_s):
    """As Python writes it into JSON; judged with all else, and nothing moves."""
    path = tmp_path / "way.json"
    path.write_text(json.dumps({side: rows.tolist() for side, rows in swing(robot, "left").items()} | {"dt": dt_s}))
    ended = robot.run("follow", str(path), "--yes")
    assert ended.status == 1 and ended.err.startswith(("NOT_FINITE: dt_s", "OUT_OF_RANGE: dt_s"))
