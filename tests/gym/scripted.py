"""A policy that is no policy: it goes to block and mark as the observation tells, by the simulated robot's own kinematics."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from gateway.gym.pick_place import PickPlace
from gateway.sim.robot.geometry import EePose, arm_geometry, quat_from_rotation
from gateway.sim.robot.manual import Side

__all__ = ["actions", "joints"]

TILT = math.radians(-20.0)
DOWN = np.array(
    [[math.cos(TILT), 0.0, math.sin(TILT)], [0.0, 1.0, 0.0], [-math.sin(TILT), 0.0, math.cos(TILT)]]
) @ np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
"""The left hand pointing down and a little ahead, its fingers opening along y of the shoulder."""
PADS_M = np.array([0.185, -0.0068, 0.0])
UP_M = np.array([0.0, 0.0, 0.08])


def joints(place_m: np.ndarray, q_rad: np.ndarray) -> np.ndarray:
    """Return the left arm's joints with which its pads hold a place, from above.

    Args:
        place_m: In the shoulder's frame [m].
        q_rad: Joints to begin the search with, shape (7,) [rad].
    """
    wrist_m, quat_xyzw = place_m - DOWN @ PADS_M, quat_from_rotation(DOWN.tolist())
    found = arm_geometry(Side.LEFT).inverse(EePose(position_m=tuple(wrist_m.tolist()), quat_xyzw=quat_xyzw), q_rad)
    assert found is not None, f"{place_m} is out of reach"
    return found


def actions(env: PickPlace, observation: dict[str, np.ndarray]) -> Iterator[np.ndarray]:
    """Pick the block and put it on the mark with the left arm; the right one stays.

    Args:
        env: Unwrapped; says what numbers mean.
        observation: The first one.
    """
    block_m, goal_m = observation["block"][:3].astype(float), observation["goal"].astype(float)
    stages = (  # where the pads go, the gripper's command meanwhile, and how many steps it takes
        (block_m + UP_M, 0.0, 30),
        (block_m, 0.0, 25),
        (block_m, 0.7, 25),
        (block_m + UP_M, 0.7, 20),
        (goal_m + UP_M, 0.7, 40),
        (goal_m, 0.7, 25),
        (goal_m, 0.0, 20),
        (goal_m + UP_M, 0.0, 20),
    )
    q_rad, rest = observation["state"][:7].astype(float), (*observation["state"][8:15].astype(float), 0.1)
    for place_m, gripper, steps in stages:
        goal_rad = joints(place_m, q_rad)
        for step in range(1, steps + 1):
            part = 0.5 - 0.5 * math.cos(math.pi * step / steps)
            both = (*(q_rad + part * (goal_rad - q_rad)), gripper, *rest)
            yield env.to_action(np.array(both[: env.action_space.shape[0]]))
        q_rad = goal_rad
