"""From a demonstration to a policy on the robot: recorded with pictures, made a dataset, and played back by a policy server."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.dataset.lerobot_reader import Dataset, EpisodeRead
from gateway.recording.bag_writer import ACTIVE
from gateway.robot.vector_layout import STATE_NAMES
from tests.e2e.system import Process, System, wait_for
from tests.policy.server import Scripted
from tests.video.stage import free_udp_port, sending

pytestmark = pytest.mark.e2e

Systems = Callable[..., System]
EPISODES = 5
FPS = 45.0
STEPS = 40
POLICY = [*range(7), 39, *range(8, 15), 47]
"""What a policy says of the 72 dimensions: joints, and the torque of the gripper, of each side."""
MAP = """
[observation]
state = 48
[actions]
columns = ["left_arm", "left_gripper_effort", "right_arm", "right_gripper_effort"]
"""
TELEOPERATOR = """
from gateway.errors import Aborted, Stale
def go(goal, speed):
    for attempt in range(20):
        try:
            if attempt:
                own.enable(timeout=12.0)
            return own.move_to(goal, speed=speed).result(timeout=60.0)
        except (Aborted, Stale):  # the machine stood still
            time.sleep(0.3)
with robot.control() as own:
    own.enable(timeout=12.0)
    near = {side: HOME[side] * 0.85 for side in HOME}
    go(HOME, 0.5)
    for number in range(5):
        robot.recording.start("reach" if number % 2 else "reach there and back")
        own.left_gripper.set(0.3 + 0.1 * number)
        for goal in (near, HOME):
            go(goal, 0.4 + 0.1 * number)
        robot.recording.failure() if number == 3 else robot.recording.success()
    print("shown", flush=True)
"""


class Played:
    """A policy that says what an episode's actions were, by the clock of its second question."""

    def __init__(self, episode: EpisodeRead) -> None:
        self.rows = episode.columns["action"][:, POLICY].astype(np.float64)
        self.asked = 0
        self.began_s = 0.0

    def at(self, time_s: float) -> np.ndarray[Any, Any]:
        """Return the actions at a time of the monotonic clock."""
        place = float(np.clip((time_s - self.began_s) * FPS, 0.0, len(self.rows) - 1.0))
        before = int(place)
        after = min(before + 1, len(self.rows) - 1)
        row: np.ndarray[Any, Any] = self.rows[before] + (place - before) * (self.rows[after] - self.rows[before])
        return row

    @property
    def is_over(self) -> bool:
        """Whether all of it has been said."""
        return self.asked > 2 and (time.monotonic() - self.began_s) * FPS > len(self.rows)

    def __call__(self, observation: Any) -> dict[str, Any]:
        del observation
        now_s = time.monotonic()
        self.asked += 1
        if self.asked <= 2:
            self.began_s = now_s
        return {"actions": np.array([self.at(now_s + step / FPS) for step in range(STEPS)], np.float32)}


def shown(system: System, folder: Path) -> Path:
    """Return a bag of five episodes with pictures."""
    port = free_udp_port()
    words = ["-m", "gateway.cli", "record", "--socket", system.target, "--out", str(folder), "--json"]
    with sending(port):
        recorder = Process("recorder", [*words, "--video", "--video-port", str(port)], system.folder)
        system.clients.append(recorder)
        active = folder / f"{folder.name}_0.mcap{ACTIVE}"
        wait_for(lambda: active.exists() and active.stat().st_size > 20_000, "a recording", tell=recorder.text)
        teleoperator = system.client("teleoperator", TELEOPERATOR)
        wait_for(lambda: "shown" in teleoperator.text(), "five episodes", 120.0, teleoperator.text)
        recorder.end()
    wait_for(lambda: '"ok": true' in recorder.text(), "the end of the recording", tell=recorder.text)
    return folder


def done(*words: str) -> dict[str, Any]:
    """Carry out a command of `ta2`, and return what it says."""
    ended = subprocess.run(
        [sys.executable, "-m", "gateway.cli", *words, "--json"], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, (words, ended.stdout, ended.stderr)
    found: dict[str, Any] = json.loads(ended.stdout)
    return found


@pytest.mark.alone
@pytest.mark.thorough
@pytest.mark.wire_free("what a recording holds behind a real bridge is tests/e2e/test_recording.py's")
def test_what_was_shown_is_learnt_from_and_played_back(systems: Systems, tmp_path: Path) -> None:
    """Five episodes, judged; both formats, checked; a policy that says what was done moves both arms the same way again."""
    system = systems(tmp_path, has_guard=False)
    robot = system.connect("watcher")
    bag = shown(system, tmp_path / "bag")
    done("bag", "check", str(bag))
    for version in ("v2.1", "v3.0"):
        folder = str(tmp_path / version)
        built = done("dataset", "build", str(bag), "--out", folder, "--format", version, "--success-only")
        assert built["episodes"] == EPISODES - 1 and built["tasks"] == ["reach there and back", "reach"], built
        assert built["left_out"]["episode not judged a success"] == 1
        done("dataset", "check", folder)
    old, new = (list(Dataset(tmp_path / version).episodes()) for version in ("v2.1", "v3.0"))
    assert all(
        np.array_equal(one.columns["action"], other.columns["action"]) for one, other in zip(old, new, strict=True)
    )
    assert len(Dataset(tmp_path / "v2.1").cameras) == 3

    episode = old[0]
    state = dict(zip(STATE_NAMES, episode.columns["observation.state"].T, strict=True))
    action = dict(zip(STATE_NAMES, episode.columns["action"].T, strict=True))
    names = [f"{side}_joint{n}_position" for side in ("left", "right") for n in range(1, 8)]
    assert max(float(np.ptp(action[name])) for name in names) > 0.1
    late = 5  # rows that an arm is behind what it was told
    lag_rad = max(float(np.abs(state[name][late:] - action[name][:-late]).max()) for name in names)
    assert lag_rad < 0.1, f"{lag_rad} rad between what was commanded and measured"

    layout = tmp_path / "map.toml"
    layout.write_text(MAP)
    policy = Played(episode)
    server = Scripted(policy, {"fps": FPS})
    try:
        words = ["--server", server.url, "--map", str(layout), "--socket", system.target, "--approach", "--json"]
        player = Process("policy", ["-m", "gateway.cli", "policy", "run", *words, "--take", "begin"], system.folder)
        system.clients.append(player)
        wait_for(lambda: policy.asked > 2, "a policy that is played", 60.0, player.text)
        off_rad: list[float] = []
        for seen in robot.states(max_rate=50.0):
            wanted = policy.at(time.monotonic())
            measured = np.concatenate([seen.left_arm.q, [wanted[7]], seen.right_arm.q, [wanted[15]]])
            off_rad.append(float(np.abs(measured - wanted).max()))
            if policy.is_over:
                break
        player.end()
    finally:
        server.close()
    told = next(json.loads(line) for line in reversed(player.text().splitlines()) if line.startswith("{"))
    assert told["refused"] == told["underruns"] == 0, told  # what was smooth when it was shown is smooth in the dataset
    assert len(off_rad) > 100 and max(off_rad) < 0.12, f"{max(off_rad)} rad off{player.text()}"
