"""LeRobot's names of what is measured and commanded, 16 each: seven joints and the gripper of each arm. Pure.

`left_joint1.pos` [rad], in the order of manual §4.0.3; measured `left_gripper.pos` [rad], the motor's angle; commanded
`left_gripper.torque` [N·m], the motor's feed-forward torque, positive opens: the robot takes no position there (manual §4.4).
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any, Final

from gateway.client import RobotState

__all__ = ["ACTION", "OBSERVATION", "led_by", "measured", "picked"]

ARMS: Final = [[f"{side}_joint{n}.pos" for n in range(1, 8)] for side in ("left", "right")]
OBSERVATION: Final = (*ARMS[0], "left_gripper.pos", *ARMS[1], "right_gripper.pos")
ACTION: Final = (*ARMS[0], "left_gripper.torque", *ARMS[1], "right_gripper.torque")


def measured(state: RobotState) -> dict[str, float]:
    """Return what LeRobot observes. Raises `Stale` where an arm or a gripper was never heard."""
    left, right = state.left_gripper.q, state.right_gripper.q
    return dict(zip(OBSERVATION, map(float, (*state.left_arm.q, *left, *state.right_arm.q, *right)), strict=True))


def led_by(state: RobotState) -> dict[str, float]:
    """Return the action by which another robot does as this one: its joints, its grippers' torques. Raises `Stale` as above."""
    left, right = state.left_gripper.tau, state.right_gripper.tau
    return dict(zip(ACTION, map(float, (*state.left_arm.q, *left, *state.right_arm.q, *right)), strict=True))


def picked(action: Mapping[str, Any]) -> list[float]:
    """Return an action in our order, by our names or those of sets of `ta2 dataset build`.

    Raises `ValueError` for a gap, and for what is not a finite number.
    """
    found = []
    for name in ACTION:
        vendor = name.replace(".pos", "_position").replace(".torque", "_effort")
        value = action.get(name, action.get(vendor))
        if value is None:
            raise ValueError(f"an action without {name} (or {vendor}): it has {', '.join(action) or 'nothing'}")
        found.append(float(value))
        if not isfinite(found[-1]):  # said before anything is sent: half an action is none
            raise ValueError(f"NOT_FINITE: {name} is {found[-1]}")
    return found
