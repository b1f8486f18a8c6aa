"""Which arms can go to the initial position of manual §6.6, and where that is."""

from __future__ import annotations

from gateway.client.state.reading import RobotState
from gateway.errors import Code, failure
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Vector

__all__ = ["home_goals"]


def home_goals(state: RobotState) -> dict[str, Vector]:
    """Return the goal of each arm that is enabled and in joint mode: seven joints [rad] in the order of manual §4.0.3.

    Args:
        state: Of the robot; what it has not told of its mode yet is taken for well.

    Raises:
        NotReady: WRONG_CONTROL_MODE or NO_ARM_ENABLED: there is none.
    """
    enabled = {"left": True, "right": True} if state.mode is None else state.mode.arm_enabled
    joint = {"left": True, "right": True} if state.mode is None else state.mode.joint_mode
    goals = {
        side.value: q_rad for side, q_rad in HOME_Q_RAD.items() if enabled.get(side.value) and joint.get(side.value)
    }
    if not goals and any(enabled.values()):
        message = "every enabled arm is in end-effector mode, and the initial position is one of joints"
        raise failure(Code.WRONG_CONTROL_MODE, message)
    if not goals:
        raise failure(Code.NO_ARM_ENABLED, "no arm is enabled in the robot's configuration")
    return goals
