"""The robot's limits: joints, grippers, chassis, and the watchdogs that act when commands stay away.

What is hard here no configuration may loosen: `gateway/settings` may only tighten it. Source: the TeleAvatar 2 manual,
section in brackets.
"""

from __future__ import annotations

from itertools import pairwise

from gateway.values import Side, Vector

__all__ = [
    "ARM_WATCHDOG_NS",
    "CHASSIS_DOWN_MPS2",
    "CHASSIS_UP_MPS2",
    "CHASSIS_WATCHDOG_NS",
    "FSM_WATCHDOG_NS",
    "GRIPPER_CLOSE_NM",
    "GRIPPER_OPEN_NM",
    "GRIPPER_RELAXED",
    "GRIPPER_TORQUE_NM",
    "GRIPPER_WATCHDOG_NS",
    "HARD_A_RADPS2",
    "HARD_CHASSIS_V_MPS",
    "HARD_CHASSIS_W_RADPS",
    "HARD_J_RADPS3",
    "HARD_POSE_A_MPS2",
    "HARD_POSE_DDW_RADPS3",
    "HARD_POSE_DW_RADPS2",
    "HARD_POSE_J_MPS3",
    "HARD_POSE_V_MPS",
    "HARD_POSE_W_RADPS",
    "HARD_V_RADPS",
    "HOME_Q_RAD",
    "JOINT_LOWER_RAD",
    "JOINT_UPPER_RAD",
    "LIFT_WATCHDOG_NS",
    "MAX_ARM_LEN_M",
    "MAX_PAYLOAD_KG",
    "MAX_PAYLOAD_M",
    "MOST_NM",
    "TOUCH_N",
    "gripper_raw",
    "gripper_torque_nm",
]

MS = 1_000_000
S = 1_000_000_000

JOINT_LOWER_RAD: dict[Side, Vector] = {
    Side.LEFT: (-1.8, 0.0, -2.6, 0.25, -1.8, -1.4, -0.7),
    Side.RIGHT: (-1.8, -1.9, -1.3, -2.2, -1.8, -1.4, -0.7),
}
"""Lower software limits [rad] (§4.13)."""

JOINT_UPPER_RAD: dict[Side, Vector] = {
    Side.LEFT: (1.8, 1.9, 1.3, 2.2, 1.8, 1.4, 0.7),
    Side.RIGHT: (1.8, 0.0, 2.6, -0.25, 1.8, 1.4, 0.7),
}
"""Upper software limits [rad] (§4.13)."""

HOME_Q_RAD: dict[Side, Vector] = {
    Side.LEFT: (0.41, 1.16, -0.47, 0.90, 0.23, -0.15, 0.60),
    Side.RIGHT: (-0.50, -0.92, 0.52, -1.28, 0.32, 0.55, -0.52),
}
"""The initial position of the manual's example [rad] (§6.6)."""

HARD_V_RADPS = 3.0
"""No configuration may ask a joint for more [rad/s] (ours; BEHAVIOUR, values)."""
HARD_A_RADPS2 = 15.0
"""No configuration may ask a joint for more [rad/s²] (ours)."""
HARD_J_RADPS3 = 300.0
"""No configuration may ask a joint for more [rad/s³] (ours)."""

HARD_CHASSIS_V_MPS = 0.5
"""No configuration may let the chassis drive faster [m/s] (ours; the robot itself has no limit, §4.5)."""
HARD_CHASSIS_W_RADPS = 1.0
"""No configuration may let the chassis turn faster [rad/s] (ours)."""
CHASSIS_UP_MPS2 = 0.3
"""What the chassis ramps up by [m/s², and rad/s²] (§4.5): a faster command is not followed."""
CHASSIS_DOWN_MPS2 = 0.6
"""What it ramps down by [m/s², and rad/s²] (§4.5)."""
HARD_POSE_V_MPS = 0.5
"""No configuration may ask an end effector for more [m/s] (ours; BEHAVIOUR, values)."""
HARD_POSE_A_MPS2 = 5.0
"""No configuration may ask an end effector for more [m/s²] (ours)."""
HARD_POSE_J_MPS3 = 100.0
"""No configuration may ask an end effector for more [m/s³] (ours)."""
HARD_POSE_W_RADPS = 1.5
"""No configuration may turn an end effector faster [rad/s] (ours; BEHAVIOUR, values)."""
HARD_POSE_DW_RADPS2 = 15.0
"""No configuration may turn an end effector harder [rad/s²] (ours; as a joint)."""
HARD_POSE_DDW_RADPS3 = 300.0
"""No configuration may turn an end effector more abruptly [rad/s³] (ours; as a joint)."""

GRIPPER_TORQUE_NM: tuple[tuple[float, float], ...] = (
    (0.00, 2.00), (0.05, 1.00), (0.10, 0.00), (0.20, -0.18), (0.55, -0.80), (1.00, -1.60),
)  # fmt: skip
"""Feed-forward torque of a gripper's motor [N·m] by what it is sent; positive opens, negative closes (§4.4)."""
GRIPPER_RELAXED = 0.10
"""What a gripper is sent for no torque (§4.4)."""
GRIPPER_OPEN_NM = 2.00
"""Greatest torque that opens [N·m] (§4.4)."""
GRIPPER_CLOSE_NM = 1.60
"""Greatest torque that closes, in size [N·m] (§4.4)."""

MAX_ARM_LEN_M = 0.55
"""Greatest reach, shoulder to end effector [m] (§4.0.4)."""
TOUCH_N = (1.0, 200.0)
"""Forces on a hand that may be waited for [N] (ours): lighter ones no motor tells, heavier ones no arm bears."""

MAX_PAYLOAD_KG = 3.0
"""Nobody is believed that a hand holds more [kg] (ours: the manual states none): a wrist motor of 5 N·m holds it at 0.17 m."""
MAX_PAYLOAD_M = 0.5
"""Nor that its centre is farther from the end effector along an axis [m] (ours)."""
MOST_NM = 1000.0
"""More than this no motor of an arm gives [N·m] (ours): what says so measures nothing."""

ARM_WATCHDOG_NS = 150 * MS
"""A longer gap in the arm stream means zero-velocity protection (§4.3, §4.10), in joint mode; taken for poses too (ours)."""
GRIPPER_WATCHDOG_NS = 100 * MS
"""A longer gap in the arm stream cancels the gripper's torque (§4.4): the limit that counts for us."""
FSM_WATCHDOG_NS = 1 * S
"""Longer without 1.0 on `/api/fsm/enable` means PAUSE (§4.7)."""
CHASSIS_WATCHDOG_NS = 1 * S
"""Longer without a velocity means a controlled stop (§4.5)."""
LIFT_WATCHDOG_NS = 3 * S
"""Longer without a command means stop, then servo off (§4.6)."""


def gripper_torque_nm(raw: float) -> float:
    """Return the feed-forward torque [N·m] of a gripper's input 0..1; positive opens (§4.4, linear between the rows)."""
    return _between(raw, GRIPPER_TORQUE_NM)


def gripper_raw(torque_nm: float) -> float:
    """Return the input 0..1 that gives a feed-forward torque [N·m]; beyond the table's ends its ends (§4.4)."""
    return _between(torque_nm, tuple((torque, raw) for raw, torque in reversed(GRIPPER_TORQUE_NM)))


def _between(x: float, rows: tuple[tuple[float, float], ...]) -> float:
    """Return the value at x, linear between rows that rise in x; outside them that of the first or the last."""
    if x <= rows[0][0]:
        return rows[0][1]
    for (x0, y0), (x1, y1) in pairwise(rows):
        if x <= x1:
            return y1 if x == x1 else y0 + (y1 - y0) * (x - x0) / (x1 - x0)
    return rows[-1][1]
