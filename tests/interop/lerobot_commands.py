"""Stock commands of LeRobot on simulated robots, by the plugin; run by `bin/interop lerobot` with LeRobot's programs.

A leader that a program moves, and a follower with cameras: `lerobot-teleoperate`, `lerobot-record` (two episodes),
`lerobot-replay`. Where the follower's joints truly are is asked of the simulated robot. The recorded set is judged as
`ta2 dataset check` does, and stays for LeRobot's loader.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.parquet as pq

from gateway.dataset.checking import check_dataset
from gateway.dataset.lerobot_reader import Dataset
from tests.e2e.system import System, free_port, wait_for

FPS = 10
EPISODES = 2
EPISODE_S = 4
ATTEMPTS = 3
"""A busy machine of few cores stands still, and then the robot rightly pauses, or no picture comes: it is tried again."""
JOINTS = [*range(7), *range(8, 15)]
"""Of the 16 dims."""
LAG_RAD = 0.15
"""A follower is some 0.2 s behind a leader that swings at up to 0.3 rad/s. Judged where LeRobot's loop keeps its rate: with
pictures, on a few busy cores, one of its periods may last for a second."""
SWUNG = [0, 4, 7, 11]
"""Of the 14 joints, those that swing."""
REACHED_RAD = 0.02
SWING = """
from gateway.errors import GatewayError
while True:
    try:
        with robot.control(take="to lead") as own:
            own.enable()
            own.left_gripper.set(0.6)
            own.move_to(HOME, speed=0.5).result(timeout=30)
            print("there", flush=True)
            began = time.monotonic()
            with own.left_arm.stream(rate_hz=50) as left, own.right_arm.stream(rate_hz=50) as right:
                while True:
                    away = 0.3 * np.array([1, 0, 0, 0, 1, 0, 0]) * np.sin(time.monotonic() - began)
                    left.set(HOME["left"] + away)
                    right.set(HOME["right"] - away)
                    left.tick()
    except GatewayError as error:
        print(error, flush=True)
        time.sleep(0.5)
"""
"""Of the leader: both arms swing about the initial position, the left gripper closes; after a stall, again."""


def run(program: Path, *words: str) -> str:
    """Run a command of LeRobot behind robots and gateways; return what went wrong, empty when nothing did."""
    began_s = time.monotonic()
    words = ("nice", "-n", "10", str(program), *words)
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    text = done.stdout + done.stderr
    late = text.count("Record loop is running slower")
    state = f"status {done.returncode}, {time.monotonic() - began_s:.0f} s" + (f", {late} periods late" if late else "")
    print(f"{program.name}: {state}", flush=True)
    return text if done.returncode else ""


def columns(folder: Path, episode: int) -> tuple[Any, Any]:
    """Return state and action of an episode, shape (rows, 16) each."""
    table = pa.concat_tables([pq.read_table(path) for path in sorted((folder / "data").rglob("*.parquet"))])
    table = table.filter(pa.compute.equal(table["episode_index"], episode))
    return np.array(table["observation.state"].to_pylist()), np.array(table["action"].to_pylist())


def teleoperate(programs: Path, robot: list[str], teleop: list[str], leader: System, follower: System) -> None:
    """The follower comes to where the leader is, with its grip."""
    far = np.abs(np.array(leader.arm_q()) - np.array(follower.arm_q())).max()
    failed = run(programs / "lerobot-teleoperate", *robot, *teleop, f"--fps={FPS}", "--teleop_time_s=6")
    assert not failed, failed[-6000:]
    apart = np.delete(np.abs(np.array(leader.arm_q()) - np.array(follower.arm_q())), SWUNG).max()
    print(f"  joints that do not swing were up to {far:.2f} rad apart before, {apart:.4f} after")
    assert far > 0.2 and apart < REACHED_RAD


def amiss(place: Path, bound_rad: float) -> str:
    """Return in what an episode is not what the leader did; empty when they all are."""
    for episode in range(EPISODES):
        state, action = (rows[:, JOINTS] for rows in columns(place, episode))
        lag = np.abs(state - action)[FPS:].max(initial=0.0)  # after a second to get there
        swing = np.ptp(action, axis=0)[SWUNG].min()
        told = f"episode {episode}: {len(state)} rows, joints swing by {swing:.2f} rad, at most {lag:.3f} rad behind"
        print(f"  {told}")
        if not (len(state) > 2 * FPS and swing > 0.2 and lag < bound_rad):
            return told
    return ""


def record(programs: Path, words: list[str], camera: list[str], folder: Path) -> Path:
    """Record episodes in which the follower does as the leader; return the set's folder."""
    for attempt in range(ATTEMPTS):
        place = folder / f"recorded{attempt}"
        is_last = attempt + 1 == ATTEMPTS
        print("  without a camera, as a last attempt" if is_last else "  with a camera")
        seen, bound_rad = ([], LAG_RAD) if is_last else (camera, np.inf)
        wrong = run(programs / "lerobot-record", *words, *seen, f"--dataset.root={place}") or amiss(place, bound_rad)
        if not wrong:
            break
        print(f"  {wrong.splitlines()[-1]}")
    assert not wrong, wrong[-6000:]
    checked = check_dataset(Dataset(place))
    for finding in checked.findings:
        print(f"  {finding.level} {finding.where}: {finding.message}")
    print(f"  ta2 dataset check: {checked.rows} rows, {'fit' if checked.ok else 'not fit'} for training")
    assert checked.ok and checked.episodes == EPISODES
    return place


def replay(programs: Path, robot: list[str], place: Path, follower: System) -> None:
    """The follower ends where the episode did."""
    words = [f"--dataset.root={place}", "--dataset.repo_id=teleavatar/recorded", "--dataset.episode=0"]
    failed = run(programs / "lerobot-replay", *robot, *words, "--play_sounds=false")
    assert not failed, failed[-6000:]
    _, action = columns(place, 0)
    apart = np.abs(np.array(follower.arm_q()) - action[-1, JOINTS]).max()
    print(f"  ended {apart:.4f} rad from the episode's last action")
    assert apart < LAG_RAD


def main(programs: Path, folder: Path) -> int:
    """Run them; return the exit status. The last line is the folder of the recorded set."""
    for name in ("leader", "follower"):
        (folder / name).mkdir(parents=True)
    port = free_port()
    leader = System(folder / "leader", has_guard=False)
    follower = System(folder / "follower", has_guard=False, sim_options=("--camera-to", f"127.0.0.1:{port}"))
    robot = [
        "--robot.type=teleavatar",
        f"--robot.gateway={follower.target}",
        "--robot.id=follower",
        "--robot.patience_s=5",
    ]
    teleop = ["--teleop.type=teleavatar_leader", f"--teleop.gateway={leader.target}", "--teleop.id=leader"]
    camera = ["--robot.video=127.0.0.1", f"--robot.video_port={port}", "--robot.views={head_camera: head_left_eye}"]
    words = [f"--dataset.fps={FPS}", f"--dataset.num_episodes={EPISODES}", f"--dataset.episode_time_s={EPISODE_S}"]
    words += ["--dataset.repo_id=teleavatar/recorded", "--dataset.no_stamp=true", "--dataset.push_to_hub=false"]
    words += ["--dataset.single_task=swing both arms", "--dataset.reset_time_s=1", "--play_sounds=false"]
    words += ["--dataset.rgb_encoder.vcodec=h264", "--dataset.rgb_encoder.preset=ultrafast"]
    try:
        leader.connect().close()
        follower.connect().close()
        swing = leader.client("swing", SWING)
        wait_for(lambda: "there" in swing.text(), "the leader", 60.0, swing.text)
        teleoperate(programs, robot, teleop, leader, follower)
        place = record(programs, [*robot, *teleop, *words], [*camera, "--robot.resize=224"], folder)
        swing.end()
        replay(programs, robot, place, follower)
    finally:
        leader.close()
        follower.close()
    print(place)
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
