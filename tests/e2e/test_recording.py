"""Recordings of a robot that moves: what is in them, and that no recorder ever changes what the robot does."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import shutil
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cdr_types import decode, encode
from cdr_types.keys import topic_to_key
from cdr_types.messages.sensor_msgs import JointState
from cdr_types.messages.std_msgs import Float32, String
from gateway.errors import NotReady
from gateway.recording.bag_check import check
from gateway.recording.bag_reader import Bag
from gateway.recording.bag_writer import ACTIVE
from gateway.recording.episodes import Episode, episodes
from gateway.recording.recovering import recover
from gateway.recording.tap import Tap
from gateway.recording.topics import EVENTS, GATEWAY, recorded_topics
from gateway.robot.topics import FSM_ENABLE, STATE_TOPICS, arm_state
from gateway.settings.settings import LinkSettings
from gateway.values import Side
from tests.e2e.system import ROOT, Process, System, joint_topics, steady, wait_for, worst_gap_ms

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.body_free("what is recorded is the matter, not how the body moves"),
]

Systems = Callable[..., System]
LEFT = arm_state(Side.LEFT)

MOVER = """
with robot.control() as own:
    own.enable(timeout=12.0)
    near = {side: HOME[side] * 0.8 for side in HOME}
    print("driving", flush=True)
    while True:
        for goal in (near, HOME):
            own.move_to(goal, speed=0.5).result(timeout=60.0)
"""


def moving(system: System) -> Process:
    """Return an owner that moves both arms for ever."""
    mover = system.client("mover", MOVER)
    wait_for(lambda: "driving" in mover.text(), "an owner", tell=mover.text)
    return mover


def recording(system: System, folder: Path, *options: str) -> Process:
    """Return a `ta2 record` that writes messages."""
    arguments = ["-m", "gateway.cli", "record", "--socket", system.target, "--out", str(folder), "--json", *options]
    recorder = Process(f"record-{folder.name}", arguments, system.folder)
    active = folder / f"{folder.name}_0.mcap{ACTIVE}"
    wait_for(lambda: active.exists() and active.stat().st_size > 20_000, "a recording", tell=recorder.text)
    return recorder


def all_that_arrive(system: System) -> dict[str, int]:
    """Return how many setpoints the robot got, once none has come for half a second: whoever records has them, too, by then."""
    newest: tuple[float, dict[str, int]] = 0.0, {}

    def are_over() -> bool:
        nonlocal newest
        counts = {topic: system.count(topic) for topic in joint_topics()}
        if counts != newest[1]:
            newest = time.monotonic(), counts
        return time.monotonic() - newest[0] > 0.5

    wait_for(are_over, "the last setpoint", 30.0)
    return newest[1]


def result(recorder: Process) -> dict[str, Any]:
    """Return what it printed at its end."""
    found: dict[str, Any] = json.loads(recorder.text().strip().splitlines()[-1])
    return found


def episodes_so_far(folder: Path, copied: Path) -> tuple[Episode, ...]:
    """Return the episodes that a recorder's end at this moment would leave."""
    shutil.rmtree(copied, ignore_errors=True)
    shutil.copytree(folder, copied)
    recover(copied)
    with Bag(copied) as bag:
        return episodes(bag)


def told(bag: Bag, topic: str) -> list[dict[str, Any]]:
    """Return what the gateway told on a topic."""
    return [json.loads(decode(message.payload, String).data) for message in bag.messages([topic])]


def test_a_recording_holds_what_robot_owner_and_gateway_said(tmp_path: Path, systems: Systems) -> None:
    """Every state at its rate, every setpoint that the robot got, who owned it and what was stopped; fit for use."""
    system = systems(tmp_path, has_guard=False)
    with system.connect("watcher") as watcher:
        recorder = recording(system, tmp_path / "bag", "--task", "wave")
        mover = moving(system)
        wait_for(lambda: min(map(system.count, joint_topics())) > 150, "setpoints", tell=mover.text)
        watcher.stop("enough")
        wait_for(lambda: "STOPPED_BY_OTHER" in watcher.state.latches, "a stop")
        wait_for(system.is_still, "rest")
        mover.end()
        wait_for(lambda: not watcher.state.view.lease.owned, "an end of the lease", 30.0)
        with watcher.control():  # given back, and with it the end of the hold
            pass
        arrived = all_that_arrive(system)
        recorder.send(signal.SIGINT)
        assert recorder.wait() == 0, recorder.text()
    found = result(recorder)
    assert found["ok"] and not found["lost"] and not found["error"], found
    with Bag(tmp_path / "bag") as bag:
        counts = {topic.name: topic.count for topic in bag.topics}
        for topic, count in arrived.items():
            assert abs(counts[topic] - count) <= 2, (topic, counts[topic], count)
        assert all(counts[topic] for topic in STATE_TOPICS)
        assert [facts["owner"] for facts in told(bag, GATEWAY)].count("mover") > 0
        codes = [notice["code"] for notice in told(bag, EVENTS)]
        assert {"LEASE_CHANGED", "LATCH_CHANGED", "STATE_CHANGED"} <= set(codes), codes
        assert bag.facts()["task"] == "wave" and bag.facts()["robot"] == system.endpoint
        checked = check(bag)
        assert checked.ok, checked.findings
        first = next(decode(m.payload, JointState) for m in bag.messages([LEFT]))
        assert len(first.position) == 7


def ta2(system: System, *words: str) -> dict[str, Any]:
    """Return what a command of another process says as JSON."""
    arguments = [sys.executable, "-m", "gateway.cli", *words, "--json"]
    ended = subprocess.run(arguments, cwd=ROOT, capture_output=True, text=True, timeout=60.0, check=False)
    assert ended.returncode == 0, ended.stderr
    said: dict[str, Any] = json.loads(ended.stdout)
    return said


@pytest.mark.sim_only("what is told of episodes is the matter")
def test_episodes_are_told_from_another_process_and_by_a_client(tmp_path: Path, systems: Systems) -> None:
    """Each with task, length and verdict in the bag; the gateway hears nothing of it."""
    system, folder = systems(tmp_path, has_guard=False), tmp_path / "bag"

    def tell(*words: str) -> dict[str, Any]:
        return ta2(system, "episode", *words, "--socket", system.target)

    with system.connect("watcher") as watcher:
        recorder = recording(system, folder, "--task", "wave")
        assert tell("start")["is_running"]
        so_far = system.count(FSM_ENABLE)
        assert tell("mark", "here")["episode"] == 1 and tell("success")["is_running"] is False
        assert watcher.recording.start("lift").task == "lift"
        watcher.recording.stop()
        assert watcher.recording.discard().bag == str(folder) and system.count(FSM_ENABLE) == so_far
        recorder.send(signal.SIGINT)
        assert recorder.wait() == 0, recorder.text()
    with Bag(folder) as bag:
        first, second = episodes(bag)
        assert (first.task, first.outcome, [mark.text for mark in first.marks]) == ("wave", "success", ["here"])
        assert (second.task, second.is_discarded, second.is_finished) == ("lift", True, True)
        assert bag.begin_ns < first.begin_ns < first.end_ns < second.begin_ns < second.end_ns < bag.end_ns
        assert any(bag.messages([LEFT], first.begin_ns, first.end_ns))
    assert [episode["number"] for episode in ta2(system, "bag", "info", str(folder))["episodes"]] == [1, 2]
    assert ta2(system, "bag", "check", str(folder))["ok"]
    assert ta2(system, "bag", "cut", str(folder), "--out", str(tmp_path / "one"), "--episode", "1")["episodes"] == 1
    (found,) = ta2(system, "bag", "info", str(tmp_path / "one"))["episodes"]
    assert (found["task"], found["outcome"], found["end_ns"]) == ("wave", "success", first.end_ns)
    tables = ta2(system, "bag", "export", str(tmp_path / "one"), "--out", str(tmp_path / "csv"))["tables"]
    with Bag(tmp_path / "one") as bag:
        assert {table["topic"]: table["rows"] for table in tables} == {t.name: t.count for t in bag.topics if t.count}


@pytest.mark.sim_only("what is told of episodes is the matter")
def test_an_episode_in_which_the_recorder_was_killed_is_there_unfinished(tmp_path: Path, systems: Systems) -> None:
    """After the recovery; and the next recorder takes the place of the dead one."""
    system, folder = systems(tmp_path, has_guard=False), tmp_path / "bag"
    with system.connect("watcher") as watcher:
        recorder = recording(system, folder)
        watcher.recording.start("wave")
        wait_for(
            lambda: [e.task for e in episodes_so_far(folder, tmp_path / "so-far")] == ["wave"],
            "the episode on the disk",
        )
        recorder.send(signal.SIGKILL)
        recorder.wait()
        with pytest.raises(NotReady, match="no recorder listens"):
            watcher.recording.stop()
        recover(folder)
        with Bag(folder) as bag:
            (episode,) = episodes(bag)
            assert (episode.task, episode.is_finished, episode.end_ns) == ("wave", False, bag.end_ns)
            assert [f.message for f in check(bag).findings if "never stopped" in f.message]
        again = recording(system, tmp_path / "again")
        assert watcher.recording.state().episode == 0
        again.send(signal.SIGINT)
        assert again.wait() == 0, again.text()


@pytest.mark.sim_only("what is told of episodes is the matter")
def test_keys_of_the_terminal_that_records_tell_of_episodes(tmp_path: Path, systems: Systems) -> None:
    """Space, a verdict, q; a person sees what goes on, and the terminal is given back as it was."""
    system, folder = systems(tmp_path, has_guard=False), tmp_path / "bag"
    system.connect("first").close()
    ours, theirs = pty.openpty()
    before = termios.tcgetattr(theirs)

    def take() -> None:
        os.setsid()
        fcntl.ioctl(theirs, termios.TIOCSCTTY, 0)

    arguments = [sys.executable, "-m", "gateway.cli", "record", "--socket", system.target, "--out", str(folder)]
    with (tmp_path / "shown").open("wb") as shown:
        recorder = subprocess.Popen(
            arguments, cwd=ROOT, stdin=theirs, stdout=shown, stderr=shown, preexec_fn=take, pass_fds=[theirs]
        )

    def says(words: str) -> bool:
        return words in (tmp_path / "shown").read_text()

    try:
        wait_for(lambda: says("space start/stop"), "its keys", tell=lambda: (tmp_path / "shown").read_text())
        for keys, words in ((b" ", "episode 1: start"), (b"s", "episode 1: success"), (b"s d", "episode 2: discard")):
            os.write(ours, keys)
            wait_for(lambda words=words: says(words), words)
        os.write(ours, b" q")
        assert recorder.wait(20.0) == 0
        assert termios.tcgetattr(theirs) == before
    finally:
        recorder.kill()
        os.close(ours)
        os.close(theirs)
    with Bag(folder) as bag:
        first, second, third = episodes(bag)
        assert first.outcome == "success" and second.is_discarded and third.is_finished


@pytest.mark.alone
def test_a_recorder_that_stands_still_and_dies_changes_nothing_and_loses_a_second(
    tmp_path: Path, systems: Systems
) -> None:
    """The arms get their setpoints, the gateway its state; what was recorded until then is a bag again."""

    def attempt(folder: Path) -> list[str]:
        system = systems(folder, has_guard=False)
        broken = []
        with system.connect("watcher") as watcher:
            recorder = recording(system, folder / "bag")
            moving(system)
            system.control.ask("reset_stats")
            before = min(map(system.count, joint_topics()))
            recorder.send(signal.SIGSTOP)
            wait_for(lambda: min(map(system.count, joint_topics())) > before + 300, "setpoints meanwhile")
            recorder.send(signal.SIGCONT)
            path = folder / "bag" / f"bag_0.mcap{ACTIVE}"
            for what in ("what had come before it stood still", "what came afterwards"):
                size = path.stat().st_size
                wait_for(lambda size=size: path.stat().st_size > size + 50_000, what)
            killed_ns = watcher.state.view.at_ns
            recorder.send(signal.SIGKILL)
            recorder.wait()
            wait_for(lambda: watcher.state.view.at_ns > killed_ns + 500_000_000, "half a second after its death")
            gap_ms = worst_gap_ms(system.stats())
            if gap_ms >= 100.0:
                broken.append(f"arm gap of {gap_ms} ms at the robot")
            assert watcher.state.state == "ACTIVE"
        system.close()
        found = recover(folder / "bag")
        with Bag(folder / "bag") as bag:
            assert found.messages == bag.message_count > 0 and check(bag).ok
            gaps = [finding for finding in check(bag).findings if "gaps" in finding.message and finding.topic == LEFT]
            assert gaps, "it stood still for seconds"
        return broken

    steady(attempt, tmp_path)


def test_a_recorders_session_can_publish_nothing(tmp_path: Path, systems: Systems) -> None:
    """Whatever becomes of the process: its access control lets no put leave, and the robot hears none."""
    system = systems(tmp_path, has_guard=False)
    system.connect("first").close()
    settings = LinkSettings(endpoint=system.endpoint)
    heard: list[int] = []
    tap = Tap(settings, recorded_topics(settings), lambda number, at_ns, payload: heard.append(number))
    tap.open()
    try:
        wait_for(lambda: len(set(heard)) >= len(STATE_TOPICS) - 1, "its states")
        before, session = system.count(FSM_ENABLE), tap._session
        assert tap.is_open and session is not None
        for _ in range(20):
            session.put(topic_to_key(FSM_ENABLE), encode(Float32(data=1.0)))
        so_far = len(heard)
        wait_for(lambda: len(heard) > so_far + 500, "more states")
        assert system.count(FSM_ENABLE) == before and system.robot_state()["fsm"] == 0
    finally:
        tap.close()


def test_without_a_robot_nothing_is_left_behind(tmp_path: Path) -> None:
    """It waits for ten seconds, says what helps, and takes its empty folder away."""
    arguments = ["-m", "gateway.cli", "record", "--robot", "127.0.0.1:9", "--out", str(tmp_path / "bag")]
    recorder = Process("record", arguments, tmp_path)
    assert recorder.wait() != 0
    assert "nothing came from the robot" in recorder.text() and not (tmp_path / "bag").exists()
