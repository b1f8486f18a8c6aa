"""Stock commands of LeRobot on simulated robots, by the plugin; run by `bin/interop lerobot`, with the folder of LeRobot's programs.

A leader that a program moves, and a follower with cameras: `lerobot-teleoperate`, `lerobot-record` (two episodes),
`lerobot-replay`. Where the follower's joints truly are is asked of the simulated robot; the recorded set stays for `lerobot_load`
and `ta2 dataset check`.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.parquet as pq

from tests.e2e.system import System, free_port, wait_for

FPS = 30
EPISODE_S = 4
NEAR_RAD = 0.1
"""A follower lags behind a leader that swings at 0.3 rad/s by some 0.2 s."""
REACHED_RAD = 0.02
"""At rest it is where it was told."""
SWING = """
own = robot.control().acquire()
own.enable()
own.move_to(HOME, speed=0.5).result(timeout=30)
print("there", flush=True)
began = time.monotonic()
with own.left_arm.stream(rate_hz=50) as left, own.right_arm.stream(rate_hz=50) as right:
    own.left_gripper.set(0.6)
    while True:
        away = 0.3 * np.array([0, 0, 0, 0, 1, 0, -1]) * np.sin(time.monotonic() - began)
        left.set(HOME["left"] + away)
        right.set(HOME["right"] - away)
        left.tick()
"""
"""Of the leader: both arms swing about the initial position, the left gripper closes."""


def run(program: Path, *words: str) -> str:
    """Run a command of LeRobot; return what it wrote."""
    name = program.name
    began = time.monotonic()
    done = subprocess.run(["nice", "-n", "10", program, *words], capture_output=True, text=True, timeout=300, check=False)
    text = done.stdout + done.stderr
    assert done.returncode == 0, f"{name}: status {done.returncode}\n{text[-6000:]}"
    print(f"{name}: {time.monotonic() - began:.0f} s")
    return text


def apart_rad(one: System, other: System) -> float:
    """Return how far the joints of two robots are from each other, at most [rad]."""
    return float(np.abs(np.array(one.arm_q()) - np.array(other.arm_q())).max())


def columns(folder: Path, episode: int) -> tuple[Any, Any]:
    """Return state and action of an episode, shape (rows, 16) each."""
    table = pa.concat_tables([pq.read_table(path) for path in sorted((folder / "data").rglob("*.parquet"))])
    table = table.filter(pa.compute.equal(table["episode_index"], episode))
    return np.array(table["observation.state"].to_pylist()), np.array(table["action"].to_pylist())


def main(programs: Path, folder: Path) -> int:
    """Run them; return the exit status."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "leader").mkdir()
    (folder / "follower").mkdir()
    port = free_port()
    leader = System(folder / "leader", has_guard=False)
    follower = System(folder / "follower", has_guard=False, sim_options=("--camera-to", f"127.0.0.1:{port}"))
    robot = ["--robot.type=teleavatar", f"--robot.gateway={follower.target}", "--robot.id=follower"]
    teleop = ["--teleop.type=teleavatar_leader", f"--teleop.gateway={leader.target}", "--teleop.id=leader"]
    dataset = [f"--dataset.root={folder / 'recorded'}", "--dataset.repo_id=teleavatar/recorded"]
    try:
        leader.connect().close()
        follower.connect().close()
        swing = leader.client("swing", SWING)
        wait_for(lambda: "there" in swing.text(), "the leader", 60.0, swing.text)

        run(programs / "lerobot-teleoperate", *robot, *teleop, f"--fps={FPS}", "--teleop_time_s=6")
        grip = follower.robot_state()
        print(f"after teleoperating: {apart_rad(leader, follower):.3f} rad apart; {sorted(grip)}")

        text = run(
            programs / "lerobot-record",
            *robot,
            "--robot.video=127.0.0.1",
            f"--robot.video_port={port}",
            "--robot.views={head_camera: head_left_eye}",
            "--robot.resize=224",
            *teleop,
            *dataset,
            f"--dataset.fps={FPS}",
            "--dataset.num_episodes=2",
            f"--dataset.episode_time_s={EPISODE_S}",
            "--dataset.reset_time_s=1",
            "--dataset.single_task=swing both arms",
            "--dataset.push_to_hub=false",
            "--dataset.no_stamp=true",
            "--dataset.rgb_encoder.vcodec=h264",
            "--dataset.rgb_encoder.preset=ultrafast",
            "--play_sounds=false",
        )
        print("\n".join(line for line in text.splitlines() if "slower" in line or "held" in line or "no new" in line)[-2000:])
        swing.end()
        info = json.loads((folder / "recorded/meta/info.json").read_text())
        for episode in range(2):
            state, action = columns(folder / "recorded", episode)
            print(f"episode {episode}: {len(state)} rows, worst state-action {np.abs(state - action)[:, [*range(7), *range(8, 15)]].max(axis=0).round(3)}")
        run(programs / "lerobot-replay", *robot, *dataset, "--dataset.episode=0", "--play_sounds=false")
        _, action = columns(folder / "recorded", 0)
        q = np.array(follower.arm_q())
        print(f"after replaying: {np.abs(q - action[-1, [*range(7), *range(8, 15)]]).max():.3f} rad from the last action; {info['total_frames']} rows")
    finally:
        leader.close()
        follower.close()
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
