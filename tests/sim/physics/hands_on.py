"""A user of the robot in virtual time: keeps all its streams alive while it moves arms, grippers, base and lift."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cdr_types.messages import std_msgs
from gateway.sim.robot.geometry import EePose, arm_geometry, quat_from_rotation
from gateway.sim.robot.manual import CHASSIS_CMD, FSM_ENABLE, LIFT_CMD, MS, S, Side, gripper_cmd_topic, joint_cmd_topic
from gateway.sim.robot.model import SimRobot
from gateway.sim.robot.settings import SimSettings
from tests.sim.drivers import joints

__all__ = ["DOWN", "GRIP_M", "Hands"]

DOWN = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""The left hand pointing down, its fingers opening along x of the shoulder."""
GRIP_M = 0.185
"""From the wrist to where the pads hold a thing [m]."""
TICK_NS = 20 * MS


class Hands:
    """Joint-mode arms, followed at 50 Hz with everything else at its rate.

    Args:
        model: `standard` or `lift`.
        robot: The robot, if it is to be another one than the usual of its model, without noise.
    """

    def __init__(self, model: str = "standard", robot: SimRobot | None = None) -> None:
        settings = SimSettings(physics="mujoco", model=model, noise_rad=0.0, noise_radps=0.0)
        self.robot = robot or SimRobot(settings)
        self.world = self.robot.dynamics.world
        self.targets = {side: arm.q_rad.copy() for side, arm in self.robot.arms.items()}
        self.levels: dict[Side, float] = {}
        self.velocity: tuple[float, float, float] | None = None
        self.lift: tuple[float, float] | None = None

    def tick(self) -> None:
        """Send what is due and let 20 ms pass."""
        now_ns = self.robot.now_ns
        self.robot.receive(FSM_ENABLE, std_msgs.Float32(data=1.0), now_ns)
        for side, target in self.targets.items():
            self.robot.receive(joint_cmd_topic(side), joints(target), now_ns)
        for side, level in self.levels.items():
            self.robot.receive(gripper_cmd_topic(side), std_msgs.Float32(data=level), now_ns)
        if self.velocity is not None:
            self.robot.receive(CHASSIS_CMD, std_msgs.Float32MultiArray(data=list(self.velocity)), now_ns)
        if self.lift is not None:
            self.robot.receive(LIFT_CMD, std_msgs.Float32MultiArray(data=list(self.lift)), now_ns)
        self.robot.advance(now_ns + TICK_NS, latest_only=True)

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds * S / TICK_NS)):
            self.tick()

    def move(self, goals: Mapping[Side, np.ndarray], seconds: float) -> None:
        """Move arms from their targets to others, without a jerk at the ends, and let them settle."""
        begin = {side: self.targets[side].copy() for side in goals}
        steps = round(seconds * S / TICK_NS)
        for step in range(1, steps + 1):
            part = 0.5 - 0.5 * np.cos(np.pi * step / steps)
            for side, goal in goals.items():
                self.targets[side] = begin[side] + part * (goal - begin[side])
            self.tick()
        self.wait(0.6)

    def drive(self, way: tuple[float, float, float], speed: float = 0.2) -> None:
        """Drive by a way in the base's frame [m, m, rad], and wait until it stands."""
        parts = np.array(way)
        seconds = float(np.abs(parts).max()) / speed
        # The robot ramps up at 0.3 and down at 0.6: the way that the ramps lose and add, by the longest component.
        seconds += 0.5 * speed / 0.3 - 0.5 * speed / 0.6
        self.velocity = tuple((parts / np.abs(parts).max() * speed).tolist())
        self.wait(seconds)
        self.velocity = (0.0, 0.0, 0.0)
        self.wait(1.5)

    def lift_to(self, lowered_m: float) -> None:
        """Move the lift to a place below its top [m], and wait until it stands."""
        for _ in range(400):
            gap_m = self.robot.lift.lowered_m - lowered_m
            if abs(gap_m) < 5e-4:
                break
            self.lift = (float(np.clip(4.0 * gap_m, -0.4, 0.4)), 1.0)
            self.tick()
        self.lift = (0.0, 1.0)
        self.wait(0.6)

    def above(self, place_m: tuple[float, float, float], seed: np.ndarray) -> np.ndarray:
        """Return the left arm's joints with which its pads hold a place on the ground's frame, from above.

        Args:
            place_m: Where [m]; the base must not be turned.
            seed: Joints to begin the search with [rad].
        """
        shoulder = np.array(self.world.place("left_shoulder_base").position_m)
        wrist = np.array(place_m) - shoulder - DOWN @ (GRIP_M, -0.0068, 0.0)
        found = arm_geometry(Side.LEFT).inverse(
            EePose(position_m=tuple(wrist.tolist()), quat_xyzw=quat_from_rotation(DOWN.tolist())), seed
        )
        assert found is not None, f"{place_m} is out of reach from above"
        return found
