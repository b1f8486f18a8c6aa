"""A scripted policy does the task of `test_physics.py` over the openpi protocol: drives, lifts, grips and puts by chunks alone.

The policy is shown the state of the robot, and answers with arms, gripper, chassis and lift; what a trained one would see in
pictures (where block, mark and its own hand are) it asks the simulation for. Every answer begins where the arm is then and
ends where it should be at rest, so that a late one makes the work slower, and never wrong.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.kinematics.arm import ArmModel
from gateway.kinematics.description import nominal
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.sim.physics.scene import MARK_M
from gateway.sim.remote import SimControl
from gateway.sim.robot.geometry import quat_from_rotation
from gateway.values import EePose, Side
from tests.e2e.system import STALLED, System, wait_for
from tests.e2e.test_physics import ABOVE_M, ASIDE_M, DOWN_M, FROM_ABOVE, FULL_LIFT_MPS, GRIP_M, REACH_M
from tests.e2e.test_policy import playing, result
from tests.policy.server import Scripted
from tests.sim.physics.mujoco_needed import REASON

pytest.importorskip("mujoco", reason=REASON)

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.alone,
    pytest.mark.thorough,
    pytest.mark.sim_only("bodies and table are the same whatever the wire is"),
]

Array = np.ndarray[Any, Any]
Systems = Callable[..., System]

HZ, STEPS = 30.0, 30
MAP = """
[observation]
state = 48
[actions]
columns = ["left_arm", "left_gripper_effort", "right_arm", "chassis_velocity", "lift_velocity"]
"""
ARM_RADPS = 0.3
NEAR_M = 0.004
NEAR_RAD = 0.02
OPEN_NM, GRIP_NM = 2.0, -1.12
SETTLED = 4
"""So many answers in a row see the fingers stand still before the hand goes on."""
TASK_S = 300.0
"""It takes one minute of robot time."""
ATTEMPTS = 3
"""No time is judged: where the machine stood still for a quarter of a second, which ends a run rightly, it begins again."""


class Picker:
    """The policy: what to do next, from what it is shown.

    Args:
        control: Of the simulation, in place of eyes.
    """

    def __init__(self, control: SimControl) -> None:
        self._control = control
        self._low, self._high = np.array(JOINT_LOWER_RAD[Side.LEFT]) + 0.04, np.array(JOINT_UPPER_RAD[Side.LEFT]) - 0.04
        self._arm = ArmModel(nominal(), Side.LEFT, tuple(self._low), tuple(self._high))
        self._work = self._script()
        self._q, self._from, self._goal, self._right = (np.zeros(7) for _ in range(4))
        self._shoulder_m = self._block_m = np.zeros(3)
        self._lift_m = self._ahead_m = 0.0
        self._effort_nm, self._fingers, self._dfingers, self._open = OPEN_NM, 0.0, 0.0, 0.0
        self._seed = HOME_Q_RAD[Side.LEFT]
        self.stage = "begin"

    def __call__(self, observation: Any) -> dict[str, Any]:
        state = np.asarray(observation["observation/state"], np.float64)
        self._q, self._fingers, self._dfingers = state[0:7], float(state[7]), float(state[23])
        told = self._control.ask("state")["physics"]
        if self.stage == "begin":
            self._from, self._goal, self._right = self._q, self._q, state[8:15]
        self._block_m = np.array(told["things"]["block"]["position_m"])
        hand_m = np.array(told["hands"]["left"]["position_m"])
        self._shoulder_m = hand_m - np.array(self._arm.forward(self._q).p_m)
        self.stage = next(self._work)
        return {"actions": np.array(self._rows(), np.float32)}

    def _rows(self) -> list[list[float]]:
        way = self._goal - self._from
        length_rad = float(np.abs(way).max())
        done = 1.0 if length_rad == 0.0 else float(np.clip((self._q - self._from) @ way / (way @ way), 0.0, 1.0))
        lift_m, ahead_m, rows = self._lift_m, self._ahead_m, []
        for _ in range(STEPS):
            up_mps = float(np.clip(1.5 * lift_m, -0.1, 0.1)) if abs(lift_m) > NEAR_M / 2 else 0.0
            vx_mps = float(np.clip(1.0 * ahead_m, -0.1, 0.1)) if abs(ahead_m) > NEAR_M / 2 else 0.0
            arm = np.clip(self._from + done * way, self._low, self._high)
            rows.append([*arm, self._effort_nm, *self._right, vx_mps, 0.0, 0.0, up_mps / FULL_LIFT_MPS])
            lift_m, ahead_m = lift_m - up_mps / HZ, ahead_m - vx_mps / HZ
            done = min(1.0, done + ARM_RADPS / HZ / length_rad) if length_rad else 1.0
        return rows

    # ------------------------------------------------------------------------------------------------ the script

    def _script(self) -> Iterator[str]:
        """Yield once an answer, with the stage it belongs to."""
        yield "look"
        yield from self._raise_to(self._block_m[2] - (DOWN_M - ABOVE_M))
        self._open = self._fingers
        yield from self._bring(ASIDE_M)
        yield from self._drive()
        block_m = self._block_m.copy()
        down_m = DOWN_M * np.array([0.0, 0.0, 1.0])
        yield from self._bring((block_m - self._shoulder_m) * np.array([1.0, 1.0, 0.0]) + down_m)
        yield from self._raise_to(block_m[2] - DOWN_M)
        yield from self._fingers_to(GRIP_NM, lambda: self._fingers < self._open - 0.1)
        low_m = self._shoulder_m[2]
        yield from self._raise_to(low_m + 0.1)
        mark_m = np.array([*MARK_M, 0.0])
        yield from self._bring((mark_m - self._shoulder_m) * np.array([1.0, 1.0, 0.0]) + down_m)
        yield from self._raise_to(low_m)
        yield from self._fingers_to(OPEN_NM, lambda: self._fingers > self._open - 0.1)
        yield from self._raise_to(low_m + 0.1)
        while True:
            yield "done"

    def _raise_to(self, shoulder_z_m: float) -> Iterator[str]:
        settled = 0
        while settled < 2:
            self._lift_m = shoulder_z_m - self._shoulder_m[2]
            settled = settled + 1 if abs(self._lift_m) < NEAR_M else 0
            yield "lift"
        self._lift_m = 0.0

    def _drive(self) -> Iterator[str]:
        settled = 0
        while settled < 2:
            self._ahead_m = self._block_m[0] - self._shoulder_m[0] - REACH_M
            settled = settled + 1 if abs(self._ahead_m) < NEAR_M else 0
            yield "drive"
        self._ahead_m = 0.0

    def _bring(self, pads_m: Array) -> Iterator[str]:
        """Bring the pads to a place in the shoulder's frame, from above; once more by what was missing at its end."""
        quat_xyzw = quat_from_rotation(FROM_ABOVE.tolist())
        off_m = np.zeros(3)
        for _ in range(2):
            wrist_m = tuple(pads_m - FROM_ABOVE @ GRIP_M + off_m)
            found = self._arm.solution(EePose(p_m=wrist_m, quat_xyzw=quat_xyzw), self._seed)
            assert found is not None, f"out of reach: {wrist_m}"
            self._seed = found.q_rad
            self._from, self._goal, settled = self._q, np.array(found.q_rad), 0
            while settled < 2:
                yield "arm"
                settled = settled + 1 if np.abs(self._q - self._goal).max() < NEAR_RAD else 0
            off_m = off_m + pads_m - FROM_ABOVE @ GRIP_M - np.array(self._arm.forward(self._q).p_m)

    def _fingers_to(self, effort_nm: float, is_there: Callable[[], bool]) -> Iterator[str]:
        self._effort_nm, settled = effort_nm, 0
        while settled < SETTLED:
            yield "fingers"
            settled = settled + 1 if is_there() and abs(self._dfingers) < 0.05 else 0


@pytest.mark.thorough
@pytest.mark.timeout(ATTEMPTS * TASK_S)
def test_a_policy_picks_a_block_and_puts_it_on_the_mark(tmp_path: Path, systems: Systems) -> None:
    """0.5 m of driving, lifting, a grip from above, all by chunks: the block lies on the mark, and nothing was refused."""
    for attempt in range(ATTEMPTS):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        system = systems(
            folder,
            has_guard=False,
            config='[robot]\nmodel = "lift"\n',
            sim_options=("--physics", "mujoco", "--model", "lift"),
        )
        robot = system.connect("watcher")
        wait_for(lambda: robot.state.left_arm.is_known and robot.state.right_arm.is_known, "both arms")  # noqa: B023
        picker = Picker(SimControl(system.control_endpoint))
        server = Scripted(picker)
        try:
            policy = playing(system, server.url, "--approach", "--timeout", "30", "--patience", "60", layout=MAP)
            wait_for(
                lambda: picker.stage == "done" or not policy.is_running,  # noqa: B023
                "a policy that is done",
                TASK_S,
                lambda: f", {picker.stage}: {policy.text()}",  # noqa: B023
            )
            if policy.is_running:
                policy.send(signal.SIGINT)
            status = policy.wait()
        finally:
            server.close()
        told = result(policy)
        if status != 130 and told["error"]["code"] in STALLED and attempt < ATTEMPTS - 1:
            system.close()
            continue
        assert status == 130, policy.text()
        physics = system.robot_state()["physics"]
        assert physics["things"]["block"]["position_m"] == pytest.approx((*MARK_M, 0.77), abs=0.02)
        assert physics["base"]["x_m"] == pytest.approx(0.5, abs=0.05) and told["chunks"] > 30
        return
