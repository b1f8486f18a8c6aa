"""Action chunks and recordings end to end: replaced while both arms move, and followed from a file in the shell."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gateway.client import Control
from gateway.errors import Stale
from tests.e2e.system import System, wait_for
from tests.thoroughness import IS_THOROUGH

pytestmark = pytest.mark.e2e

SPEED_RADPS = 0.12
PERIOD_S = 1.0 / 30.0
COUNT = 40
RUN_S = 5.0
STALLED = {
    "STATE_STALE",
    "PART_STALE",
    "PART_LOST",
    "NO_LINK",
    "TICK_LATE",
    "TIMEOUT",
    "STREAM_ENDED",
    "LEASE_LOST",
    "CLIENT_LOST",
}
"""How the gateway rightly ends a motion on a machine that stood still for a moment."""


def enabled(own: Control) -> bool:
    """Enable; a busy machine may have let the robot's state grow old just now."""
    try:
        own.enable(timeout=15.0)
    except Stale:
        return False
    return True


@pytest.mark.alone
def test_chunks_replaced_several_times_a_second_keep_the_arms_moving_inside_every_limit(
    systems: Callable[..., System], tmp_path: Path
) -> None:
    """As a policy sends them: worked out from an observation, 50 to 150 ms late, jittered, open at the end, overlapping.

    At the robot no setpoint steps over a limit; between chunks the references never stop, and never turn back.
    """
    system = systems(tmp_path)
    robot = system.connect("policy")
    rng = np.random.default_rng(7)
    speeds: list[float] = []
    with robot.control() as own:
        wait_for(lambda: enabled(own), "the robot enabled")
        state = robot.state
        held = {"left": np.array(state.left_arm.q_ref), "right": np.array(state.right_arm.q_ref)}
        system.control.ask("reset_stats")
        began_s = time.monotonic()
        handles = []
        while (observed_s := time.monotonic()) - began_s < RUN_S:
            times_s = observed_s - began_s + PERIOD_S * np.arange(COUNT)
            way = SPEED_RADPS * (times_s - 0.5 * np.tanh(times_s / 0.5))
            chunk = {side: np.tile(q, (COUNT, 1)) for side, q in held.items()}
            for side, points in chunk.items():
                points[:, 0] += (1.0 if side == "left" else -1.0) * way
                points[:, :6] += rng.normal(0.0, 3e-4, (COUNT, 6))
            until_s = observed_s + rng.uniform(0.05, 0.15)
            while time.monotonic() < until_s:
                time.sleep(0.01)
                if observed_s - began_s > 1.5:
                    speeds.append(float(robot.state.left_arm.dq_ref[0]))
            handles.append(own.follow(chunk, PERIOD_S, start_at=observed_s, open_end=True, smoothing=0.15))
        assert len(handles) >= 10 and sum(handle.skipped for handle in handles) > len(handles)
        wait_for(lambda: handles[-1].done, "the end of the last chunk")
        assert {handle.state for handle in handles[:-1]} == {"superseded"}
        assert robot.state.motions[-1].code == "UNDERRUN"
        wait_for(lambda: not any(robot.state.left_arm.dq_ref), "the standstill")
        travelled = robot.state.left_arm.q_ref[0] - held["left"][0]
    assert travelled > 0.8 * SPEED_RADPS * RUN_S
    assert min(speeds) > 0.3 * SPEED_RADPS, "the reference stopped or turned back between two chunks"
    for arm in system.stats()["arms"].values():
        commanded = arm["commanded"]
        assert max(commanded["peak_radps"]) <= 1.0 * 1.01 and max(commanded["peak_radps2"]) <= 3.0 * 1.05
        assert max(commanded["peak_step_rad"]) <= 0.0101 and arm["clips"] == 0
    assert all(later.motion_id > earlier.motion_id for earlier, later in pairwise(handles))


@pytest.mark.thorough
@pytest.mark.sim_only("what the shell judges and tells is the matter")
def test_a_recording_is_judged_and_followed_from_the_shell(systems: Callable[..., System], tmp_path: Path) -> None:
    """`ta2 follow`: a file too long for one request, both arms, from its approach to its end, inside every limit."""
    system = systems(tmp_path, has_guard=IS_THOROUGH)
    robot = system.connect("looks")
    state = wait_for(
        lambda: robot.state if robot.state.left_arm.is_known and robot.state.right_arm.is_known else None, "both arms"
    )
    times_s = np.arange(400) * 0.02
    ways = np.array([0.15 + 0.1 * (1.0 - np.cos(1.2 * times_s)), 0.1 * np.sin(0.9 * times_s)]).T
    rows = {side: np.tile(state.arm(side).q, (400, 1)) for side in ("left", "right")}
    for points in rows.values():
        points[:, [2, 5]] += ways
    lines = [",".join(map(str, row)) for row in np.column_stack([times_s, rows["left"], rows["right"]])]
    file = tmp_path / "swing.csv"
    file.write_text("# time, left, right\n" + "\n".join(lines) + "\n")

    def ta2(*words: str) -> subprocess.CompletedProcess[str]:
        command = [
            sys.executable,
            "-m",
            "gateway.cli",
            "follow",
            str(file),
            "--socket",
            system.target,
            "--json",
            *words,
        ]
        return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)

    refused = ta2("--check")
    assert refused.returncode == 1 and json.loads(refused.stdout)["error"]["code"] == "JUMP_TOO_FAR", refused.stderr
    good = ta2("--check", "--approach")
    assert good.returncode == 0 and json.loads(good.stdout)["away"]["left"][2] > 0.1, good.stderr
    assert system.count("/api/left_arm/joint_cmd") == 0
    for _ in range(6):
        ended = ta2("--approach", "--take", "begin again")
        if ended.returncode == 0 or json.loads(ended.stdout)["error"]["code"] not in STALLED:
            break
    assert ended.returncode == 0, ended.stderr
    told = json.loads(ended.stdout)
    assert told["points"] == 400 and told["error_rad"] < 0.05 and not told["held"] and "follow:" in ended.stderr
    measured = robot.state.left_arm.q
    assert abs(measured[2] - rows["left"][-1][2]) < 0.05 and abs(measured[5] - rows["left"][-1][5]) < 0.05
    for arm in system.stats()["arms"].values():
        commanded = arm["commanded"]
        assert (
            max(commanded["peak_radps"]) <= 1.0 * 1.01
            and max(commanded["peak_step_rad"]) <= 0.0101
            and arm["clips"] == 0
        )
