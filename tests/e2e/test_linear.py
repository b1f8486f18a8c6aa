"""Arms in joint mode go straight, end to end: real daemon, simulated robot, public API; the robot's own poses are judged."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from gateway.client import PoseTarget, Robot
from gateway.errors import Aborted, Cancelled, Code, GatewayError, Refusal
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import EePose, Side
from tests.core.lines import planned
from tests.e2e.system import System, steady
from tests.kinematics.bodies import ARMS, samples

pytestmark = [pytest.mark.e2e, pytest.mark.alone]

Systems = Callable[..., System]
STARVED = {Code.PART_LOST, Code.PART_STALE, Code.STATE_STALE, Code.MODEL_UNKNOWN}
"""What a machine without time for the simulated robot gives."""
LAG_M = 0.003
"""How far beside its line an arm is measured: it lags its setpoints alike in all joints, and sags a little."""


def poses() -> Iterator[EePose]:
    """Poses that the left arm can take, somewhere in its reach."""
    for q_rad in samples(Side.LEFT, 1000, seed=3):
        pose = ARMS[Side.LEFT].forward(q_rad)
        if math.hypot(*pose.p_m) < 0.54:
            yield pose


def work(robot: Robot) -> None:
    """Go home, then up and back with both hands; be refused, cancel, and go to a pose by the joints."""
    with robot.control() as own:
        own.enable(timeout=15.0)
        own.move_to({side.value: q_rad for side, q_rad in HOME_Q_RAD.items()}).result(timeout=30.0)
        start = {side: robot.state.arm(side).pose for side in ("left", "right")}
        up = {
            side: PoseTarget(np.add(pose.p, (0.02, 0.0, 0.06)), pose.quat_xyzw, pose.frame)
            for side, pose in start.items()
        }
        motion = own.move_linear(up, speed=0.8)
        seen = []
        while not motion.done:
            seen.append({side: np.asarray(robot.state.arm(side).pose.p) for side in start})
            time.sleep(0.02)
        result = motion.result(timeout=30.0)
        assert result.error_m is not None and result.error_m < 0.005 and result.sides == ("left", "right")
        for side, pose in start.items():
            begin = np.asarray(pose.p)
            along = np.asarray(up[side].p) - begin
            along /= np.linalg.norm(along)
            off = [np.linalg.norm(p - begin - along * np.dot(p - begin, along)) for p in (row[side] for row in seen)]
            assert max(off) < LAG_M, f"{side}: {max(off):.4f} m beside the line"
            assert max(np.linalg.norm(row[side] - begin) for row in seen) > 0.05
        held = tuple(map(float, robot.state.left_arm.q_ref))
        bent = next(pose for pose in poses() if isinstance(planned(pose, held), Refusal))
        with pytest.raises(Aborted) as none:
            own.left_arm.move_linear(bent.p_m, bent.quat_xyzw, frame="left_shoulder_base").result(timeout=30.0)
        assert none.value.code is Code.NO_STRAIGHT_WAY, none.value
        assert tuple(map(float, robot.state.left_arm.q_ref)) == held
        back = own.left_arm.move_linear(start["left"].p, start["left"].quat_xyzw, frame="left_shoulder_base")
        back.cancel()
        with pytest.raises(Cancelled):
            back.result()
        there = own.left_arm.move_pose(start["left"].p, start["left"].quat_xyzw, frame="left_shoulder_base")
        assert there.result(timeout=30.0).error_m < 0.005
        assert math.dist(robot.state.left_arm.pose.p, start["left"].p) < 0.006


def test_both_hands_go_straight_in_joint_mode(tmp_path: Path, systems: Systems) -> None:
    """`move_linear` of both arms, measured beside its line by millimetres; a refusal, a cancel, and `move_pose`."""

    def attempt(folder: Path) -> list[str]:
        system = systems(folder)
        with system.connect("lining") as robot:
            time.sleep(1.5)
            try:
                work(robot)
            except GatewayError as error:
                if error.code not in STARVED:
                    raise
                return [f"the simulated robot was not heard in time: {error}"]
        system.close()
        return []

    steady(attempt, tmp_path)
