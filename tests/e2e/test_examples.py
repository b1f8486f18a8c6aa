"""The examples of the manual's §6, run as a user runs them: `ta2 example N` against the daemon and the simulated robot.

Whether they have the effect that the manual expects is judged at the robot, by the robot's own account.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gateway.examples import EXAMPLES
from gateway.sim.robot.geometry import arm_geometry
from gateway.sim.robot.manual import EXAMPLE_HOME_RAD, Side
from tests.e2e.system import ROOT, STALLED, System, wait_for
from tests.sim.drivers import TARGET_61_M, TARGET_64

pytestmark = [pytest.mark.e2e, pytest.mark.wire_free("programs of users are the matter")]

PAUSE, READY = 0, 2

CONFIG = "[guard]\nenabled = false\n"
"""On a machine that stalls for 80 ms the guard would end the daemon as frozen: what it does then is for its own tests."""


def example(system: System, number: str, shows: Callable[[], bool] = lambda: True) -> str:
    """Run an example to its end and return what it printed.

    On a machine that stalls for 100 ms the robot's state is stale, and the gateway rightly refuses or stops: then, and
    only then, it is begun again.

    Args:
        system: Robot and daemon.
        number: Which.
        shows: Must have been true at some time while it ran.
    """
    arguments = [sys.executable, "-m", "gateway.cli", "example", number, "--socket", system.target]
    for _ in range(3):
        is_shown = False
        with subprocess.Popen(
            arguments, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as process:
            while process.poll() is None:
                is_shown = is_shown or shows()
                time.sleep(0.02)
            said, told = process.communicate()
        if not told.rpartition("\n  needs ")[2].partition("\n")[2].startswith(STALLED):
            break
        with system.connect("waiter") as waiter:
            wait_for(lambda waiter=waiter: not waiter.state.lease.owned, "a free robot", 30.0)
    assert process.returncode == 0, told + system.daemon.text()[-800:]
    assert EXAMPLES[number].effect in told
    assert is_shown
    return said


def arm_error_rad(system: System, goals: dict[Side, tuple[float, ...]]) -> float:
    """Return how far the true joints of both arms are from a goal, at most [rad]."""
    arms = system.robot_state()["arms"]
    return max(abs(q - goal) for side in Side for q, goal in zip(arms[side.value]["q_rad"], goals[side], strict=True))


def test_the_examples_in_joint_mode(tmp_path: Path, systems: Callable[..., System]) -> None:
    """6.6 converges and disables (§6.6); 6.4 approaches slowly and holds its configuration (§6.4)."""
    system = systems(tmp_path, config=CONFIG)
    with system.connect("watcher"):
        assert "Both arms converged!" in example(system, "6.6")
        assert arm_error_rad(system, EXAMPLE_HOME_RAD) < 0.05
        wait_for(lambda: system.robot_state()["fsm"] == PAUSE, "PAUSE after 6.6")

        assert example(system, "6.4").count("held, 0.0") == 4
        assert arm_error_rad(system, TARGET_64) < 0.02
        wait_for(lambda: system.robot_state()["fsm"] == PAUSE, "PAUSE after 6.4")

    stats = system.stats()
    assert stats["counts"].get("CLIPPED") is None
    for side in Side:
        assert max(stats["arms"][side.value]["moved"]["peak_radps"]) < 0.6


def test_the_grippers_in_joint_mode(tmp_path: Path, systems: Callable[..., System]) -> None:
    """6.2: both arms are held, and both grippers open with the torque of 0.04 (§6.2, §4.4)."""
    system = systems(tmp_path, config=CONFIG)
    with system.connect("watcher"):
        before = system.arm_q()
        example(
            system,
            "6.2",
            lambda: efforts(system) == pytest.approx([1.2, 1.2]) and system.robot_state()["fsm"] == READY,
        )
        assert system.arm_q() == pytest.approx(before, abs=0.05)
    assert openings_rad(system) == pytest.approx([1.0, 1.0], abs=0.002)
    wait_for(lambda: system.robot_state()["fsm"] == PAUSE, "PAUSE after 6.2")


def openings_rad(system: System) -> list[float]:
    """Return the motor angles of both grippers, 1 quite open [rad]."""
    return [gripper["angle_rad"] for gripper in system.robot_state()["grippers"].values()]


def efforts(system: System) -> list[float]:
    """Return the torques of both grippers [N·m]."""
    return [gripper["effort_nm"] for gripper in system.robot_state()["grippers"].values()]


def test_the_chassis_and_the_lift(tmp_path: Path, systems: Callable[..., System]) -> None:
    """6.5: about 0.1 m ahead, then standing, without any heartbeat (§6.5). 6.7: up, a rest, down again, off (§6.7)."""
    system = systems(tmp_path, sim_options=("--model", "lift"), config=f'{CONFIG}[robot]\nmodel = "lift"\n')
    with system.connect("watcher"):
        example(system, "6.5")
        chassis = wait_for(lambda: standing(system), "the standstill")
        assert chassis["travel"] == pytest.approx([0.1, 0.0, 0.0], abs=0.03)
        assert system.robot_state()["fsm"] == PAUSE and system.count("/api/fsm/enable") == 0

        said = example(system, "6.7", lambda: system.robot_state()["lift"]["lowered_m"] < 0.30 - 0.15)
        assert said.splitlines() == ["Lift up", "Pause", "Lift down", "Stop"]
        wait_for(lambda: system.robot_state()["lift"]["is_powered"] is False, "the servo to be off")
        assert system.robot_state()["lift"]["lowered_m"] == pytest.approx(0.30, abs=0.05)


def standing(system: System) -> dict[str, list[float]] | None:
    """Return the chassis when it stands."""
    chassis: dict[str, list[float]] = system.robot_state()["chassis"]
    return chassis if chassis["velocity"] == [0.0, 0.0, 0.0] and chassis["travel"][0] > 0.0 else None


def hand_m(system: System, side: Side) -> np.ndarray:
    """Return where a hand truly is, in its arm's shoulder frame [m]."""
    q_rad = system.robot_state()["arms"][side.value]["q_rad"]
    return np.asarray(arm_geometry(side).forward(q_rad).position_m)


@pytest.mark.thorough
def test_the_left_hand_in_pose_mode(tmp_path: Path, systems: Callable[..., System]) -> None:
    """6.1: the left hand is within 5 mm of the pose, then the robot pauses (§6.1)."""
    system = systems(tmp_path, config=CONFIG, sim_options=("--left-mode", "pose", "--disable", "right_arm"))
    with system.connect("watcher"):
        assert "Target reached!" in example(system, "6.1")
    assert np.linalg.norm(hand_m(system, Side.LEFT) - TARGET_61_M) < 0.005
    wait_for(lambda: system.robot_state()["fsm"] == PAUSE, "PAUSE after 6.1")
    assert system.stats()["counts"].get("IK_INVALID") is None


@pytest.mark.thorough
def test_the_grippers_in_pose_mode(tmp_path: Path, systems: Callable[..., System]) -> None:
    """6.3: both hands stay at the pose where they were, and both grippers open with full torque (§6.3)."""
    system = systems(tmp_path, config=CONFIG, sim_options=("--mode", "pose"))
    with system.connect("watcher"):
        before = [hand_m(system, side) for side in Side]
        example(system, "6.3", lambda: efforts(system) == pytest.approx([2.0, 2.0]))
        for side, begin in zip(Side, before, strict=True):
            assert np.linalg.norm(hand_m(system, side) - begin) < 0.01
    assert openings_rad(system) == pytest.approx([1.0, 1.0], abs=0.002)
