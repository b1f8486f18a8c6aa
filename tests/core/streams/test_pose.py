"""The pose stream of an arm: 70 Hz in intervals of one length, from the measured pose on (manual §4.2)."""

from __future__ import annotations

from itertools import pairwise

import pytest

from gateway.core.messages.outputs import FrameKind
from gateway.core.motion.gap import Gap
from gateway.core.motion.motion import plan_poses
from gateway.core.streams.pose import PoseStream
from gateway.robot.topics import pose_command
from gateway.settings.settings import PoseSettings
from gateway.values import Side, Space
from tests.core.pose_judge import HOME, LIMITS, judge

S = 1_000_000_000
T0 = 1_000 * S


def run(arm, count, now_ns=T0):
    """The next frames, each asked for at its instant."""
    frames = []
    while len(frames) < count:
        frame = arm.frame(now_ns)
        if frame is not None:
            frames.append(frame)
        now_ns = arm.next_due_ns()
    return frames


@pytest.mark.parametrize("rate_hz", [50.0, 70.0, 77.0])
def test_frames_come_at_the_configured_rate_in_intervals_of_one_length(rate_hz):
    """14.29 ms each at 70 Hz, not 10 and 20 ms in turn."""
    arm = PoseStream(Side.LEFT, PoseSettings(rate_hz=rate_hz))
    arm.start(HOME, T0)
    due = [frame.due_ns for frame in run(arm, 200)]
    assert all(abs(b - a - S / rate_hz) <= 1 for a, b in pairwise(due))


def test_an_end_effector_is_streamed_on_its_pose_topic_within_its_limits():
    """Norms as configured; the bound of the distance to the measured pose is the configured one."""
    for side in Side:
        arm = PoseStream(side, PoseSettings())
        assert (arm.topic, arm.space) == (pose_command(side), Space.POSE)
        assert arm.tracking == Gap(0.3, 0.06)
        assert arm.reference.space.limits == LIMITS
        assert arm.distance(HOME).m > 0.0


def test_a_path_is_streamed_within_the_limits():
    """Echo, motion, hold; every step inside the norms."""
    arm = PoseStream(Side.RIGHT, PoseSettings())
    arm.start(HOME, T0)
    frames = run(arm, 3)
    assert {frame.kind for frame in frames} == {FrameKind.ECHO} and frames[0].values == HOME
    arm.go_live()
    goal = (0.2, 0.2, -0.1, 0.0, 0.6, 0.0, 0.8)
    arm.follow_path(plan_poses({Side.RIGHT: arm.reference}, {Side.RIGHT: goal})[Side.RIGHT], 7)
    frames += run(arm, 400, arm.next_due_ns())
    judge([frame.values for frame in frames], LIMITS)
    assert frames[-1].kind is FrameKind.HOLD and frames[-1].values[:3] == goal[:3] and frames[-1].epoch == 7
