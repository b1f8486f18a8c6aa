"""A task on the robot with forces, end to end: simulator, daemon and client as processes, judged by the world's state.

The client knows nothing but what a robot tells: poses of the left hand, its gripper, base and lift are commanded with the
public API, and where block and mark are is seen by both eyes of the head, in pictures of the video stream
(`tests/e2e/looking.py`). Nobody measures how far base and lift went; what that leaves open, the next look tells.
"""

from __future__ import annotations

import os
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.client import Control, Robot
from gateway.errors import GatewayError
from gateway.robot.limits import HOME_Q_RAD
from gateway.sim.physics.scene import MARK_M
from gateway.sim.robot.geometry import quat_from_rotation
from tests.e2e.system import ATTEMPTS, STALLED, System, wait_for
from tests.sim.physics.drawing_needed import demand_drawing
from tests.sim.physics.mujoco_needed import REASON

pytest.importorskip("mujoco", reason=REASON)
pytest.importorskip("av")

from tests.e2e.looking import BLOCK, FRAME, MARK, calibrated_sight, look

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.alone,
    pytest.mark.sim_only("bodies and table are the same whatever the wire is"),
]

Systems = Callable[..., System]
Places = dict[str, np.ndarray]

FROM_ABOVE = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
"""The hand pointing down, its fingers opening along y of the base."""
GRIP_M = np.array([0.185, -0.0068, 0.0])
"""Where the pads hold a thing, in the hand."""
REACH_M = 0.392
"""How far before the shoulder the block is picked [m]."""
DOWN_M = -0.4
"""How high the hand works, in the shoulder's frame [m]: well within its reach on both sides."""
ASIDE_M = np.array([0.3, 0.14, DOWN_M])
"""Where the pads wait: they hide neither block nor mark from the eyes."""
ABOVE_M = 0.12
"""How far above the block the pads are while the robot drives [m]: over the table's edge."""
HALF_BLOCK_M = 0.02
FULL_LIFT_MPS = 0.5


def bring(own: Control, place_m: np.ndarray) -> None:
    """Move the pads to a place in the shoulder's frame, from above."""
    quat_xyzw = quat_from_rotation(FROM_ABOVE.tolist())
    wrist_m = place_m - FROM_ABOVE @ GRIP_M
    own.left_arm.move_pose(wrist_m, quat_xyzw, frame=FRAME, speed=0.6, tolerance_m=0.01).result(timeout=30.0)


def raise_by(own: Control, up_m: float) -> None:
    """Move the lift, by its speed and the time."""
    speed = 0.2
    own.lift.drive_for(float(np.sign(up_m)) * speed, abs(up_m) / (speed * FULL_LIFT_MPS))
    time.sleep(0.5)


def drive_by(own: Control, way_m: float) -> None:
    """Drive straight on, by speed and time."""
    speed_mps = 0.2 if abs(way_m) > 0.1 else 0.04
    own.chassis.drive_for(float(np.sign(way_m)) * speed_mps, 0.0, 0.0, abs(way_m) / speed_mps)
    time.sleep(0.5)


def gripper_rad(robot: Robot) -> float:
    """Return the left gripper's motor angle, larger when it is open."""
    return float(robot.state.left_gripper.q[0])


def work(robot: Robot, seen: Callable[[], Places]) -> None:
    """Drive to the table, pick the block, raise it by the lift, put it on the mark and let go."""
    with robot.control() as own:
        own.enable(timeout=15.0)
        own.left_gripper.open(1.0)
        block_m = seen()[BLOCK]
        raise_by(own, block_m[2] - (DOWN_M - ABOVE_M))
        open_rad = gripper_rad(robot)
        bring(own, ASIDE_M)
        drive_by(own, block_m[0] - REACH_M)
        drive_by(own, seen()[BLOCK][0] - REACH_M)
        there = seen()
        bring(own, np.array([*there[BLOCK][:2], DOWN_M]))
        raise_by(own, there[BLOCK][2] - DOWN_M)
        table_m = seen()[MARK][2]  # the hand hides the block, and nobody else knows how far the lift went
        bring(own, np.array([*there[BLOCK][:2], table_m + HALF_BLOCK_M]))
        own.left_gripper.grip(0.7)
        wait_for(lambda: robot.state.grip("left").holding, "a grip")
        raise_by(own, 0.1)
        bring(own, np.array([*there[MARK][:2], table_m + HALF_BLOCK_M]))
        raise_by(own, -0.1)
        own.left_gripper.open(1.0)
        wait_for(lambda: gripper_rad(robot) > open_rad - 0.1, "open fingers")
        raise_by(own, 0.1)


def physics(system: System) -> dict[str, Any]:
    """Return the world's true state, which the client does not know."""
    told: dict[str, Any] = system.robot_state()["physics"]
    return told


@pytest.fixture
def film(tmp_path: Path) -> Iterator[Path | None]:
    """Where a film of the task goes: a file of the folder that `TA2_ARTEFACTS` names, whole or not there at all."""
    wanted = os.environ.get("TA2_ARTEFACTS")
    if not wanted:
        yield None
        return
    made = tmp_path / "pick.mp4"
    yield made
    if made.exists():
        Path(wanted).mkdir(parents=True, exist_ok=True)
        shutil.copy(made, Path(wanted, "pick.mp4"))


@pytest.mark.thorough
def test_a_block_that_is_seen_is_picked_from_the_table_and_put_on_the_mark(
    tmp_path: Path, systems: Systems, film: Path | None
) -> None:
    """0.5 m of driving, 0.1 m of lifting, a grip from above: the block lies on the mark, and physics kept up with the clock."""
    demand_drawing()
    sight = calibrated_sight(tmp_path)
    for attempt in range(ATTEMPTS):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        words = ("--physics", "mujoco", "--model", "lift", "--left-mode", "pose")
        filmed = ("--record", str(film)) if film else ()
        system = systems(folder, config='[robot]\nmodel = "lift"\n', sim_options=(*words, *filmed))
        try:
            with system.connect("picker") as robot:
                work(robot, lambda: look(system.endpoint, folder, sight))  # noqa: B023  called before the next attempt
        except GatewayError as error:
            if error.code not in STALLED or attempt == ATTEMPTS - 1:
                raise
            system.close()
            continue
        told = physics(system)
        assert told["things"]["block"]["position_m"] == pytest.approx((*MARK_M, 0.77), abs=0.02)
        assert told["base"]["x_m"] == pytest.approx(0.5, abs=0.03)
        assert told["time_s"] / (told["time_s"] + told["lost_s"]) > 0.9
        counts = system.stats()["counts"]
        assert not {"CLIPPED", "WRONG_MODE", "NOT_A_COMMAND"} & set(counts)
        system.sim.send(signal.SIGINT)
        assert system.sim.wait(30.0) == 0  # the film is whole
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
                home = {side.value: HOME_Q_RAD[side] for side in HOME_Q_RAD}
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
