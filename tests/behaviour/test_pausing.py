"""BEHAVIOUR, The robot does something by itself: a paused robot's target is where it is, for nobody follows it."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.motion.gap import gap
from gateway.messages.requests import Enable, Move
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import (
    FSM_STATE,
    STATE_TOPICS,
    arm_state,
    ee_pose,
    gripper_command,
    joint_command,
    pose_command,
)
from gateway.sim.robot.settings import SimSettings
from gateway.values import ArmState, EePose, Side, Space, Vector
from tests.behaviour.scene import HOME, Scene, scene
from tests.pair import MS

L, R = Side.LEFT, Side.RIGHT
TOPICS = {joint_command(side): (side, Space.JOINT) for side in Side} | {
    pose_command(side): (side, Space.POSE) for side in Side
}


def measured(pair: Scene, side: Side, space: Space) -> Vector:
    """Where an arm was heard to be last, in a space."""
    value = pair.heard[arm_state(side) if space is Space.JOINT else ee_pose(side)].value
    assert isinstance(value, (ArmState, EePose))
    return value.q_rad if isinstance(value, ArmState) else value.values


class Watch:
    """Looks at every setpoint as it leaves, beside what was heard by then."""

    def __init__(self, pair: Scene) -> None:
        self.worst_rad = self.worst_m = 0.0
        self.seen: list[Frame] = []
        self._pair = pair
        pair.on_step = self._see

    def _see(self, output: object) -> None:
        if self._pair.state not in {"PAUSED", "ENABLING"}:
            return
        for frame in output.frames:  # type: ignore[attr-defined]
            if frame.topic in TOPICS:
                side, space = TOPICS[frame.topic]
                off = gap(space, frame.values, measured(self._pair, side, space))
                self.worst_rad, self.worst_m = max(self.worst_rad, off.rad), max(self.worst_m, off.m)
                self.seen.append(frame)

    @property
    def is_near(self) -> bool:
        """Whether all of them were where their arms are."""
        return bool(self.seen) and self.worst_rad <= 0.02 and self.worst_m <= 0.002


def paused_in_motion(right_mode: str = "joint") -> tuple[Scene, Watch]:
    """Both arms move when the robot pauses by itself."""
    pair = Scene(SimSettings(state_period_ns=10 * MS, right_mode=right_mode))
    pair.topics = STATE_TOPICS
    scene("at rest", pair)
    goals = HOME if right_mode == "joint" else {L: HOME[L]}
    pair.granted(Move(epoch=pair.epoch, targets_rad=goals), "ann")
    pair.run(0.4)
    watch = Watch(pair)
    pair.mark()
    pair.robot.inject({"fault": "pause"}, pair.now_ns)
    pair.run_until(lambda: pair.state == "PAUSED", 0.1)
    return pair, watch


@pytest.mark.parametrize("right_mode", ["joint", "pose"])
def test_from_the_tick_of_a_pause_on_the_reference_is_where_the_arm_is(right_mode: str) -> None:
    """It does not brake on ahead of an arm that has stopped: whoever lets the robot go finds nothing to follow."""
    pair, watch = paused_in_motion(right_mode)
    assert {frame.kind for frame in watch.seen} == {FrameKind.ECHO}
    pair.run(1.0)
    assert watch.is_near and pair.state == "PAUSED" and 1.0 not in pair.beats[-3:]
    assert {frame.kind for frame in watch.seen} == {FrameKind.ECHO, FrameKind.HOLD}
    assert all(pair.gap_ms(topic) <= 15 for topic in pair.engine.running_topics if topic in TOPICS)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.fsm == 1)
    assert watch.is_near


@pytest.mark.parametrize("right_mode", ["joint", "pose"])
def test_an_arm_that_is_led_away_in_a_pause_takes_its_reference_along(right_mode: str) -> None:
    """0.4 rad by hand, and then it sinks slowly: the frames go on in their time, near the arm at each of them."""
    pair, watch = paused_in_motion(right_mode)
    pair.run(0.3)
    pair.mark()
    for side in Side:
        pair.push(side, 0.4)
    for _ in range(50):
        for arm in pair.robot.arms.values():
            arm.q_rad = arm.q_rad + np.array([0.0, 0.0, 0.0, 0.002, 0.0, 0.0, 0.0])
        pair.run(0.02)
    assert watch.is_near and pair.gap_ms(joint_command(L)) <= 11 and pair.state == "PAUSED"
    assert not pair.moved() and pair.gap_ms(gripper_command(L)) <= 21


def test_a_pause_keeps_the_reference_of_an_arm_that_is_not_heard() -> None:
    """There is nothing to follow: it stays, at rest, and goes on when the arm is heard again."""
    pair, watch = paused_in_motion()
    pair.run(0.3)
    held = pair.arm_frames_now()[L]
    pair.robot.inject({"fault": "drop", "topic": arm_state(L), "duration_s": 0.5}, pair.now_ns)
    pair.run(0.15)
    pair.robot.arms[L].q_rad = pair.robot.arms[L].q_rad + np.array([0.05, *(0.0,) * 6])
    pair.run(0.3)
    assert pair.state == "PAUSED" and pair.arm_frames_now()[L] == held
    pair.run(0.2)
    assert pair.arm_frames_now()[L] != held and watch.is_near


def test_a_pause_keeps_the_reference_of_an_arm_beyond_its_limits() -> None:
    """It may not be sent, paused or not."""
    pair, _ = paused_in_motion()
    pair.run(0.3)
    pair.robot.inject({"fault": "blocked", "side": "left"}, pair.now_ns)
    low, high = JOINT_LOWER_RAD[L][0], JOINT_UPPER_RAD[L][0]
    while pair.robot.arms[L].q_rad[0] < high + 0.2:
        pair.robot.arms[L].q_rad = pair.robot.arms[L].q_rad + np.array([0.05, *(0.0,) * 6])
        pair.run(0.02)
    assert high - 0.05 <= pair.arm_frames_now()[L][0] <= high and low < high and pair.state == "PAUSED"


def test_one_arm_that_is_disabled_in_a_pause_leaves_the_other_where_it_is() -> None:
    """Its stream ends; the other's reference goes on being where its arm is."""
    pair, watch = paused_in_motion()
    pair.disable_arm(R)
    pair.mark()
    pair.push(L, 0.2)
    assert not pair.arm_frames(R) and pair.arm_frames(L) and watch.is_near


def test_a_robot_that_is_only_not_heard_to_run_is_braked() -> None:
    """`fsm_state` dead: it may be following at speed, and a reference that jumped back to the arm would stop it dead."""
    pair = scene("at rest")
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME, speed=0.3), "ann")
    pair.robot.inject({"fault": "drop", "topic": FSM_STATE, "duration_s": 4.0}, pair.now_ns)
    pair.run_until(lambda: pair.state == "PAUSED", 0.7)
    pair.mark()
    pair.run(0.5)
    assert FrameKind.BRAKE in pair.arm_kinds() and FrameKind.ECHO not in pair.arm_kinds()


def test_while_a_heartbeat_is_not_heard_the_echo_stays_with_the_arm() -> None:
    """ENABLING with an FSM that stays PAUSE: an arm that is led away meanwhile is not pulled back by a late start."""
    pair = scene("IDLE")
    pair.robot.inject({"fault": "fsm_value", "value": 0}, pair.now_ns)
    watch = Watch(pair)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run(1.0)
    assert pair.state == "ENABLING" and pair.beats[-1] == 1.0
    pair.push(L, 0.3)
    assert watch.is_near
