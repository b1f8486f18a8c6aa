"""Tests of `ta2 replay` against the real engine and the simulated robot, in virtual time."""

from __future__ import annotations

import os
import signal
import sys
import time

import numpy as np
import pytest

from cdr_types import encode
from cdr_types.messages.builtin_interfaces import Time
from cdr_types.messages.sensor_msgs import JointState
from cdr_types.messages.std_msgs import Header
from gateway.cli.motion import replaying
from gateway.cli.motion.replaying import DT_S, recorded
from gateway.errors import Rejected
from gateway.recording.bag_writer import BagWriter
from gateway.recording.episodes import EpisodeEvent, as_message
from gateway.recording.topics import EPISODES, recorded_topics
from gateway.robot.topics import arm_state, joint_command
from gateway.settings.settings import LinkSettings
from gateway.values import Side
from tests.client.robot_world import RobotWorld
from tests.recording.bags import BEGIN_NS

SECONDS = 3.0
SIZE_RAD = 0.15
LAG_S = 0.05
"""Arms are so far behind what they are told."""


@pytest.fixture
def robot(shell):
    """A shell whose commands find a robot in joint mode."""
    shell.world = RobotWorld()
    return shell


def way(t_s):
    """Return how far joint 4 is from where it began [rad]."""
    return SIZE_RAD * (1.0 - np.cos(2.0 * np.pi * max(0.0, t_s) / SECONDS)) / 2.0


def shown(folder, starts, sides=tuple(Side), words=(), namespace="", gap=None, is_there=lambda side, t_s: True):
    """Write a bag in which arms swing their elbow from where they start; what is told lies under its name."""
    topics = recorded_topics(LinkSettings(namespace=namespace))
    number = {topic.name: n for n, topic in enumerate(topics)}
    prefix = f"/{namespace}" if namespace else ""
    rows = []
    for side in sides:
        for name, period_s, lag_s in ((joint_command(side), 0.01, 0.0), (arm_state(side), 0.005, LAG_S)):
            for n in range(round(SECONDS / period_s)):
                t_s = n * period_s
                if (gap is not None and gap[0] < t_s < gap[1]) or not is_there(side, t_s):
                    continue
                q_rad = np.array(starts[side]) + way(t_s - lag_s) * np.eye(7)[3]
                stamp = Time(sec=0, nanosec=0)
                message = JointState(header=Header(stamp=stamp), position=q_rad.tolist(), velocity=[], effort=[])
                rows.append((BEGIN_NS + round(t_s * 1e9), number[prefix + name], encode(message)))
    for event, t_s, episode in words:
        at_ns = BEGIN_NS + round(t_s * 1e9)
        rows.append((at_ns, number[EPISODES], as_message(EpisodeEvent(event=event, episode=episode, at_ns=at_ns))))
    bag = BagWriter(folder, topics)
    for at_ns, which, data in sorted(rows):
        bag.add(which, at_ns, at_ns, data)
    bag.note({"namespace": namespace, "lost": "0"})
    bag.finish()
    return folder


def starts(shell, off_rad=0.0):
    """Return so far from where the arms hang, each to its own side."""
    arms, signs = shell.world.pair.see().arms, {Side.LEFT: 1.0, Side.RIGHT: -1.0}
    return {side: np.array(arms[side].measured.q_rad) + signs[side] * off_rad * np.eye(7)[3] for side in Side}


def commanded(shell, side):
    """Every setpoint of joint 4 that reached the wire, in order."""
    return np.array([frame.values[3] for _, frame in shell.world.pair.sent_on(f"/api/{side}_arm/joint_cmd")])


def test_arms_do_again_what_they_were_told_and_are_measured_beside_it(robot, tmp_path):
    """Both on one clock, to the millirad; how far they are from where they were then is told."""
    begin = starts(robot)
    ended = robot.run("replay", str(shown(tmp_path / "bag", begin)), "--json")
    assert ended.status == 0, ended.err
    told = ended.json
    assert told["ok"] and told["points"] == 149 and told["duration_s"] == pytest.approx(148 * DT_S)
    assert 0.0 < told["rms_rad"] < 0.02 and told["rms_rad"] < told["most_rad"] < 0.05
    for side in Side:
        assert commanded(robot, side).max() == pytest.approx(begin[side][3] + SIZE_RAD, abs=2e-3)


def test_it_is_told_in_words_too_slower_and_for_one_arm(robot, tmp_path):
    """`--stretch` makes it last longer; the other arm does not move."""
    begin = starts(robot)
    ended = robot.run("replay", str(shown(tmp_path / "bag", begin)), "--stretch", "2", "--arm", "left")
    assert ended.status == 0 and "rad RMS from the recording" in ended.out + ended.err
    assert "follow: left through 149 points of bag, 5.9 s" in ended.err
    assert np.ptp(commanded(robot, Side.RIGHT)) < 0.01 if len(commanded(robot, Side.RIGHT)) else True


def test_a_recording_that_begins_elsewhere_is_refused_and_approached_when_asked_to(robot, tmp_path):
    """Nothing jumps."""
    bag = str(shown(tmp_path / "bag", starts(robot, 0.3)))
    ended = robot.run("replay", bag)
    assert ended.status == 1 and "JUMP_TOO_FAR" in ended.err and not len(commanded(robot, Side.LEFT))
    ended = robot.run("replay", bag, "--approach")
    assert ended.status == 0, ended.err


@pytest.mark.parametrize("words", [(), ("--check",)])
def test_an_arm_in_end_effector_mode_is_refused_with_what_this_command_has(shell, tmp_path, words):
    """It has no --space: only joints are replayed."""
    shell.world = RobotWorld(left_mode="pose")
    bag = str(shown(tmp_path / "bag", starts(shell)))
    ended = shell.run("replay", bag, *words)
    assert ended.status == 1 and ended.err.startswith("WRONG_CONTROL_MODE: the left arm is in end-effector mode")
    assert "use --arm for one in joint mode, or set the arm" in ended.err
    assert shell.run("replay", bag, "--arm", "right", "--check").status == 0


def test_check_moves_nothing(robot, tmp_path):
    """It says how long it is, and how far away it begins."""
    bag = str(shown(tmp_path / "bag", starts(robot)))
    ended = robot.run("replay", bag, "--check")
    assert ended.status == 0 and "good: the gateway would follow it" in ended.out
    assert not len(commanded(robot, Side.LEFT))


WORDS = (
    ("start", 0.1, 1),
    ("stop", 0.9, 1),
    ("discard", 0.95, 1),
    ("start", 1.0, 2),
    ("stop", 2.0, 2),
    ("start", 2.1, 3),
)


def test_an_episode_is_chosen_by_its_number_and_the_first_good_one_without(robot, tmp_path):
    """A discarded one only by its number; one that was not stopped goes to the end."""
    bag = shown(tmp_path / "bag", starts(robot), words=WORDS)
    assert [len(recorded(bag, n)[0]) for n in (None, 1, 2, 3)] == [50, 40, 50, 44]
    begin = recorded(bag)[0].points["left"][0, 3]
    assert begin == pytest.approx(starts(robot)[Side.LEFT][3] + way(1.0), abs=1e-4)
    with pytest.raises(Rejected, match="has no episode 4, but 3 in all"):
        recorded(bag, 4)


def test_a_way_ends_where_nothing_was_recorded(robot, tmp_path):
    """The longest piece is taken: no arm is told what nobody said."""
    bag = shown(tmp_path / "bag", starts(robot), gap=(0.5, 1.0))
    recording, measured, _ = recorded(bag)
    assert len(recording) == pytest.approx(98, abs=2)
    assert recording.points["left"][0, 3] == pytest.approx(starts(robot)[Side.LEFT][3] + way(1.0), abs=1e-3)
    assert {side: rows.shape for side, rows in measured.items()} == {s: (len(recording), 7) for s in ("left", "right")}


def test_what_lies_behind_a_gap_is_left_out_and_that_is_said(robot, tmp_path):
    """In a line and for scripts; of a recording without a gap nothing is."""
    ended = robot.run("replay", str(shown(tmp_path / "bag", starts(robot), gap=(2.0, 2.5))), "--check")
    assert ended.status == 0 and "its longest piece without a gap; 0.5 s more that were told are left out" in ended.out
    for name, gap, left_out_s in (("cut", (2.0, 2.5), 0.5), ("whole", None, 0.0)):
        ended = robot.run("replay", str(shown(tmp_path / name, starts(robot), gap=gap)), "--check", "--json")
        assert ended.json["left_out_s"] == pytest.approx(left_out_s, abs=0.05)


def test_one_arm_and_a_namespace_are_found(robot, tmp_path):
    """As the recording has them."""
    recording, *_ = recorded(shown(tmp_path / "bag", starts(robot), sides=(Side.RIGHT,), namespace="robot1"))
    assert set(recording.points) == {"right"}


def test_an_arm_that_was_told_nothing_in_the_episode_is_left_out(robot, tmp_path):
    """Whatever another episode told it; where both were told, for one arm the other one's gaps do not count."""
    words = (("start", 0.0, 1), ("stop", 1.0, 1), ("start", 1.5, 2), ("stop", 2.5, 2))
    begun = starts(robot)
    bag = shown(tmp_path / "bag", begun, words=words, is_there=lambda side, t_s: side is Side.LEFT or t_s < 0.5)
    assert {side: len(rows) for side, rows in recorded(bag, 2)[0].points.items()} == {"left": 50}
    assert {side: len(rows) for side, rows in recorded(bag, 1)[0].points.items()} == {"left": 25, "right": 25}
    alone, measured, rest_s = recorded(bag, 1, "left")
    assert set(alone.points) == set(measured) == {"left"} and len(alone) == 50 and rest_s == 0.0
    ended = robot.run("replay", str(bag), "--episode", "1", "--arm", "left", "--approach", "--check", "--json")
    assert ended.status == 0 and ended.json["left_out_s"] == 0.0
    ended = robot.run("replay", str(bag), "--episode", "2", "--arm", "right", "--check")
    assert ended.status == 2 and "has no points for the right arm" in ended.err
    nobody = shown(tmp_path / "nobody", begun, words=words, is_there=lambda side, t_s: t_s < 1.2)
    with pytest.raises(Rejected, match="episode 2 has no two points in a row"):
        recorded(nobody, 2)


def test_a_bag_in_which_nobody_told_the_arms_anything_is_refused(robot, tmp_path):
    """With what helps."""
    bag = shown(tmp_path / "bag", starts(robot), sides=())
    with pytest.raises(Rejected, match="has no episode that was not discarded"):
        recorded(bag)
    bag = shown(tmp_path / "words", starts(robot), sides=(), words=WORDS)
    with pytest.raises(Rejected, match="nobody told the arms where to go"):
        recorded(bag)
    ended = robot.run("replay", str(tmp_path / "nothing"))
    assert ended.status == 2 and "there is no" in ended.err


def test_a_picture_shows_it_beside_the_recording(robot, tmp_path, monkeypatch):
    """Of each arm, from the first point to the last; also of one that broke off."""
    pytest.importorskip("matplotlib")
    drawn = []
    monkeypatch.setattr("gateway.cli.motion.replay_plot.write_plot", lambda *given: drawn.append(given))
    bag, file = str(shown(tmp_path / "bag", starts(robot))), tmp_path / "a.png"
    assert robot.run("replay", bag, "--plot", str(file)).status == 0
    robot.world.after(2.0, lambda: os.kill(os.getpid(), signal.SIGINT))
    assert robot.run("replay", bag, "--plot", str(file)).status == 130
    (whole, where), (part, _) = drawn
    assert where == file and set(whole) == {"left", "right"}
    for rows in whole.values():
        assert rows.shape[1] == 15 and rows[0, 0] < 0.3 and rows[-1, 0] > 148 * DT_S - 0.3
        assert rows[:, 1:8] == pytest.approx(rows[:, 8:], abs=0.05)
    assert 0 < len(part["left"]) < len(whole["left"])


def test_a_picture_that_cannot_be_written_is_told(robot, tmp_path, monkeypatch):
    """The replay went well all the same."""
    pytest.importorskip("matplotlib")

    def full(*given):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("gateway.cli.motion.replay_plot.write_plot", full)
    ended = robot.run("replay", str(shown(tmp_path / "bag", starts(robot))), "--plot", str(tmp_path / "a.png"))
    assert ended.status == 0 and "no picture: " in ended.err and "No space left on device" in ended.err


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--plot", "a.txt"], "a.txt cannot be drawn"),
        (["--plot", "no/such/folder/a.png"], "cannot be drawn"),
        (["--plot", "a.png", "--check"], "with --check nothing moves"),
        (["--view", "--check"], "with --check nothing moves"),
    ],
)
def test_what_cannot_be_drawn_is_refused_before_anything_moves(robot, tmp_path, monkeypatch, words, why):
    """With what is in its way."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(replaying, "needed", lambda *_: None)
    ended = robot.run("replay", str(shown(tmp_path / "bag", starts(robot))), *words)
    assert ended.status == 1 and why in ended.err and not len(commanded(robot, Side.LEFT))


WATCHER = """
import os, signal, sys, time
open(sys.argv[1], "w").write(" ".join([str(os.getpid()), *sys.argv[2:]]))
signal.signal(signal.SIGTERM, signal.SIG_IGN if sys.argv[1].endswith("stubborn") else signal.SIG_DFL)
for _ in range(100_000):
    os.write(2, b"a line that nobody reads\\n" * 100)
time.sleep(600.0)
"""


@pytest.mark.parametrize("kind", ["willing", "stubborn"])
def test_a_view_beside_it_begins_before_it_and_ends_with_it(robot, tmp_path, monkeypatch, kind):
    """For the same gateway; what it says fills no pipe, and one that will not end is ended."""
    said, owned = tmp_path / kind, []
    command = [sys.executable, "-c", WATCHER, str(said)]
    monkeypatch.setattr(replaying, "own_module", lambda module, *words: [*command, module, *words])
    monkeypatch.setattr(replaying, "needed", lambda *_: None)
    monkeypatch.setattr(replaying, "END_S", 0.3)
    original = replaying.follow

    def follow(*given):
        owned.append(robot.world.pair.see().lease.owned)
        deadline = time.monotonic() + 30.0
        while not (said.exists() and said.read_text().count(" ") == 4):
            assert time.monotonic() < deadline, "no view"
            time.sleep(0.01)
        return original(*given)

    monkeypatch.setattr(replaying, "follow", follow)
    ended = robot.run("replay", str(shown(tmp_path / "bag", starts(robot))), "--view", "--socket", "/tmp/x.sock")
    assert ended.status == 0 and owned == [False], ended.err
    pid, *words = said.read_text().split()
    assert words == ["gateway.cli", "view", "--socket", "/tmp/x.sock"]
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid), 0)
