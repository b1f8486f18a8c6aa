"""A task on the robot with forces, end to end: simulator, daemon and client as processes, judged by the world's state.

The client commands with the public API only: poses of the left hand, its gripper, the base and the lift. Where block and
robot are, it is told by the simulation's control channel, in place of a perception that finds them in the pictures.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway import robot as facts
from gateway.client import Control, Robot
from gateway.errors import GatewayError
from gateway.sim.geometry import quat_from_rotation
from gateway.sim.physics.scene import MARK_M
from tests.e2e.system import ATTEMPTS, STALLED, System, wait_for
from tests.sim.physics.mujoco_needed import REASON

pytest.importorskip("mujoco", reason=REASON)

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.alone,
    pytest.mark.sim_only("bodies and table are the same whatever the wire is"),
]

Systems = Callable[..., System]

FRAME = "left_shoulder_base"
SHOULDER_M = np.array([0.0482, 0.22])
"""Of the left arm in the base, x and y [m]."""
FROM_ABOVE = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
"""The hand pointing down, its fingers opening along y of the base."""
GRIP_M = np.array([0.185, -0.0068, 0.0])
"""Where the pads hold a thing, in the hand."""
FULL_LIFT_MPS = 0.5


def physics(system: System) -> dict[str, Any]:
    """Return the world's true state."""
    told: dict[str, Any] = system.robot_state()["physics"]
    return told


def wrist(system: System, place_m: np.ndarray) -> tuple[np.ndarray, tuple[float, ...]]:
    """Return position and orientation of the wrist that puts the pads at a place on the ground's frame, from above."""
    base = physics(system)["base"]
    c, s = np.cos(base["yaw_rad"]), np.sin(base["yaw_rad"])
    forward, left = place_m[0] - base["x_m"], place_m[1] - base["y_m"]
    beside = np.array([c * forward + s * left, c * left - s * forward]) - SHOULDER_M
    lowered_m = physics(system)["lowered_m"]
    height_m = place_m[2] - (1.4057 - lowered_m)  # shoulder above the ground with the lift at its top
    position = np.array([*beside, height_m]) - FROM_ABOVE @ GRIP_M
    return position, quat_from_rotation(FROM_ABOVE.tolist())


def bring(own: Control, system: System, place_m: np.ndarray) -> None:
    """Move the pads to a place on the ground's frame."""
    position, quat_xyzw = wrist(system, place_m)
    own.left_arm.move_pose(position, quat_xyzw, frame=FRAME, speed=0.6, tolerance_m=0.01).result(timeout=30.0)


def block_m(system: System) -> np.ndarray:
    """Return where the block is [m]."""
    return np.array(physics(system)["things"]["block"]["position_m"])


def lift_by(own: Control, system: System, up_m: float) -> None:
    """Move the lift, looking where it is, to 3 mm."""
    goal_m = physics(system)["lowered_m"] - up_m
    for _ in range(12):
        gap_m = physics(system)["lowered_m"] - goal_m
        if abs(gap_m) < 0.003:
            return
        speed = 0.2 if abs(gap_m) > 0.05 else 0.06
        own.lift.drive_for(float(np.sign(gap_m)) * speed, max(0.06, abs(gap_m) / (speed * FULL_LIFT_MPS)))
        time.sleep(0.5)
    pytest.fail(f"the lift is {gap_m:.4f} m beside {goal_m:.3f} m")


def drive_to(own: Control, system: System, x_m: float) -> None:
    """Drive straight on, looking where the base is, to a centimetre."""
    for _ in range(12):
        gap_m = x_m - physics(system)["base"]["x_m"]
        if abs(gap_m) < 0.01:
            return
        speed = 0.2 if abs(gap_m) > 0.1 else 0.04
        own.chassis.drive_for(float(np.sign(gap_m)) * speed, 0.0, 0.0, max(0.1, abs(gap_m) / speed))
        wait_for(lambda: not any(system.robot_state()["chassis"]["velocity"]), "a base at rest")
    pytest.fail(f"the base is {gap_m:.3f} m beside {x_m} m")


def work(robot: Robot, system: System) -> None:
    """Drive to the table, pick the block, raise it by the lift, put it on the mark and let go."""
    with robot.control() as own:
        own.enable(timeout=15.0)
        own.left_gripper.open(1.0)
        lift_by(own, system, 0.2)
        table = block_m(system)
        above = np.array([0.0, 0.0, 0.2])
        bring(own, system, table + above + np.array([physics(system)["base"]["x_m"] - 0.5, 0.0, 0.0]))
        drive_to(own, system, 0.5)
        bring(own, system, table + above)
        lift_by(own, system, -0.2)
        bring(own, system, table)
        own.left_gripper.grip(0.7)
        wait_for(lambda: physics(system)["openings_m"]["left"] < 0.045, "a grip")
        time.sleep(0.5)
        lift_by(own, system, 0.1)
        assert block_m(system)[2] == pytest.approx(table[2] + 0.1, abs=0.02)
        bring(own, system, np.array([*MARK_M, table[2] + 0.1]))
        lift_by(own, system, -0.1)
        own.left_gripper.open(1.0)
        wait_for(lambda: physics(system)["openings_m"]["left"] > 0.08, "open fingers")
        lift_by(own, system, 0.1)


@pytest.mark.thorough
def test_a_block_is_picked_from_the_table_and_put_on_the_mark(tmp_path: Path, systems: Systems) -> None:
    """0.5 m of driving, 0.1 m of lifting, a grip from above: the block lies on the mark, and physics kept up with the clock."""
    for attempt in range(ATTEMPTS):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        words = ("--physics", "mujoco", "--model", "lift", "--left-mode", "pose")
        system = systems(folder, config='[robot]\nmodel = "lift"\n', sim_options=words)
        try:
            with system.connect("picker") as robot:
                work(robot, system)
        except GatewayError as error:
            if error.code not in STALLED or attempt == ATTEMPTS - 1:
                raise
            system.close()
            continue
        told = physics(system)
        assert told["things"]["block"]["position_m"] == pytest.approx((*MARK_M, 0.77), abs=0.015)
        assert told["base"]["x_m"] == pytest.approx(0.5, abs=0.02)
        assert told["time_s"] / (told["time_s"] + told["lost_s"]) > 0.9
        counts = system.stats()["counts"]
        assert not {"CLIPPED", "WRONG_MODE", "NOT_A_COMMAND"} & set(counts)
        return


def test_joints_go_home_and_back_on_the_robot_with_forces(tmp_path: Path, systems: Systems) -> None:
    """The gateway needs to know nothing of it: no latch, errors within the usual tolerance, at full default speed."""
    for attempt in range(ATTEMPTS):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        system = systems(folder, sim_options=("--physics", "mujoco"))
        try:
            with system.connect("mover") as robot, robot.control() as own:
                own.enable(timeout=12.0)
                hanging = {"left": robot.state.left_arm.q, "right": robot.state.right_arm.q}
                home = {side.value: facts.HOME_Q_RAD[side] for side in facts.HOME_Q_RAD}
                for goal in (home, hanging):
                    assert own.move_to(goal).result(timeout=20.0).error < 0.05
                assert not robot.state.latches
        except GatewayError as error:
            if error.code not in STALLED or attempt == ATTEMPTS - 1:
                raise
            system.close()
            continue
        assert system.robot_state()["physics"]["base"]["x_m"] == pytest.approx(0.0, abs=0.01)
        return
