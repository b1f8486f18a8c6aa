"""BEHAVIOUR, Starting: an arm is where several samples say that it is, in the time that our own clock allows."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from msgspec import structs

from gateway.core.messages.events import Event, SampleArrived
from gateway.errors import Code
from gateway.messages.requests import Enable, MovePose
from gateway.robot.topics import STATE_TOPICS, arm_state, ee_pose, pose_command, shoulder_frame
from gateway.sim.robot.settings import SimSettings
from gateway.values import ArmState, EePose, Side, Vector
from tests.behaviour.scene import Scene, scene
from tests.pair import MS, TICK_NS, S

L, R = Side.LEFT, Side.RIGHT
HEARD = arm_state(L)


def say_off(pair: Scene, by_rad: float, ahead_ns: int) -> None:
    """One sample of the left arm's first joint is off, and is stamped ahead of the newest one."""
    last = pair.heard[HEARD]
    assert isinstance(last.value, ArmState) and last.stamp_ns is not None
    stamp_ns = last.stamp_ns + ahead_ns
    q_rad = (last.value.q_rad[0] + by_rad, *last.value.q_rad[1:])
    value = replace(last.value, q_rad=q_rad, stamp_ns=stamp_ns)
    pair.receive(SampleArrived(topic=HEARD, value=value, received_ns=pair.now_ns, stamp_ns=stamp_ns))


class Lying(Scene):
    """A robot whose left arm's second joint is reported off, while its end effector is reported where it is."""

    by_rad = 0.0

    def receive(self, event: Event) -> None:
        """Hand an event to the engine, perhaps a wrong one."""
        if isinstance(event, SampleArrived) and event.topic == HEARD and isinstance(event.value, ArmState):
            q1, q2, *others = event.value.q_rad
            event = structs.replace(event, value=replace(event.value, q_rad=(q1, q2 + self.by_rad, *others)))
        super().receive(event)


class Wavering(Scene):
    """A robot whose right arm is in end-effector mode, and whose hand is reported 9 cm off at one instant."""

    lie_ns = 0

    def __init__(self) -> None:
        super().__init__(SimSettings(state_period_ns=10 * MS, right_mode="pose"))
        self.topics = STATE_TOPICS

    def receive(self, event: Event) -> None:
        """Hand an event to the engine, perhaps a wrong one."""
        if self.now_ns == self.lie_ns and isinstance(event, SampleArrived) and isinstance(event.value, EePose):
            x, *others = event.value.p_m
            event = structs.replace(event, value=replace(event.value, p_m=(x + 0.09, *others)))
        super().receive(event)

    def lie(self) -> None:
        """What is heard in the next tick is wrong: one in which the robot speaks."""
        while (self.engine.next_due_ns() or self.now_ns) % TICK_NS:
            self.step()
        self.lie_ns = (self.now_ns // TICK_NS + 1) * TICK_NS

    def hands_off_m(self) -> float:
        """How far setpoints of the right hand since the mark were from where it is now, at most [m]."""
        hand = self.heard[ee_pose(R)].value
        assert isinstance(hand, EePose)
        return max((math.dist(values[:3], hand.p_m) for values in self.values(pose_command(R))), default=0.0)


def first_joint(pair: Scene) -> list[float]:
    """Setpoints of the left arm's first joint since the mark [rad]."""
    return [frame.values[0] for _, frame in pair.arm_frames(L)]


def true(pair: Scene) -> Vector:
    """Where the left arm is."""
    return tuple(map(float, pair.robot.arms[L].q_rad))


@pytest.mark.parametrize("ahead_ns", [1 * MS, 100 * MS, 10 * S])
@pytest.mark.parametrize("by_rad", [0.15, 0.6])
def test_a_jump_with_a_stamp_ahead_is_not_started_from(by_rad: float, ahead_ns: int) -> None:
    """One sample of it just before `enable`: the robot is enabled where it is, and no arm moves."""
    pair = scene("IDLE")
    at = true(pair)
    say_off(pair, by_rad, ahead_ns)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE")
    assert max(abs(q - at[0]) for q in first_joint(pair)) <= 0.01
    assert max(abs(a - b) for a, b in zip(true(pair), at, strict=True)) <= 0.01


def test_a_stream_starts_from_samples_that_agree() -> None:
    """Every fifth sample is a little off, as plausible as it may be: nothing starts before that has ended."""
    pair = scene("IDLE")
    say_off(pair, 0.09, 1 * MS)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.mark()
    for _ in range(20):
        say_off(pair, 0.09, 1 * MS)
        pair.run(0.04)
    assert pair.state == "ENABLING" and not pair.arm_frames() and not pair.beats
    at = true(pair)
    pair.run_until(lambda: pair.state == "ACTIVE")
    assert max(abs(q - at[0]) for q in first_joint(pair)) <= 0.01


def test_a_pause_is_left_only_when_the_samples_agree() -> None:
    """The streams go on at once, but no 1.0 leaves before the arm is where several samples say that it is."""
    pair = scene("PAUSED")
    at = true(pair)
    say_off(pair, 0.09, 1 * MS)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    for _ in range(10):
        pair.run(0.03)
        say_off(pair, 0.09, 1 * MS)
    assert pair.state == "ENABLING" and 1.0 not in pair.beats
    pair.run_until(lambda: 1.0 in pair.beats, 0.2)
    pair.mark()
    pair.run_until(lambda: pair.state == "ACTIVE")
    assert max(abs(q - at[0]) for q in first_joint(pair)) <= 0.01


def test_a_stream_does_not_start_where_the_end_effector_is_not() -> None:
    """The joints lie by 0.15 rad, all of them alike; the model, which has agreed with this robot, and the pose know it."""
    pair = Lying(SimSettings(state_period_ns=10 * MS), is_modelled=True)
    pair.topics = STATE_TOPICS
    scene("IDLE", pair)
    pair.run(3.0)
    pair.by_rad = 0.15
    pair.run(0.4)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.mark()
    pair.run(0.5)
    assert pair.state == "ENABLING" and not pair.arm_frames()
    pair.by_rad = 0.0
    pair.run_until(lambda: pair.state == "ACTIVE")
    at = true(pair)
    assert max(abs(frame.values[1] - at[1]) for _, frame in pair.arm_frames(L)) <= 0.01


def resumed(lie_ns: int = 0) -> Wavering:
    """A short stall in motion is over."""
    pair = Wavering()
    scene("at rest", pair)
    x, y, z, *quat = pair.sent_on(pose_command(R))[-1][1].values
    goal = {R: (x, y, z + 0.08, *quat)}
    pair.granted(MovePose(epoch=pair.epoch, targets=goal, frames={R: shoulder_frame(R)}), "ann")
    pair.run(0.3)
    pair.freeze()
    pair.run(0.3)
    pair.thaw()
    pair.mark()
    pair.lie_ns = lie_ns
    pair.run_until(lambda: pair.state == "HOLDING", 1.0)
    return pair


def test_an_end_effector_is_not_started_from_one_pose() -> None:
    """One is 9 cm off in the very tick in which a short stall would end: it goes on a little later, from where the hand is."""
    usual = resumed()
    pair = resumed(lie_ns=usual.now_ns)
    assert 0 < pair.now_ns - usual.now_ns <= 70 * MS
    pair.run(0.5)
    assert pair.values(pose_command(R)) and pair.hands_off_m() <= 0.01


def test_a_held_end_effector_is_not_walked_to_one_pose() -> None:
    """`enable` in that tick is refused, and holds on; in the next moment nothing is to be walked."""
    pair = Wavering()
    scene("HOLDING", pair)
    pair.lie()
    assert pair.refused(Enable(epoch=pair.epoch), "ann").code is Code.PART_STALE
    pair.run(0.1)
    assert pair.granted(Enable(epoch=pair.epoch), "ann")["walking"] is False
    pair.run(0.5)
    assert pair.state == "HOLDING" and not pair.moved() and pair.hands_off_m() <= 0.01


def test_an_end_effector_joins_the_held_arm_not_by_one_pose() -> None:
    """It was disabled, and is enabled again."""
    pair = Wavering()
    scene("HOLDING", pair)
    pair.disable_arm(R)
    pair.run(0.1)
    pair.robot.clear("arm_disabled")
    pair.tell_mode(arm_enabled=dict.fromkeys(Side, True))
    pair.mark()
    pair.lie()
    assert pair.refused(Enable(epoch=pair.epoch), "ann").code is Code.PART_STALE
    pair.run(0.1)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run(0.5)
    assert pair.values(pose_command(R)) and pair.hands_off_m() <= 0.01


def test_an_arm_that_moves_at_full_speed_through_a_stall_goes_on() -> None:
    """Led by hand at 2.5 rad/s while the link stalls for 0.3 s: the burst is believed, and the arm is no dead part."""
    pair = scene("IDLE", Scene(snapshot_hz=50))
    pair.freeze()
    pair.push(L, 0.75)
    pair.thaw()
    pair.step()
    assert pair.see().topics[HEARD].refused == 0
    pair.run(0.5)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE")
