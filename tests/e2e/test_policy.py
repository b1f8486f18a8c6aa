"""Policies played end to end: a server's chunks move both arms as it says, and its death leaves them held."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdr_types import decode
from cdr_types.messages.std_msgs import String
from gateway.recording.bag_reader import Bag
from gateway.recording.topics import POLICY
from tests.e2e.system import Process, System, wait_for
from tests.policy.server import Scripted

pytestmark = [pytest.mark.e2e, pytest.mark.sim_only("how chunks are played is the matter, not how the body moves")]

Systems = Callable[..., System]
HZ = 30.0
STEPS = 30
SWING_RAD = 0.15
RATE = 0.8
"""Of the swing [rad/s of its phase]."""
MAP = """
[observation]
state = 48
[actions]
columns = ["left_arm", "left_gripper_effort", "right_arm", "right_gripper_effort"]
"""


class Swing:
    """A policy that swings joints 1 and 6 of both arms from where they are first seen, beginning with the second question."""

    def __init__(self) -> None:
        self.asked = 0
        self.start: np.ndarray[Any, Any] = np.zeros(0)
        self.began_s = 0.0

    def at(self, time_s: float) -> np.ndarray[Any, Any]:
        """Return a row of actions at a time of the monotonic clock."""
        row = self.start.copy()
        away = SWING_RAD * (1.0 - np.cos(RATE * max(0.0, time_s - self.began_s))) / 2.0
        row[[0, 5]] += away
        row[[8, 13]] -= away
        return row

    def __call__(self, observation: Any) -> dict[str, Any]:
        now_s = time.monotonic()
        self.asked += 1
        if self.asked == 1:
            state = observation["observation/state"]
            self.start = np.concatenate([state[0:7], [-0.8], state[8:15], [-0.8]]).astype(np.float64)
        if self.asked <= 2:
            self.began_s = now_s
        rows = [self.at(now_s + step / HZ) for step in range(STEPS)]
        return {"actions": np.array(rows, np.float32), "policy_timing": {"infer_ms": np.float64(1.0)}}


@pytest.fixture
def served() -> Iterator[tuple[Swing, Scripted]]:
    """Return a policy and its server."""
    swing = Swing()
    server = Scripted(swing)
    yield swing, server
    server.close()


def playing(system: System, url: str, *options: str, layout: str = MAP, by: str = "--server") -> Process:
    """Return a `ta2 policy run`."""
    file = system.folder / "map.toml"
    file.write_text(layout)
    words = [by, url, "--map", str(file), "--socket", system.target, "--json", "--take", "begin", *options]
    process = Process("policy", ["-m", "gateway.cli", "policy", "run", *words], system.folder)
    system.clients.append(process)
    return process


def result(process: Process) -> dict[str, Any]:
    """Return what it printed at its end."""
    found: dict[str, Any] = next(
        json.loads(line) for line in reversed(process.text().splitlines()) if line.startswith("{")
    )
    return found


@pytest.mark.alone
def test_both_arms_follow_a_policys_path_and_are_held_when_its_server_dies(
    systems: Systems, tmp_path: Path, served: tuple[Swing, Scripted]
) -> None:
    """Within 0.03 rad of where it says, chunk after chunk, grippers with it; then no jump, held, and status 3."""
    system, (swing, server) = systems(tmp_path, has_guard=False), served
    robot = system.connect("watcher")
    wait_for(lambda: robot.state.left_arm.is_known and robot.state.right_arm.is_known, "both arms")
    policy = playing(system, server.url, "--patience", "1")
    wait_for(lambda: swing.asked > 4, "a policy that is played", tell=policy.text)
    system.control.ask("reset_stats")
    off_rad: list[float] = []
    until_s = time.monotonic() + 5.0
    for state in robot.states(max_rate=50.0):
        wanted = swing.at(time.monotonic())
        refs = np.concatenate([state.left_arm.q_ref, [wanted[7]], state.right_arm.q_ref, [wanted[15]]])
        off_rad.append(float(np.abs(refs - wanted).max()))
        if time.monotonic() > until_s:
            break
    assert max(off_rad) < 0.03, f"{max(off_rad)} rad off{policy.text()}"
    assert robot.state.grip("left").input_ratio == pytest.approx(0.55, abs=0.01)
    server.close()
    assert policy.wait() == 3, policy.text()
    told = result(policy)
    assert not told["ok"] and told["error"]["code"] == "DISCONNECTED" and told["exit_status"] == 3
    assert told["chunks"] >= 8 and told["refused"] == 0 and told["underruns"] == 1 and told["lost"] == 1
    assert told["hz"] == HZ and told["hz_from"] == "as the server says"
    wait_for(system.is_still, "arms at rest")
    assert robot.state.state in ("HOLDING", "ACTIVE")
    held = np.array(robot.state.left_arm.q_ref)
    assert abs(held[0] - swing.start[0]) < 1.05 * SWING_RAD
    for arm in system.stats()["arms"].values():
        commanded = arm["commanded"]
        assert max(commanded["peak_step_rad"]) <= 0.0101 and max(commanded["peak_radps2"]) <= 3.0 * 1.05
        assert arm["clips"] == 0


def test_dry_moves_nothing_and_ctrl_c_leaves_arms_held(
    systems: Systems, tmp_path: Path, served: tuple[Swing, Scripted]
) -> None:
    """--dry tells what each chunk asks for and owns nothing; Ctrl-C ends a run with its figures and status 130."""
    system, (swing, server) = systems(tmp_path, has_guard=False), served
    robot = system.connect("watcher")
    wait_for(lambda: robot.state.left_arm.is_known and robot.state.right_arm.is_known, "both arms")
    dry = playing(system, server.url, "--dry", "--seconds", "1.5")
    assert dry.wait(40.0) == 0, dry.text()
    told = result(dry)
    assert told["ok"] and told["dry"] and told["steps"] == STEPS and told["chunks"] >= 2 and told["over_speed"] == 0
    assert told["first_step_rad"] < 0.1 and len(told["range"]["left_arm"][0]) == 7 and told["would_refuse"] == 0
    assert system.count("/api/left_arm/joint_cmd") == 0 and not robot.state.lease.owned
    dry.log.unlink()
    swing.asked = 0
    policy = playing(system, server.url)
    wait_for(lambda: swing.asked > 3, "a policy that is played", tell=policy.text)
    policy.send(signal.SIGINT)
    assert policy.wait() == 130, policy.text()
    told = result(policy)
    assert told["chunks"] >= 1 and "the arms are held" in policy.text()
    wait_for(system.is_still, "arms at rest")


def is_gone(pid: int) -> bool:
    """Return whether a process has ended, whoever has to reap it."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
    except FileNotFoundError:
        return True


def local(system: System, policy: str, *options: str) -> tuple[Process, Path]:
    """Return a `ta2 policy run` of one of `tests.policy.local_policies`, and the file for its process id."""
    told = system.folder / "policy.pid"
    name = f"tests.policy.local_policies:{policy}"
    return playing(system, name, "--prompt", str(told), *options, by="--local"), told


@pytest.mark.parametrize(
    ("policy", "options", "said"),
    [
        pytest.param("hangs", ("--timeout", "1"), "TIMEOUT: the local policy", marks=pytest.mark.thorough),
        ("dies", (), "DISCONNECTED: the local policy"),
        pytest.param("fails", (), "POLICY_FAILED: the local policy", marks=pytest.mark.thorough),
    ],
)
def test_a_local_policy_that_fails_leaves_the_arms_held(
    systems: Systems, tmp_path: Path, policy: str, options: tuple[str, ...], said: str
) -> None:
    """By the rules of a silent, a lost and a wrong server: borne, borne, and the end; gateway and arms are none the worse."""
    system = systems(tmp_path, has_guard=False)
    robot = system.connect("watcher")
    wait_for(lambda: robot.state.left_arm.is_known and robot.state.right_arm.is_known, "both arms")
    process, told_id = local(system, policy, *options)
    wait_for(lambda: said in process.text(), "a failure that is told", 60.0, process.text)
    if policy == "fails":
        assert process.wait(60.0) == 1, process.text()
        assert result(process)["error"]["code"] == "POLICY_FAILED"
    else:
        wait_for(lambda: "the policy plays again" in process.text(), "a process that is begun anew", 60.0, process.text)
        process.send(signal.SIGINT)
        assert process.wait(60.0) == 130, process.text()
        assert result(process)["lost"] >= 1
    if policy == "hangs":
        wait_for(lambda: is_gone(int(told_id.read_text())), "the end of the policy's process")
    wait_for(system.is_still, "arms at rest")
    assert robot.state.state in ("HOLDING", "ACTIVE") and not robot.state.latches


def test_a_local_policy_ends_with_a_run_that_is_killed(systems: Systems, tmp_path: Path) -> None:
    """By SIGKILL, in the midst of an answer that never comes; the gateway holds the arms."""
    system = systems(tmp_path, has_guard=False)
    robot = system.connect("watcher")
    wait_for(lambda: robot.state.left_arm.is_known and robot.state.right_arm.is_known, "both arms")
    process, told_id = local(system, "hangs", "--timeout", "60")
    wait_for(told_id.exists, "a policy that hangs", tell=process.text)
    pid = int(told_id.read_text())
    assert not is_gone(pid)
    process.send(signal.SIGKILL)
    process.wait()
    wait_for(lambda: is_gone(pid), "the end of the policy's process")
    wait_for(lambda: robot.state.state == "HOLDING", "arms that are held")


@pytest.mark.alone
@pytest.mark.thorough
def test_a_shadow_compares_with_whoever_drives_and_is_recorded(
    systems: Systems, tmp_path: Path, served: tuple[Swing, Scripted]
) -> None:
    """It owns nothing and sends nothing while somebody else moves the arms; its chunks lie in the bag of whoever records."""
    system, (_, server) = systems(tmp_path, has_guard=False), served
    robot = system.connect("driver")
    wait_for(lambda: robot.state.left_arm.is_known and robot.state.right_arm.is_known, "both arms")
    bag, picture = tmp_path / "bag", tmp_path / "shadow.svg"
    words = ["record", "--out", str(bag), "--socket", system.target, "--json"]
    recorder = Process("recorder", ["-m", "gateway.cli", *words], system.folder)
    system.clients.append(recorder)
    wait_for(lambda: Path(f"{system.target}.recorder").exists(), "a recorder", tell=recorder.text)
    plotted = ("--plot", str(picture)) if find_spec("matplotlib") else ()
    shadow = playing(system, server.url, "--shadow", "--seconds", "4", *plotted)
    owners = set()
    with robot.control() as own:
        own.enable(timeout=15.0)
        start = np.array(robot.state.left_arm.q)
        way = 0.1 * np.eye(7)[3]
        while shadow.is_running:
            own.left_arm.move_to(start + way).result()
            owners.add(robot.state.lease.name)
            way = 0.1 * np.eye(7)[3] - way
    assert shadow.wait() == 0, shadow.text()
    assert owners == {"driver"}
    told = result(shadow)
    assert told["ok"] and told["shadow"] and told["chunks"] >= 2 and "would_refuse" not in told
    left = told["differences"]["left"]
    assert left["measured"]["rows"] > 10 and 0.01 < left["measured"]["rms_rad"] < 0.5
    assert left["commanded"]["rows"] > 10 and left["commanded"]["worst_rad"] >= left["commanded"]["rms_rad"]
    assert picture.exists() == bool(plotted)
    recorder.send(signal.SIGINT)
    assert recorder.wait() == 0, recorder.text()
    with Bag(bag) as opened:
        noted = [json.loads(decode(row.payload, String).data) for row in opened.messages([POLICY])]
    chunks = [facts for facts in noted if facts["event"] == "chunk"]
    assert {facts["mode"] for facts in noted} == {"shadow"} and {facts["verdict"] for facts in chunks} == {"NOT_PLAYED"}
    assert abs(len(chunks) - told["chunks"]) <= 1 and np.shape(chunks[0]["arms"]["left"]) == (STEPS, 7)
    assert all(facts["steps_played"] == 0 for facts in noted if facts["event"] == "end")
