"""The joint stream of an arm: its topic, rate, limits and bound; what every setpoint stream does is in `test_setpoints`."""

from __future__ import annotations

import pytest

from gateway import robot
from gateway.core.messages.events import FrameKind
from gateway.core.motion.gap import Gap
from gateway.core.motion.joints.trajectory import interpolate
from gateway.core.streams.arm import ArmStream
from gateway.settings import ArmSettings
from gateway.values import Side, Space

S = 1_000_000_000


def test_an_arm_is_streamed_on_its_joint_topic_at_its_rate_within_its_limits():
    """As configured, each side with its own positions (manual §4.3, §4.13)."""
    settings = ArmSettings(v_radps=0.5, rate_hz=50.0, tracking_rad=0.2)
    for side in Side:
        arm = ArmStream(side, settings)
        assert (arm.topic, arm.space, arm.tracking) == (robot.joint_command(side), Space.JOINT, Gap(0.2))
        assert arm.reference.limits.v_radps == 0.5
        assert arm.reference.limits.lower_rad == robot.JOINT_LOWER_RAD[side]
        arm.start(robot.HOME_Q_RAD[side], 100 * S)
        assert arm.frame(100 * S).values == robot.HOME_Q_RAD[side]
        assert arm.next_due_ns() == 100 * S + S // 50


def test_a_trajectory_is_motion_of_its_epoch_until_it_ends_and_then_held():
    """Through waiting, joining and closing; what it brings to rest is held."""
    arm, home = ArmStream(Side.LEFT, ArmSettings()), robot.HOME_Q_RAD[Side.LEFT]
    now_ns = 100 * S
    arm.start(home, now_ns)
    arm.go_live()
    frames = []
    points = [tuple(q - 0.004 * n for q in home) for n in range(20)]
    for count in (3, 150):
        for _ in range(count):
            frames.append(arm.frame(now_ns))
            now_ns = arm.next_due_ns()
        if count == 3:
            passage = arm.reference.prepare(interpolate(points, [0.05 * n for n in range(20)]), -0.05, rests=True)
            arm.follow_chunk(passage, 9)
    kinds = [frame.kind for frame in frames[3:]]
    assert kinds[0] is FrameKind.MOTION and kinds[-1] is FrameKind.HOLD and set(kinds) == {kinds[0], kinds[-1]}
    assert {frame.epoch for frame in frames[3:]} == {9}
    assert frames[-1].values == pytest.approx(points[-1], abs=1e-7)
