"""The robot's facts against the manual: every number is typed here once more, from the text of the manual itself."""

from __future__ import annotations

import pytest

from gateway.robot.limits import (
    ARM_WATCHDOG_NS,
    GRIPPER_CLOSE_NM,
    GRIPPER_OPEN_NM,
    GRIPPER_RELAXED,
    GRIPPER_TORQUE_NM,
    GRIPPER_WATCHDOG_NS,
    HARD_A_RADPS2,
    HARD_J_RADPS3,
    HARD_V_RADPS,
    HOME_Q_RAD,
    JOINT_LOWER_RAD,
    JOINT_UPPER_RAD,
    MAX_ARM_LEN_M,
    gripper_raw,
    gripper_torque_nm,
)
from gateway.robot.topics import (
    ARM_JOINTS,
    COMMAND_TOPICS,
    CURRENT_MODE,
    JOINT_NAMES,
    MOTION_STATE_TOPICS,
    STATE_TOPICS,
    TOPICS,
    VARIANTS,
    Direction,
    Topic,
    arm_state,
    ee_pose,
    gripper_command,
    gripper_state,
    joint_command,
    pose_command,
    shoulder_frame,
)
from gateway.values import ARM_DOF, Side

MS = 1_000_000

COMMANDS = {
    # topic: (type, lowest rate that the manual accepts, highest or None, width, watchdog ms)     section
    "/api/left_arm/target_pose": ("geometry_msgs/msg/Pose", 50, 77, 7, 150),  # §4.2
    "/api/right_arm/target_pose": ("geometry_msgs/msg/Pose", 50, 77, 7, 150),
    "/api/left_arm/joint_cmd": ("sensor_msgs/msg/JointState", 50, None, 7, 150),  # §4.3: interval < 0.15 s
    "/api/right_arm/joint_cmd": ("sensor_msgs/msg/JointState", 50, None, 7, 150),
    "/api/left_gripper/cmd": ("std_msgs/msg/Float32", 50, None, 1, None),  # §4.4: the last one stays in force
    "/api/right_gripper/cmd": ("std_msgs/msg/Float32", 50, None, 1, None),
    "/api/chassis/velocity": ("std_msgs/msg/Float32MultiArray", 10, None, 3, 1000),  # §4.5: more than 1 s
    "/api/servo/cmd": ("std_msgs/msg/Float32MultiArray", 10, None, 2, 3000),  # §4.6: 10 Hz or more, 3 s
    "/api/fsm/enable": ("std_msgs/msg/Float32", 10, 20, 1, 1000),  # §4.7: 10-20 Hz, 1 s
}

STATES = {
    # topic: (type, nominal rate, names)
    "/left_arm/joint_states": ("sensor_msgs/msg/JointState", 200, 7),
    "/right_arm/joint_states": ("sensor_msgs/msg/JointState", 200, 7),
    "/left_gripper/joint_states": ("sensor_msgs/msg/JointState", 200, 1),
    "/right_gripper/joint_states": ("sensor_msgs/msg/JointState", 200, 1),
    "/chassis/joint_states": ("sensor_msgs/msg/JointState", 200, 3),
    "/left_arm/current_ee_pose": ("geometry_msgs/msg/Pose", 200, 0),
    "/right_arm/current_ee_pose": ("geometry_msgs/msg/Pose", 200, 0),
    "/fsm_state": ("std_msgs/msg/Int32", 20, 0),
    "/api/current_mode": ("std_msgs/msg/String", 1, 0),
}


def test_the_command_topics_are_the_manuals() -> None:
    """§4.1: these nine, and no other."""
    assert set(COMMAND_TOPICS) == set(COMMANDS)


def test_the_state_topics_are_the_manuals() -> None:
    """§4.1, §4.11: these nine, and no other (`actual_states` is announced for later)."""
    assert set(STATE_TOPICS) == set(STATES)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_has_the_type_width_rate_and_watchdog_of_the_manual(name: str) -> None:
    """§4.2-§4.7: our rate is one that the manual recommends, and several frames fit into each watchdog."""
    type_name, low, high, width, watchdog_ms = COMMANDS[name]
    topic = TOPICS[name]
    assert (topic.name, topic.type_name, topic.direction) == (name, type_name, Direction.COMMAND)
    assert low <= topic.rate_hz <= (high or 200)
    assert topic.width == width
    assert topic.watchdog_ns == (None if watchdog_ms is None else watchdog_ms * MS)
    assert topic.watchdog_ns is None or 1e9 / topic.rate_hz * 4 < topic.watchdog_ns
    assert topic.section.startswith("§4.")


@pytest.mark.parametrize("name", STATES)
def test_a_state_has_the_type_rate_and_names_of_the_manual(name: str) -> None:
    """§4.1.1, §4.11."""
    type_name, rate_hz, names = STATES[name]
    topic = TOPICS[name]
    assert (topic.name, topic.type_name, topic.direction) == (name, type_name, Direction.STATE)
    assert topic.rate_hz == rate_hz
    assert len(topic.names) == names
    assert topic.watchdog_ns is None
    assert topic.stop_frame == ()


def test_the_joint_limits_are_the_manuals() -> None:
    """§4.13, lower and upper of either arm."""
    assert JOINT_LOWER_RAD[Side.RIGHT] == (-1.8, -1.9, -1.3, -2.2, -1.8, -1.4, -0.7)
    assert JOINT_UPPER_RAD[Side.RIGHT] == (1.8, 0.0, 2.6, -0.25, 1.8, 1.4, 0.7)
    assert JOINT_LOWER_RAD[Side.LEFT] == (-1.8, 0.0, -2.6, 0.25, -1.8, -1.4, -0.7)
    assert JOINT_UPPER_RAD[Side.LEFT] == (1.8, 1.9, 1.3, 2.2, 1.8, 1.4, 0.7)


def test_the_limits_of_the_arms_mirror_each_other() -> None:
    """§4.13: joints 2, 3 and 4 change sign between the arms, the others are symmetric: a slip of typing would show."""
    for n in range(ARM_DOF):
        left = (JOINT_LOWER_RAD[Side.LEFT][n], JOINT_UPPER_RAD[Side.LEFT][n])
        right = (JOINT_LOWER_RAD[Side.RIGHT][n], JOINT_UPPER_RAD[Side.RIGHT][n])
        assert left[0] < left[1]
        assert right == (-left[1], -left[0])


def test_joint_names_and_order_are_the_manuals() -> None:
    """§4.0.3: index 0 is joint 1, and the prefix is the first letter of the side."""
    assert ARM_JOINTS[Side.LEFT] == (
        "l_joint1", "l_joint2", "l_joint3", "l_joint4", "l_joint5", "l_joint6", "l_joint7",
    )  # fmt: skip
    assert ARM_JOINTS[Side.RIGHT] == (
        "r_joint1", "r_joint2", "r_joint3", "r_joint4", "r_joint5", "r_joint6", "r_joint7",
    )  # fmt: skip
    assert JOINT_NAMES["/left_gripper/joint_states"] == ("l_joint8",)
    assert JOINT_NAMES["/right_gripper/joint_states"] == ("r_joint8",)
    assert JOINT_NAMES["/chassis/joint_states"] == ("chassis_joint1", "chassis_joint2", "chassis_joint3")


def test_the_initial_position_is_the_manuals_and_inside_the_limits() -> None:
    """§6.6."""
    assert HOME_Q_RAD[Side.RIGHT] == (-0.50, -0.92, 0.52, -1.28, 0.32, 0.55, -0.52)
    assert HOME_Q_RAD[Side.LEFT] == (0.41, 1.16, -0.47, 0.90, 0.23, -0.15, 0.60)
    for side in Side:
        limits = zip(JOINT_LOWER_RAD[side], HOME_Q_RAD[side], JOINT_UPPER_RAD[side], strict=True)
        assert all(low < home < high for low, home, high in limits)


def test_the_reach_is_the_manuals() -> None:
    """§4.0.4."""
    assert MAX_ARM_LEN_M == 0.55


def test_only_groups_with_a_target_velocity_have_a_stop_frame() -> None:
    """§4.5-§4.7: zeros stop the chassis, [0, 1] stops the lift and keeps its servo on, 0.0 pauses the FSM."""
    stops = {topic.name: topic.stop_frame for topic in TOPICS.values() if topic.stop_frame}
    assert stops == {
        "/api/chassis/velocity": (0.0, 0.0, 0.0),
        "/api/servo/cmd": (0.0, 1.0),
        "/api/fsm/enable": (0.0,),
    }
    assert all(len(frame) == TOPICS[name].width for name, frame in stops.items())


def test_the_grip_is_lost_before_the_arm_stops() -> None:
    """§4.4: the gripper's watchdog listens to the arm stream, so it is the shorter limit for it."""
    assert GRIPPER_WATCHDOG_NS == 100 * MS < ARM_WATCHDOG_NS == 150 * MS


def test_only_the_upgraded_model_has_a_lift() -> None:
    """§1.2: three models, the same topics but for `/api/servo/cmd`."""
    assert {name: variant.has_lift for name, variant in VARIANTS.items()} == {
        "lite": False,
        "standard": False,
        "lift": True,
    }
    for name, variant in VARIANTS.items():
        assert variant.name == name
        assert set(variant.command_topics) == set(COMMANDS) - (set() if variant.has_lift else {"/api/servo/cmd"})


@pytest.mark.parametrize("side", Side)
def test_topic_names_of_a_side_are_in_the_table(side: Side) -> None:
    """Every function that spells a name spells one that exists, and on the right side of the wire."""
    for spell in (joint_command, pose_command, gripper_command):
        assert TOPICS[spell(side)].direction is Direction.COMMAND
    for spell in (arm_state, ee_pose, gripper_state):
        assert TOPICS[spell(side)].direction is Direction.STATE
    assert shoulder_frame(side) == {"left": "left_shoulder_base", "right": "right_shoulder_base"}[side.value]


def test_freshness_is_judged_by_the_fast_topics_only() -> None:
    """A topic at 20 Hz or 1 Hz cannot show a link of 100 ms."""
    assert set(MOTION_STATE_TOPICS) == {name for name, (_, rate_hz, _) in STATES.items() if rate_hz == 200}


def test_the_hard_limits_are_those_of_the_behaviour_table() -> None:
    """3 rad/s, 15 rad/s², 300 rad/s³: no configuration may ask for more."""
    assert (HARD_V_RADPS, HARD_A_RADPS2, HARD_J_RADPS3) == (3.0, 15.0, 300.0)


def test_a_topic_is_state_or_command_by_its_place() -> None:
    """Commands live under /api/, states do not, but for the mode (§4.11.2)."""
    for topic in TOPICS.values():
        assert isinstance(topic, Topic)
        assert topic.name.startswith("/api/") is (topic.direction is Direction.COMMAND or topic.name == CURRENT_MODE)


@pytest.mark.parametrize(
    ("raw", "torque_nm"), [(0.0, 2.0), (0.05, 1.0), (0.1, 0.0), (0.2, -0.18), (0.55, -0.8), (1.0, -1.6)]
)
def test_the_grippers_table_holds_both_ways(raw: float, torque_nm: float) -> None:
    """§4.4: the rows, and back."""
    assert gripper_torque_nm(raw) == torque_nm and gripper_raw(torque_nm) == raw
    assert dict(GRIPPER_TORQUE_NM)[raw] == torque_nm


def test_between_the_rows_it_is_linear_and_beyond_them_its_ends() -> None:
    """§4.4: less closes less; every torque has its input, and every input its torque."""
    assert gripper_torque_nm(0.075) == pytest.approx(0.5) and gripper_torque_nm(0.15) == pytest.approx(-0.09)
    assert (gripper_raw(5.0), gripper_raw(-5.0)) == (0.0, 1.0)
    assert (gripper_torque_nm(-1.0), gripper_torque_nm(2.0)) == (2.0, -1.6)
    for n in range(101):
        assert gripper_raw(gripper_torque_nm(n / 100)) == pytest.approx(n / 100)
    assert gripper_torque_nm(GRIPPER_RELAXED) == 0.0
    assert (GRIPPER_OPEN_NM, -GRIPPER_CLOSE_NM) == (
        gripper_torque_nm(0.0), gripper_torque_nm(1.0),
    )  # fmt: skip
