"""The robot's topics in one table: names, types, rates, joint order, stop frames; and the models that have them.

Everything else reads this table; nobody repeats a topic's name or rate. Source: the TeleAvatar 2 manual, section in brackets.
"""

from __future__ import annotations

from enum import Enum

from msgspec import Struct

from gateway.robot.limits import (
    ARM_WATCHDOG_NS,
    CHASSIS_WATCHDOG_NS,
    FSM_WATCHDOG_NS,
    LIFT_WATCHDOG_NS,
)
from gateway.values import Side, Vector

__all__ = [
    "ARM_JOINTS",
    "CHASSIS_STATE",
    "CHASSIS_VELOCITY",
    "COMMAND_TOPICS",
    "CURRENT_MODE",
    "FSM_ENABLE",
    "FSM_STATE",
    "JOINT_NAMES",
    "LIFT_COMMAND",
    "MOTION_STATE_TOPICS",
    "STATE_TOPICS",
    "TOPICS",
    "VARIANTS",
    "Direction",
    "Topic",
    "Variant",
    "arm_state",
    "ee_pose",
    "gripper_command",
    "gripper_state",
    "joint_command",
    "pose_command",
    "shoulder_frame",
]

JOINT_STATE = "sensor_msgs/msg/JointState"
POSE = "geometry_msgs/msg/Pose"
FLOAT32 = "std_msgs/msg/Float32"
FLOAT32_ARRAY = "std_msgs/msg/Float32MultiArray"
INT32 = "std_msgs/msg/Int32"
STRING = "std_msgs/msg/String"

ARM_JOINTS: dict[Side, tuple[str, ...]] = {
    side: tuple(f"{side.value[0]}_joint{n}" for n in range(1, 8)) for side in Side
}
"""Joint order of commands and states; the robot reads by index and ignores names (§4.0.3, §4.10)."""


class Direction(str, Enum):
    """Who publishes a topic."""

    STATE = "state"
    COMMAND = "command"


class Topic(Struct, frozen=True, kw_only=True):
    """One public topic of the robot.

    Attributes:
        name: ROS name with the leading slash.
        type_name: ROS type, e.g. `std_msgs/msg/Float32`.
        direction: STATE comes from the robot, COMMAND goes to it.
        rate_hz: Nominal rate: the robot's for states (§4.1.1), ours for commands (DESIGN §6).
        width: Number of floats of a command; of positions of a JointState; 0 where it does not apply.
        watchdog_ns: How long the robot goes on after the last command of this topic; None for states, and for grippers, which
            keep theirs: what lets go of a grip is a gap in the arm's stream, `GRIPPER_WATCHDOG_NS` (§4.4). The manual has
            that of the arms for joint commands alone (§4.3, §4.10); for poses it is ours: the longest gap after which we go
            on as if nothing was.
        stop_frame: What stops the group at once; empty where silence or a repeated reference does.
        names: Joint names in order; empty where the type has none.
        section: Manual section.
    """

    name: str
    type_name: str
    direction: Direction
    rate_hz: float
    width: int = 0
    watchdog_ns: int | None = None
    stop_frame: Vector = ()
    names: tuple[str, ...] = ()
    section: str = ""


def joint_command(side: Side) -> str:
    """Return the joint command topic of an arm (§4.3)."""
    return f"/api/{side}_arm/joint_cmd"


def pose_command(side: Side) -> str:
    """Return the end-effector command topic of an arm (§4.2)."""
    return f"/api/{side}_arm/target_pose"


def gripper_command(side: Side) -> str:
    """Return the force command topic of a gripper (§4.4)."""
    return f"/api/{side}_gripper/cmd"


def arm_state(side: Side) -> str:
    """Return the joint state topic of an arm (§4.8)."""
    return f"/{side}_arm/joint_states"


def ee_pose(side: Side) -> str:
    """Return the end-effector pose topic of an arm (§4.8)."""
    return f"/{side}_arm/current_ee_pose"


def gripper_state(side: Side) -> str:
    """Return the motor state topic of a gripper (§4.8)."""
    return f"/{side}_gripper/joint_states"


def shoulder_frame(side: Side) -> str:
    """Return the name of the frame in which an arm's poses are given (§4.0.1)."""
    return f"{side}_shoulder_base"


FSM_ENABLE = "/api/fsm/enable"
CHASSIS_VELOCITY = "/api/chassis/velocity"
LIFT_COMMAND = "/api/servo/cmd"
CHASSIS_STATE = "/chassis/joint_states"
FSM_STATE = "/fsm_state"
CURRENT_MODE = "/api/current_mode"

JOINT_NAMES: dict[str, tuple[str, ...]] = {
    **{arm_state(side): ARM_JOINTS[side] for side in Side},
    **{gripper_state(side): (f"{side.value[0]}_joint8",) for side in Side},
    CHASSIS_STATE: ("chassis_joint1", "chassis_joint2", "chassis_joint3"),
}
"""Names that a JointState of each topic carries, in order (§4.0.3, §4.1)."""


def _table() -> dict[str, Topic]:
    rows: list[Topic] = []
    for side in Side:
        rows += [
            Topic(name=joint_command(side), type_name=JOINT_STATE, direction=Direction.COMMAND, rate_hz=100.0, width=7,
                  watchdog_ns=ARM_WATCHDOG_NS, names=ARM_JOINTS[side], section="§4.3"),
            Topic(name=pose_command(side), type_name=POSE, direction=Direction.COMMAND, rate_hz=70.0, width=7,
                  watchdog_ns=ARM_WATCHDOG_NS, section="§4.2"),
            Topic(name=gripper_command(side), type_name=FLOAT32, direction=Direction.COMMAND, rate_hz=50.0, width=1,
                  section="§4.4"),
        ]  # fmt: skip
    rows += [
        Topic(name=CHASSIS_VELOCITY, type_name=FLOAT32_ARRAY, direction=Direction.COMMAND, rate_hz=20.0, width=3,
              watchdog_ns=CHASSIS_WATCHDOG_NS, stop_frame=(0.0, 0.0, 0.0), section="§4.5"),
        Topic(name=LIFT_COMMAND, type_name=FLOAT32_ARRAY, direction=Direction.COMMAND, rate_hz=20.0, width=2,
              watchdog_ns=LIFT_WATCHDOG_NS, stop_frame=(0.0, 1.0), section="§4.6"),
        Topic(name=FSM_ENABLE, type_name=FLOAT32, direction=Direction.COMMAND, rate_hz=20.0, width=1,
              watchdog_ns=FSM_WATCHDOG_NS, stop_frame=(0.0,), section="§4.7"),
    ]  # fmt: skip
    for side in Side:
        rows += [
            Topic(name=arm_state(side), type_name=JOINT_STATE, direction=Direction.STATE, rate_hz=200.0, width=7,
                  names=JOINT_NAMES[arm_state(side)], section="§4.8"),
            Topic(name=ee_pose(side), type_name=POSE, direction=Direction.STATE, rate_hz=200.0, width=7,
                  section="§4.8"),
            Topic(name=gripper_state(side), type_name=JOINT_STATE, direction=Direction.STATE, rate_hz=200.0, width=1,
                  names=JOINT_NAMES[gripper_state(side)], section="§4.8"),
        ]  # fmt: skip
    rows += [
        Topic(name=CHASSIS_STATE, type_name=JOINT_STATE, direction=Direction.STATE, rate_hz=200.0, width=3,
              names=JOINT_NAMES[CHASSIS_STATE], section="§4.8"),
        Topic(name=FSM_STATE, type_name=INT32, direction=Direction.STATE, rate_hz=20.0, section="§4.11.1"),
        Topic(name=CURRENT_MODE, type_name=STRING, direction=Direction.STATE, rate_hz=1.0, section="§4.11.2"),
    ]  # fmt: skip
    return {row.name: row for row in rows}


TOPICS: dict[str, Topic] = _table()
"""Every public topic by name (§4.1, §4.8, §4.11). `actual_states` of the grippers is announced for later (§4.1.1)."""

STATE_TOPICS: tuple[str, ...] = tuple(t.name for t in TOPICS.values() if t.direction is Direction.STATE)
COMMAND_TOPICS: tuple[str, ...] = tuple(t.name for t in TOPICS.values() if t.direction is Direction.COMMAND)

MOTION_STATE_TOPICS: tuple[str, ...] = tuple(t for t in STATE_TOPICS if TOPICS[t].rate_hz >= 200.0)
"""The fast state topics: the newest of them tells whether the link is fresh."""


class Variant(Struct, frozen=True, kw_only=True):
    """A model of the robot (§1.2).

    Attributes:
        name: `lite`, `standard` or `lift`.
        has_lift: Whether the lift and `/api/servo/cmd` exist.
    """

    name: str
    has_lift: bool

    @property
    def command_topics(self) -> tuple[str, ...]:
        """Command topics that exist on this model."""
        return tuple(t for t in COMMAND_TOPICS if self.has_lift or t != LIFT_COMMAND)


VARIANTS: dict[str, Variant] = {
    "lite": Variant(name="lite", has_lift=False),
    "standard": Variant(name="standard", has_lift=False),
    "lift": Variant(name="lift", has_lift=True),
}
"""Lite, standard and the upgraded model with the lift (§1.2)."""
