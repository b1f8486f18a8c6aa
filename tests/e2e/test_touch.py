"""A hand goes straight down onto a table until it is touched, end to end: robot with forces, daemon and client as processes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gateway.client import Control, MotionResult, Robot, contact
from gateway.errors import Code, GatewayError
from gateway.robot.limits import HOME_Q_RAD
from tests.e2e.system import ATTEMPTS, STALLED, System, wait_for

REASON = "pinocchio or MuJoCo is not installed: pip install 'teleavatar-gateway[body,sim]'"
pytest.importorskip("pinocchio", reason=REASON)
pytest.importorskip("mujoco", reason=REASON)

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.alone,
    pytest.mark.sim_only("bodies and table are the same whatever the wire is"),
]

Systems = Callable[..., System]
TO_THE_TABLE_M = 0.55
TABLE = contact(force_n=8, direction=(0, 0, 1))
AGAIN = (*STALLED, Code.MODEL_UNKNOWN.value, Code.CONTACT_UNKNOWN.value)
"""A machine that stood still hears joints too late for an estimate as well."""


def lowered(own: Control, robot: Robot) -> MotionResult:
    """Bring the hand over the table, and let it go down."""
    own.enable(timeout=15.0)
    own.left_arm.move_to(HOME_Q_RAD["left"]).result(timeout=30.0)
    wait_for(lambda: robot.state.left_arm.model.state == "agrees", "a model that agrees")
    pose = robot.state.left_arm.pose
    above = np.array((0.34, 0.09, -0.2))
    own.left_arm.move_linear(above, pose.quat_xyzw, frame=pose.frame).result(timeout=30.0)
    own.chassis.drive_for(0.2, 0.0, 0.0, TO_THE_TABLE_M / 0.2)
    wait_for(lambda: robot.state.left_arm.contact.is_known, "an estimate")
    down = own.left_arm.move_linear(above - (0.0, 0.0, 0.18), pose.quat_xyzw, frame=pose.frame, speed=0.3, until=TABLE)
    return down.result(timeout=30.0)


def test_a_hand_that_goes_down_ends_at_the_table_and_nothing_moves_on(tmp_path: Path, systems: Systems) -> None:
    """It ends as CONTACT, with force and place; setpoints stand still from then on, and the arm is still held."""
    for attempt in range(ATTEMPTS):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        system = systems(folder, config="[model]\ndynamics = true\n", sim_options=("--physics", "mujoco"))
        try:
            with system.connect("feeler") as robot, robot.control() as own:
                touch = lowered(own, robot).touch
                assert touch is not None and touch.force_n > 8.0 and touch.number == 1
                assert touch.p_m[2] == pytest.approx(-0.308, abs=0.03)
                wait_for(lambda: not any(robot.state.left_arm.dq_ref), "an arm at rest")
                held = robot.state.seq, tuple(robot.state.left_arm.q_ref)
                wait_for(lambda then=held[0]: robot.state.seq > then + 25, "half a second")
                assert tuple(robot.state.left_arm.q_ref) == held[1]
                assert robot.state.state in ("ACTIVE", "HOLDING"), "a client without time is lost, and the arm held"
                motion = next(motion for motion in robot.state.view.motions if motion.touch is not None)
                assert (motion.state, motion.code) == ("touched", "CONTACT") and robot.state.left_arm.touch == touch
        except GatewayError as error:
            if error.code not in AGAIN or attempt == ATTEMPTS - 1:
                raise
            system.close()
            continue
        return
