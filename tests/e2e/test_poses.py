"""A robot with one arm in each control mode, end to end: poses and joints at once, and what the robot heard of it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.client import Robot
from gateway.errors import Code, GatewayError, NotReady, Rejected
from gateway.robot.topics import pose_command
from gateway.values import Side
from tests.e2e.system import System, steady

pytestmark = [pytest.mark.e2e, pytest.mark.alone]

Systems = Callable[..., System]
FRAME = "right_shoulder_base"
TOPIC = pose_command(Side.RIGHT)
STARVED = {Code.PART_LOST, Code.PART_STALE, Code.STATE_STALE}
"""What a machine without time for the simulated robot gives."""


def work(robot: Robot) -> None:
    """Move the right end effector there and back beside the left arm's joints, then stream to it."""
    with robot.control() as own:
        own.enable(timeout=15.0)
        start = robot.state.right_arm.pose
        x, y, z = start.p
        with pytest.raises(Rejected) as wrong:
            own.right_arm.move_pose(start.p, start.quat_xyzw, frame="left_shoulder_base")
        assert wrong.value.code is Code.WRONG_FRAME
        with pytest.raises(NotReady) as joints:
            own.right_arm.move_to(robot.state.right_arm.q)
        assert joints.value.code is Code.WRONG_CONTROL_MODE
        there = own.right_arm.move_pose((x + 0.05, y, z + 0.05), start.quat_xyzw, frame=FRAME)
        joint = own.left_arm.move_by([0.1] + [0.0] * 6)
        result = there.result(timeout=20.0)
        assert (
            result.error_m is not None and result.error_m < 0.005 and result.error is not None and result.error < 0.05
        )
        joint.result(timeout=20.0)
        with own.right_arm.stream("pose", rate_hz=50, frame=FRAME) as out:
            for n in range(75):
                out.set((x + 0.05 * math.cos(n * 0.04), y, z + 0.05), start.quat_xyzw)
                out.tick()
            assert out.accepted > 0
        own.right_arm.hold()
        arm = robot.state.right_arm
        assert arm.space == "pose" and arm.tracking_error_m is not None and arm.tracking_error_m < 0.05


def test_a_mixed_robot_takes_joints_and_poses_under_one_lease(tmp_path: Path, systems: Systems) -> None:
    """`move_pose`, a stream of poses and a joint motion through the real daemon; no gap of 100 ms at the robot."""

    def attempt(folder: Path) -> list[str]:
        system = systems(folder, sim_options=("--right-mode", "pose"))
        with system.connect("posing") as robot:
            time.sleep(0.5)
            try:
                work(robot)
            except GatewayError as error:
                if error.code not in STARVED:
                    raise
                return [f"the simulated robot was not heard for 100 ms: {error}"]
        count, gap_ms = system.count(TOPIC), float(system.stats()["commands"][TOPIC]["worst_gap_alive_ms"])
        system.close()
        assert count > 200
        return [f"gap of {gap_ms} ms on {TOPIC} at the robot"] if gap_ms >= 100.0 else []

    steady(attempt, tmp_path)
