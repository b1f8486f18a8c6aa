"""BEHAVIOUR, Starting and continuing: where a stream begins, how it goes on, what `enable` demands and says."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from gateway.core.messages.events import SampleArrived
from gateway.core.messages.outputs import FrameKind
from gateway.errors import Code
from gateway.messages.requests import Enable, Move, Recover, Stop, Take
from gateway.robot.topics import CURRENT_MODE, arm_state, joint_command
from gateway.values import Side
from tests.behaviour.scene import HOME, Scene, scene
from tests.pair import MS

HEARD = {side: arm_state(side) for side in Side}


def first_echo(pair: Scene, side: Side = Side.LEFT) -> tuple[int, tuple[float, ...]]:
    """Return when the first frame of an arm since the mark left, and what it said; it must be an echo."""
    at_ns, frame = pair.arm_frames(side)[0]
    assert frame.kind is FrameKind.ECHO
    return at_ns, frame.values


# --------------------------------------------------------------------------------------------------- silent streams


@pytest.mark.parametrize("side", Side)
def test_a_silent_stream_starts_from_the_measured_state(side: Side) -> None:
    """The first setpoint is within 0.01 rad of what the arm was last measured at."""
    pair = scene("IDLE")
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: bool(pair.arm_frames(side)))
    measured = pair.heard[HEARD[side]].value.q_rad
    assert max(abs(a - b) for a, b in zip(first_echo(pair, side)[1], measured, strict=True)) <= 0.01


def test_the_robot_is_ready_before_any_setpoint_differs_from_the_echo() -> None:
    """ENABLING only echoes where the arms were found (invariant 3)."""
    pair = scene("IDLE")
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE")
    assert pair.arm_kinds() <= {FrameKind.ECHO, FrameKind.HOLD}
    assert all(len({frame.values for _, frame in pair.arm_frames(side)}) == 1 for side in Side)


def test_the_first_heartbeat_comes_after_the_first_setpoints() -> None:
    """The robot's target is synchronised before 1.0 starts it (manual §4.7), although the heartbeat's lane is faster."""
    pair = scene("IDLE")
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE")
    assert pair.beats_at_ns[0] - max(first_echo(pair, side)[0] for side in Side) >= 30 * MS


def test_seeding_demands_0_3_s_of_samples_after_a_reconnect() -> None:
    """Before seeding after a reconnect: 0.3 s of samples, however soon mode and FSM are known."""
    pair = scene("IDLE")
    mode = pair.heard[CURRENT_MODE]
    pair.down()
    pair.run(0.5)
    pair.up()
    up_ns = pair.now_ns
    pair.receive(SampleArrived(topic=mode.topic, value=mode.value, received_ns=up_ns))
    pair.run(0.06)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: bool(pair.arm_frames()))
    assert 300 * MS <= first_echo(pair)[0] - up_ns <= 350 * MS


def test_seeding_starts_anew_after_our_own_pause() -> None:
    """A tick that comes 300 ms late: what is found waiting may be old."""
    pair = scene("IDLE")
    pair.late_ns = 300 * MS
    pair.step(pair.now_ns + 300 * MS)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    paused_ns = pair.now_ns - 10 * MS
    pair.run_until(lambda: bool(pair.arm_frames()))
    assert first_echo(pair)[0] - paused_ns >= 300 * MS


def test_queued_old_states_do_not_seed() -> None:
    """Their receive times are fresh; a stamp lag of more than 100 ms above the least one gives them away."""
    pair = scene("IDLE")
    pair.robot.inject({"fault": "delay", "topic": HEARD[Side.LEFT], "delay_s": 0.25, "duration_s": 3.0}, pair.now_ns)
    pair.run(1.0)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run(1.5)
    assert pair.state == "ENABLING" and not pair.arm_frames()
    pair.run_until(lambda: bool(pair.arm_frames()), 3.0)
    assert pair.robot.faults.active() == []


def test_a_pause_is_left_without_a_gap_and_from_the_measured_state() -> None:
    """PAUSED re-seeds at once: the streams are live and the robot does not follow; the grip needs them."""
    pair = scene("PAUSED")
    pair.push(Side.LEFT, 0.1)
    pair.robot.clear()
    pair.mark()
    asked_ns = pair.now_ns
    pair.granted(Enable(epoch=pair.epoch), "ann")
    at_ns, values = first_echo(pair)
    assert at_ns - asked_ns <= 10 * MS
    assert max(abs(a - b) for a, b in zip(values, pair.heard[HEARD[Side.LEFT]].value.q_rad, strict=True)) <= 0.01
    pair.run_until(lambda: pair.state == "ACTIVE")
    assert all(pair.gap_ms(joint_command(side)) <= 11 for side in Side)


# ---------------------------------------------------------------------------------------------------- live streams


def test_holding_goes_on_from_its_last_setpoint_however_often() -> None:
    """Re-seeding would ratchet the arm down: it hangs a little below its setpoint."""
    pair = scene("at rest")
    held = pair.arm_frames_now()
    for _ in range(5):
        pair.granted(Stop(), "ann")
        pair.run(0.05)
        pair.granted(Move(epoch=pair.epoch, targets_rad=held), "ann")
        pair.run(0.05)
    assert pair.state == "ACTIVE" and pair.arm_frames_now() == held
    assert FrameKind.ECHO not in pair.arm_kinds()
    sag = max(abs(q - h) for q, h in zip(pair.heard[HEARD[Side.LEFT]].value.q_rad, held[Side.LEFT], strict=True))
    assert sag > 1e-3, "this robot does not sag: the test proves nothing"


def test_a_new_owner_goes_on_from_the_last_setpoint() -> None:
    """The stream stays live through a takeover: nothing is seeded, nothing jumps."""
    pair = scene("HOLDING")
    held = pair.arm_frames_now()
    epoch = pair.granted(Take(name="bob", pid=2, reason="test"), "bob")["epoch"]
    pair.alive.add("bob")
    pair.granted(Move(epoch=epoch, targets_rad=HOME), "bob")
    pair.run(0.05)
    values = [frame.values for _, frame in pair.arm_frames(Side.LEFT)]
    assert values[0] == held[Side.LEFT] and FrameKind.ECHO not in pair.arm_kinds()
    assert max(abs(b - a) for x, y in pairwise(values) for a, b in zip(x, y, strict=True)) <= 0.01


def test_ready_goes_on_from_the_echo() -> None:
    """ENABLING -> ACTIVE changes no setpoint."""
    pair = scene("ENABLING")
    before = pair.arm_frames_now()
    pair.run_until(lambda: pair.state == "ACTIVE")
    pair.run(0.2)
    assert pair.arm_frames_now() == before and pair.arm_kinds() == {FrameKind.ECHO, FrameKind.HOLD}


# --------------------------------------------------------------------------------------------------- limits at start


def outside(pair: Scene, by_rad: float) -> None:
    """The left arm's second joint hangs below its lower limit of 0 rad."""
    arm = pair.robot.arms[Side.LEFT]
    arm.q_rad = np.array([*arm.q_rad[:1], -by_rad, *arm.q_rad[2:]])


def test_a_start_just_outside_the_limits_begins_at_the_limit_and_says_so() -> None:
    """At most 0.05 rad beyond: noise at the ends of the range."""
    pair = Scene()
    outside(pair, 0.04)
    scene("IDLE", pair)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE")
    assert first_echo(pair)[1][1] == 0.0
    (message,) = pair.told(Code.START_AT_LIMIT)
    assert "left arm joint 2" in message


def test_a_start_far_outside_the_limits_refuses_enable() -> None:
    """More than 0.05 rad beyond: refused with joint, value and bound."""
    pair = Scene()
    outside(pair, 0.1)
    scene("IDLE", pair)
    refusal = pair.refused(Enable(epoch=pair.epoch), "ann")
    assert refusal.code is Code.START_OUTSIDE_LIMITS and refusal.field == "left_arm[1]"
    assert refusal.value.startswith("-0.1") or refusal.value.startswith("-0.09")
    assert refusal.bound == "[0.0, 1.9]" and refusal.unit == "rad" and pair.state == "IDLE"


def test_an_arm_that_leaves_its_limits_before_it_is_seeded_ends_the_enabling() -> None:
    """The same rule when it happens between the request and the seeding."""
    pair = scene("IDLE", Scene(snapshot_hz=50))
    pair.late_ns = 60 * MS
    pair.step(pair.now_ns + 60 * MS)  # so that seeding takes 0.3 s
    pair.granted(Enable(epoch=pair.epoch), "ann")
    arm = pair.robot.arms[Side.LEFT]
    for _ in range(20):  # the wrist is pushed out of its range, 0.7 rad
        arm.q_rad = arm.q_rad + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.045])
        pair.step()
    pair.run_until(lambda: pair.state == "IDLE")
    snapshot = pair.see()
    assert snapshot.enable.outcome == "failed" and snapshot.enable.code == "START_OUTSIDE_LIMITS"
    assert "left arm joint 7" in snapshot.enable.message and not pair.arm_frames()


# ------------------------------------------------------------------------------------------------------------ walk


@pytest.mark.parametrize("request_of", ["enable", "recover"])
def test_a_reference_that_lost_its_arm_walks_back_and_the_grip_is_kept(request_of: str) -> None:
    """Off by more than the tracking bound: it walks to the measured arm inside the limits, without a gap."""
    pair = scene("HOLDING")
    pair.push(Side.LEFT, 0.5)
    pair.run(0.04)
    pair.mark()
    if request_of == "enable":
        assert pair.granted(Enable(epoch=pair.epoch), "ann")["walking"] is True
    else:
        pair.granted(Recover(), "bob")
    assert pair.state == "HOLDING" and pair.told(Code.WALK)
    refusal = pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert refusal.code is Code.STOPPING and "walking" in refusal.message
    pair.run(4.0)
    frames = [frame.values for _, frame in pair.arm_frames(Side.LEFT)]
    assert pair.arm_kinds(Side.LEFT) == {FrameKind.WALK, FrameKind.HOLD} and pair.arm_kinds(Side.RIGHT) == {
        FrameKind.HOLD
    }
    assert max(abs(b[0] - a[0]) for a, b in pairwise(frames)) <= 0.3 * 0.01 + 1e-9
    assert abs(frames[-1][0] - pair.heard[HEARD[Side.LEFT]].value.q_rad[0]) < 0.01
    assert set(pair.beats) == {1.0} and pair.gap_ms(joint_command(Side.LEFT)) <= 11
    pair.robot.clear()
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert pair.state == "ACTIVE"


def test_nothing_walks_while_the_arms_are_where_they_are_held() -> None:
    """`enable` in HOLDING is a success and sends nothing new."""
    pair = scene("HOLDING")
    pair.push(Side.LEFT, 0.2)
    pair.mark()
    assert pair.granted(Enable(epoch=pair.epoch), "ann")["walking"] is False
    pair.granted(Recover(), "bob")
    pair.run(0.3)
    assert pair.arm_kinds() == {FrameKind.HOLD} and not pair.told(Code.WALK)


def test_motion_is_refused_until_a_strayed_arm_has_been_walked_back_to() -> None:
    """Tracking error in HOLDING: refuse motion; the refusal tells how to get on."""
    pair = scene("HOLDING")
    pair.push(Side.RIGHT, 0.4)
    for side in Side:
        refusal = pair.refused(Move(epoch=pair.epoch, targets_rad={side: HOME[side]}), "ann")
        assert refusal.code is Code.TRACKING_ERROR and refusal.field == "right_arm"
        assert "enable()" in refusal.hint and refusal.bound == "0.3" and refusal.unit == "rad"
    assert pair.state == "HOLDING" and not pair.moved()


def test_an_arm_far_outside_its_limits_cannot_be_walked_to() -> None:
    """`enable` says why; nothing walks, the hold goes on, and `recover` says it too."""
    pair = scene("HOLDING")
    pair.push(Side.LEFT, 1.9)  # joint 1 ends at 1.95 rad, the limit is 1.8 rad
    pair.run(0.04)
    pair.mark()
    refusal = pair.refused(Enable(epoch=pair.epoch), "ann")
    assert refusal.code is Code.START_OUTSIDE_LIMITS and refusal.field == "left_arm[0]"
    assert pair.granted(Recover(), "bob") == {"cleared": []}
    assert pair.told(Code.START_OUTSIDE_LIMITS) and pair.arm_kinds() == {FrameKind.HOLD}


def test_a_stop_ends_a_walk() -> None:
    """Walk frames are changing frames; a stop ends them as it ends everything."""
    pair = scene("HOLDING")
    pair.push(Side.LEFT, 0.5)
    pair.run(0.04)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run(0.3)
    pair.mark()
    pair.granted(Stop(), "ann")
    pair.run(0.5)
    assert pair.arm_kinds(Side.LEFT) == {FrameKind.BRAKE, FrameKind.HOLD} and pair.state == "HOLDING"


def test_an_arm_whose_state_comes_back_while_the_link_was_fresh_is_not_seeded() -> None:
    """Bound check, no seeding: it moves on from its setpoint at once, unless the arm is off by more than the bound."""
    pair = scene("at rest")
    pair.robot.inject({"fault": "drop", "topic": HEARD[Side.LEFT], "duration_s": 0.3}, pair.now_ns)
    pair.run_until(lambda: pair.state == "HOLDING")
    refusal = pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert refusal.code is Code.PART_STALE
    pair.run_until(lambda: not pair.robot.faults.active())
    pair.run(0.02)
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert FrameKind.ECHO not in pair.arm_kinds()
    pair = scene("at rest")
    pair.robot.inject({"fault": "drop", "topic": HEARD[Side.LEFT]}, pair.now_ns)
    pair.run_until(lambda: pair.state == "HOLDING")
    pair.push(Side.LEFT, 0.5)
    pair.robot.clear("drop")
    pair.run(0.5)
    assert pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann").code is Code.TRACKING_ERROR
