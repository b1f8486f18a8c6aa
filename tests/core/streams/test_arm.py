"""The joint stream of an arm: its topic, rate, limits and bound; what every setpoint stream does is in `test_setpoints`."""

from __future__ import annotations

from gateway.core.motion.gap import Gap
from gateway.core.streams.arm import ArmStream
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD
from gateway.robot.topics import joint_command
from gateway.settings.settings import ArmSettings
from gateway.values import Side, Space

S = 1_000_000_000


def test_an_arm_is_streamed_on_its_joint_topic_at_its_rate_within_its_limits():
    """As configured, each side with its own positions (manual §4.3, §4.13)."""
    settings = ArmSettings(v_radps=0.5, rate_hz=50.0, tracking_rad=0.2)
    for side in Side:
        arm = ArmStream(side, settings)
        assert (arm.topic, arm.space, arm.tracking) == (joint_command(side), Space.JOINT, Gap(0.2))
        assert arm.reference.space.limits.v_radps == 0.5
        assert arm.reference.space.limits.lower_rad == JOINT_LOWER_RAD[side]
        arm.start(HOME_Q_RAD[side], 100 * S)
        assert arm.frame(100 * S).values == HOME_Q_RAD[side]
        assert arm.next_due_ns() == 100 * S + S // 50
