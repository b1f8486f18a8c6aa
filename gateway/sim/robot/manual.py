"""The robot's facts as the simulated robot reads them in the manual; section in brackets beside each.

Kept apart from `gateway.robot` on purpose: a misread fact there must show up as a disagreement with this robot.
What the manual leaves open and the simulation had to choose is marked "choice".
"""

from __future__ import annotations

from enum import Enum, IntEnum

__all__ = [
    "ARM_WATCHDOG_NS",
    "CHASSIS_ACCEL",
    "CHASSIS_DECEL",
    "CHASSIS_WATCHDOG_NS",
    "COMMAND_TOPICS",
    "DOF",
    "EXAMPLE_HOME_RAD",
    "GRIPPER_TORQUE_NM",
    "GRIPPER_WATCHDOG_NS",
    "HEARTBEAT_WATCHDOG_NS",
    "LIFT_MOTOR_RADPS",
    "LIFT_WATCHDOG_NS",
    "LOWER_RAD",
    "MS",
    "READY_CHECKS",
    "READY_TOLERANCE_RAD",
    "SLOW_START_RADPS",
    "STATE_TOPICS",
    "UPPER_RAD",
    "ArmMode",
    "Fsm",
    "S",
    "Side",
    "arm_state_topic",
    "command_topics",
    "ee_pose_topic",
    "gripper_cmd_topic",
    "gripper_state_topic",
    "joint_cmd_topic",
    "joint_names",
    "pose_cmd_topic",
]

MS = 1_000_000
S = 1_000_000_000


class Side(str, Enum):
    """An arm; the topics spell it out, the joint names use its first letter (§4.0.3)."""

    LEFT = "left"
    RIGHT = "right"


class ArmMode(IntEnum):
    """`left_arm_control_mode`, `right_arm_control_mode` of `/api/current_mode` (§2.3, §4.11.2)."""

    POSE = 0
    JOINT = 1


class Fsm(IntEnum):
    """Values of `/fsm_state` (§4.11.1)."""

    ERROR = -1
    PAUSE = 0
    SLOW_START = 1
    READY = 2
    LEFT_ARM_ONLY = 3
    RIGHT_ARM_ONLY = 4
    PLAY_READY = 5
    PLAY = 6


DOF = 7
"""Joints per arm (§4.0.3)."""

LOWER_RAD = {
    Side.LEFT: (-1.8, 0.0, -2.6, 0.25, -1.8, -1.4, -0.7),
    Side.RIGHT: (-1.8, -1.9, -1.3, -2.2, -1.8, -1.4, -0.7),
}
"""Lower software limits, index order [rad] (§4.13)."""

UPPER_RAD = {
    Side.LEFT: (1.8, 1.9, 1.3, 2.2, 1.8, 1.4, 0.7),
    Side.RIGHT: (1.8, 0.0, 2.6, -0.25, 1.8, 1.4, 0.7),
}
"""Upper software limits, index order [rad] (§4.13)."""

EXAMPLE_HOME_RAD = {
    Side.LEFT: (0.41, 1.16, -0.47, 0.90, 0.23, -0.15, 0.60),
    Side.RIGHT: (-0.50, -0.92, 0.52, -1.28, 0.32, 0.55, -0.52),
}
"""Target of the initial position example [rad] (§6.6)."""

HEARTBEAT_WATCHDOG_NS = 1 * S
"""Longer than this without 1.0 on `/api/fsm/enable`: PAUSE (§4.7)."""

ARM_WATCHDOG_NS = 150 * MS
"""A longer gap between arm commands: zero-velocity protection (§4.3, §4.10)."""

GRIPPER_WATCHDOG_NS = 100 * MS
"""This long after the arm's command stream ends the feed-forward torque is cancelled (§4.4)."""

CHASSIS_WATCHDOG_NS = 1 * S
"""Longer without a velocity command: the target becomes zero, controlled stop (§4.5)."""

LIFT_WATCHDOG_NS = 3 * S
"""Longer without a servo command: controlled stop, then the servo is disabled (§4.6)."""

SLOW_START_RADPS = 0.5
"""Speed at which the followed target approaches the commanded one in SLOW_START (vendor's simulator)."""

READY_TOLERANCE_RAD = 0.08
"""Largest deviation of a joint from its target that counts as settled (§4.7; figure of the vendor's simulator)."""

READY_CHECKS = 5
"""Consecutive settled checks of the 20 Hz cycle before READY (same)."""

CHASSIS_ACCEL = 0.3
"""m/s² and rad/s², each component (§4.5)."""

CHASSIS_DECEL = 0.6
"""m/s² and rad/s², each component (§4.5)."""

GRIPPER_TORQUE_NM = (
    (0.00, 2.00),
    (0.05, 1.00),
    (0.10, 0.00),
    (0.20, -0.18),
    (0.55, -0.80),
    (1.00, -1.60),
)
"""Input -> feed-forward torque of the gripper motor, positive opens; linear between the rows (table of §4.4)."""

LIFT_MOTOR_RADPS = 150.0
"""Motor target speed = -input * this; positive input raises (§4.6)."""

JOINT_STATE = "sensor_msgs/msg/JointState"
POSE = "geometry_msgs/msg/Pose"
FLOAT32 = "std_msgs/msg/Float32"
FLOAT32_ARRAY = "std_msgs/msg/Float32MultiArray"
INT32 = "std_msgs/msg/Int32"
STRING = "std_msgs/msg/String"

FSM_ENABLE = "/api/fsm/enable"
CHASSIS_CMD = "/api/chassis/velocity"
LIFT_CMD = "/api/servo/cmd"
CHASSIS_STATE = "/chassis/joint_states"
FSM_STATE = "/fsm_state"
CURRENT_MODE = "/api/current_mode"


def joint_cmd_topic(side: Side) -> str:
    """Return the joint target topic of an arm (§4.3)."""
    return f"/api/{side.value}_arm/joint_cmd"


def pose_cmd_topic(side: Side) -> str:
    """Return the end-effector target topic of an arm (§4.2)."""
    return f"/api/{side.value}_arm/target_pose"


def gripper_cmd_topic(side: Side) -> str:
    """Return the force input topic of a gripper (§4.4)."""
    return f"/api/{side.value}_gripper/cmd"


def arm_state_topic(side: Side) -> str:
    """Return the joint state topic of an arm (§4.8)."""
    return f"/{side.value}_arm/joint_states"


def ee_pose_topic(side: Side) -> str:
    """Return the end-effector pose topic of an arm (§4.8)."""
    return f"/{side.value}_arm/current_ee_pose"


def gripper_state_topic(side: Side) -> str:
    """Return the motor state topic of a gripper (§4.8)."""
    return f"/{side.value}_gripper/joint_states"


def joint_names(side: Side) -> tuple[str, ...]:
    """Return the seven joint names of an arm in array order (§4.0.3)."""
    return tuple(f"{side.value[0]}_joint{n}" for n in range(1, DOF + 1))


COMMAND_TOPICS = {
    FSM_ENABLE: FLOAT32,
    **{joint_cmd_topic(side): JOINT_STATE for side in Side},
    **{pose_cmd_topic(side): POSE for side in Side},
    **{gripper_cmd_topic(side): FLOAT32 for side in Side},
    CHASSIS_CMD: FLOAT32_ARRAY,
    LIFT_CMD: FLOAT32_ARRAY,
}
"""Topics that users publish, with their ROS type (§4.1)."""

STATE_TOPICS = {
    **{arm_state_topic(side): (JOINT_STATE, 200) for side in Side},
    **{gripper_state_topic(side): (JOINT_STATE, 200) for side in Side},
    **{ee_pose_topic(side): (POSE, 200) for side in Side},
    CHASSIS_STATE: (JOINT_STATE, 200),
    FSM_STATE: (INT32, 20),
    CURRENT_MODE: (STRING, 1),
}
"""Topics that the robot publishes: ROS type and nominal rate [Hz] (§4.1.1, §4.11)."""


def command_topics(*, has_lift: bool) -> dict[str, str]:
    """Return the command topics that a model offers; `/api/servo/cmd` is the lift model's alone (§1.2, §4.6)."""
    return {topic: kind for topic, kind in COMMAND_TOPICS.items() if topic != LIFT_CMD or has_lift}
