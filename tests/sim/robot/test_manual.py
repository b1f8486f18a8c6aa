"""The facts of the simulated robot and those of the gateway were read apart in the same manual: they must agree."""

from __future__ import annotations

import pytest

from gateway.robot.limits import (
    ARM_WATCHDOG_NS,
    CHASSIS_WATCHDOG_NS,
    FSM_WATCHDOG_NS,
    GRIPPER_WATCHDOG_NS,
    HOME_Q_RAD,
    JOINT_LOWER_RAD,
    JOINT_UPPER_RAD,
    LIFT_WATCHDOG_NS,
)
from gateway.robot.topics import ARM_JOINTS, COMMAND_TOPICS, STATE_TOPICS, TOPICS
from gateway.sim.robot import manual
from gateway.sim.robot.manual import Side
from gateway.values import Side as GatewaySide


def test_both_readings_know_the_same_topics_types_and_rates():
    """Topic names, ROS types and nominal rates of the states (§4.1, §4.1.1, §4.11)."""
    assert {name: TOPICS[name].type_name for name in COMMAND_TOPICS} == manual.COMMAND_TOPICS
    assert {name: (TOPICS[name].type_name, TOPICS[name].rate_hz) for name in STATE_TOPICS} == manual.STATE_TOPICS


@pytest.mark.parametrize("side", Side)
def test_both_readings_know_the_same_joints_limits_and_home(side):
    """Names in order (§4.0.3), software limits (§4.13), the initial position (§6.6)."""
    other = GatewaySide(side.value)
    assert ARM_JOINTS[other] == manual.joint_names(side)
    assert JOINT_LOWER_RAD[other] == manual.LOWER_RAD[side]
    assert JOINT_UPPER_RAD[other] == manual.UPPER_RAD[side]
    assert HOME_Q_RAD[other] == manual.EXAMPLE_HOME_RAD[side]


def test_both_readings_know_the_same_watchdogs():
    """Arm 0.15 s, gripper 0.1 s, heartbeat 1 s, chassis 1 s, lift 3 s (§4.3 to §4.7)."""
    assert ARM_WATCHDOG_NS == manual.ARM_WATCHDOG_NS == 150_000_000
    assert GRIPPER_WATCHDOG_NS == manual.GRIPPER_WATCHDOG_NS == 100_000_000
    assert FSM_WATCHDOG_NS == manual.HEARTBEAT_WATCHDOG_NS == 1_000_000_000
    assert CHASSIS_WATCHDOG_NS == manual.CHASSIS_WATCHDOG_NS == 1_000_000_000
    assert LIFT_WATCHDOG_NS == manual.LIFT_WATCHDOG_NS == 3_000_000_000


def test_only_the_lift_model_has_the_servo_topic():
    """`/api/servo/cmd` and nothing else depends on the model (§1.2)."""
    with_lift, without = manual.command_topics(has_lift=True), manual.command_topics(has_lift=False)
    assert set(with_lift) - set(without) == {"/api/servo/cmd"}


def test_topics_of_a_side_are_topics_of_the_tables():
    """The functions that spell a side's topics spell existing ones."""
    for side in Side:
        commands = (manual.joint_cmd_topic(side), manual.pose_cmd_topic(side), manual.gripper_cmd_topic(side))
        states = (manual.arm_state_topic(side), manual.ee_pose_topic(side), manual.gripper_state_topic(side))
        assert set(commands) <= set(manual.COMMAND_TOPICS)
        assert set(states) <= set(manual.STATE_TOPICS)
