"""Grippers and chassis end to end: a client that is killed while its robot drives and holds something."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.errors import Code
from tests.e2e.system import System, steady, wait_for, worst_gap_ms

pytestmark = [pytest.mark.e2e, pytest.mark.alone]

Systems = Callable[..., System]

DRIVE_AND_GRIP = """
with robot.control() as own:
    own.enable(timeout=12.0)
    own.left_gripper.grip(0.5)
    print("gripping", flush=True)
    own.chassis.drive_for(0.25, 0.0, 0.0, 60.0)
"""
"""Owns the robot, closes the left gripper and drives on until something ends it."""


def test_a_killed_client_leaves_its_grip_and_its_chassis_stands(tmp_path: Path, systems: Systems) -> None:
    """SIGKILL: zeros leave within 350 ms, the arms are held without a gap, and the torque of the gripper stays (R1)."""

    def attempt(folder: Path) -> list[str]:
        system = systems(folder)
        with system.connect("watcher") as watcher:
            client = system.client("owner", DRIVE_AND_GRIP)
            wait_for(
                lambda: watcher.state.drive.commanded_mps == (0.25, 0.0),
                f"full speed ({client.text()} {watcher.state})",
            )
            gripper = system.robot_state()["grippers"]["left"]
            assert gripper["effort_nm"] == pytest.approx(-0.8, abs=0.01)
            client.send(signal.SIGKILL)
            lost = time.monotonic()
            wait_for(lambda: not watcher.state.drive.driven, "no drive any more", 2.0)
            stopped_after = time.monotonic() - lost
            wait_for(lambda: not any(system.robot_state()["chassis"]["velocity"]), "a chassis at rest", 3.0)
            drive = watcher.state.drive
            assert (drive.code, drive.commanded_mps) == (Code.CLIENT_LOST.value, (0.0, 0.0))
            assert watcher.state.state == "HOLDING" and watcher.state.grip("left").input_ratio == pytest.approx(0.55)
            wait_for(
                lambda: not watcher.state.view.streams["/api/chassis/velocity"].running, "the end of the zeros", 3.0
            )
            stats, after = system.stats(), system.robot_state()["grippers"]["left"]
            assert after["effort_nm"] == pytest.approx(-0.8, abs=0.01) and after["level_01"] == pytest.approx(0.55)
            assert "CHASSIS_WATCHDOG" not in stats["counts"]
            broken = []
            if stats["counts"].get("GRIPPER_WATCHDOG"):
                broken.append(f"torque was cancelled {stats['counts']['GRIPPER_WATCHDOG']} times")
            if stopped_after > 0.35:
                broken.append(f"the drive went on for {stopped_after * 1e3:.0f} ms")
            if worst_gap_ms(stats) >= 100.0:
                broken.append(f"arm gap {worst_gap_ms(stats):.0f} ms")
            return broken

    steady(attempt, tmp_path)
