"""BEHAVIOUR, Starting and continuing: where a stream begins, how it goes on, what `enable` demands and says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gateway import robot
from gateway.core.events import (
    Acquire,
    Disable,
    Enable,
    FrameKind,
    Move,
    Recover,
    Release,
    RouteObserved,
    Stop,
    Take,
)
from gateway.errors import Code
from gateway.sim.settings import SimSettings
from gateway.values import Side
from tests.behaviour.scene import HOME, LEAN, Scene, away, scene
from tests.pair import MS

HEARD = {side: robot.arm_state(side) for side in Side}


def push(pair: Scene, side: Side, by_rad: float) -> None:
    """Move an arm by hand, in steps that no sample guard objects to; something holds it there."""
    pair.robot.inject({"fault": "blocked", "side": side.value}, pair.now_ns)
    steps = round(abs(by_rad) / 0.05)
    for _ in range(steps):
        arm = pair.robot.arms[side]
        arm.q_rad = arm.q_rad + np.array([by_rad / steps, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        pair.run(0.02)


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
    mode = pair.heard[robot.CURRENT_MODE]
    pair.down()
    pair.run(0.5)
    pair.up()
    up_ns = pair.now_ns
    pair.receive(replace(mode, received_ns=up_ns))
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
    push(pair, Side.LEFT, 0.1)
    pair.robot.clear()
    pair.mark()
    asked_ns = pair.now_ns
    pair.granted(Enable(epoch=pair.epoch), "ann")
    at_ns, values = first_echo(pair)
    assert at_ns - asked_ns <= 10 * MS
    assert max(abs(a - b) for a, b in zip(values, pair.heard[HEARD[Side.LEFT]].value.q_rad, strict=True)) <= 0.01
    pair.run_until(lambda: pair.state == "ACTIVE")
    assert all(pair.gap_ms(robot.joint_command(side)) <= 11 for side in Side)


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
    push(pair, Side.LEFT, 0.5)
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
    assert set(pair.beats) == {1.0} and pair.gap_ms(robot.joint_command(Side.LEFT)) <= 11
    pair.robot.clear()
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert pair.state == "ACTIVE"


def test_nothing_walks_while_the_arms_are_where_they_are_held() -> None:
    """`enable` in HOLDING is a success and sends nothing new."""
    pair = scene("HOLDING")
    push(pair, Side.LEFT, 0.2)
    pair.mark()
    assert pair.granted(Enable(epoch=pair.epoch), "ann")["walking"] is False
    pair.granted(Recover(), "bob")
    pair.run(0.3)
    assert pair.arm_kinds() == {FrameKind.HOLD} and not pair.told(Code.WALK)


def test_motion_is_refused_until_a_strayed_arm_has_been_walked_back_to() -> None:
    """Tracking error in HOLDING: refuse motion; the refusal tells how to get on."""
    pair = scene("HOLDING")
    push(pair, Side.RIGHT, 0.4)
    for side in Side:
        refusal = pair.refused(Move(epoch=pair.epoch, targets_rad={side: HOME[side]}), "ann")
        assert refusal.code is Code.TRACKING_ERROR and refusal.field == "right_arm"
        assert "enable()" in refusal.hint and refusal.bound == "0.3" and refusal.unit == "rad"
    assert pair.state == "HOLDING" and not pair.moved()


def test_an_arm_far_outside_its_limits_cannot_be_walked_to() -> None:
    """`enable` says why; nothing walks, the hold goes on, and `recover` says it too."""
    pair = scene("HOLDING")
    push(pair, Side.LEFT, 1.9)  # joint 1 ends at 1.95 rad, the limit is 1.8 rad
    pair.mark()
    refusal = pair.refused(Enable(epoch=pair.epoch), "ann")
    assert refusal.code is Code.START_OUTSIDE_LIMITS and refusal.field == "left_arm[0]"
    assert pair.granted(Recover(), "bob") == {"cleared": []}
    assert pair.told(Code.START_OUTSIDE_LIMITS) and pair.arm_kinds() == {FrameKind.HOLD}


def test_a_stop_ends_a_walk() -> None:
    """Walk frames are changing frames; a stop ends them as it ends everything."""
    pair = scene("HOLDING")
    push(pair, Side.LEFT, 0.5)
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
    push(pair, Side.LEFT, 0.5)
    pair.robot.clear("drop")
    pair.run(0.5)
    assert pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann").code is Code.TRACKING_ERROR


# --------------------------------------------------------------------------------------------------------- two arms


@pytest.mark.parametrize(
    ("lose", "code"),
    [
        (lambda pair: pair.disable_arm(Side.LEFT), "ARM_DISABLED"),
        (lambda pair: pair.disable_arm(Side.LEFT, as_mode=True), "ARM_DISABLED"),
        (lambda pair: pair.robot.inject({"fault": "drop", "topic": HEARD[Side.LEFT]}, pair.now_ns), "PART_LOST"),
    ],
    ids=["disabled", "other mode", "state dead"],
)
def test_a_motion_of_two_arms_ends_for_both_when_one_is_lost(lose: Callable[[Scene], object], code: str) -> None:
    """It aborts with both codes; the other arm brakes and holds, under a heartbeat that goes on."""
    pair = scene("ACTIVE", Scene(snapshot_hz=50))
    lose(pair)
    pair.run_until(lambda: pair.state == "HOLDING", 0.2)
    pair.run(1.0)
    (motion,) = pair.see().motions
    assert motion.state == "aborted" and motion.code == code
    assert f"left arm {code}" in motion.message and "right arm PART_LOST" in motion.message
    frames = [frame.kind for _, frame in pair.arm_frames(Side.RIGHT)]
    assert frames[-1] is FrameKind.HOLD and FrameKind.BRAKE in frames and set(pair.beats) == {1.0}
    assert pair.streaming == ([Side.RIGHT] if code == "ARM_DISABLED" else list(Side))
    assert len(pair.told(Code.MOTION_ENDED)) == 1


def test_an_arm_is_lost_by_its_own_code_when_both_are_lost() -> None:
    """Each arm has its own code in the message."""
    pair = scene("ACTIVE", Scene(snapshot_hz=50))
    for side in Side:
        pair.robot.inject({"fault": "drop", "topic": HEARD[side]}, pair.now_ns)
    pair.topics = (*LEAN, robot.CHASSIS_STATE)
    pair.run_until(lambda: pair.state == "HOLDING")
    (motion,) = pair.see().motions
    assert "left arm PART_LOST, right arm PART_LOST" in motion.message


def test_the_other_arm_goes_on_after_one_was_disabled() -> None:
    """A disabled part does not count; its stream is silent, and a motion of it is refused."""
    pair = scene("at rest")
    pair.disable_arm(Side.LEFT)
    pair.run_until(lambda: pair.state == "HOLDING", 0.1)
    assert pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann").code is Code.ARM_DISABLED
    pair.granted(Move(epoch=pair.epoch, targets_rad={Side.RIGHT: HOME[Side.RIGHT]}), "ann")
    pair.mark()
    pair.run(0.5)
    assert pair.state == "ACTIVE" and pair.streaming == [Side.RIGHT] and not pair.arm_frames(Side.LEFT)


def test_an_arm_that_is_enabled_again_joins_only_at_the_next_enable() -> None:
    """Nothing starts by itself; in ACTIVE `enable` changes nothing, in HOLDING it starts the arm where it is."""
    pair = scene("at rest")
    pair.robot.inject({"fault": "arm_disabled", "side": "left", "duration_s": 1.5}, pair.now_ns)
    pair.run_until(lambda: pair.state == "HOLDING", 1.5)
    pair.run(3.0)
    assert pair.streaming == [Side.RIGHT]
    refusal = pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert refusal.code is Code.NOT_ENABLED and "left" in refusal.message
    pair.granted(Move(epoch=pair.epoch, targets_rad={Side.RIGHT: away(pair, Side.RIGHT)}), "ann")
    pair.granted(Enable(epoch=pair.epoch), "ann")
    assert pair.streaming == [Side.RIGHT]
    pair.granted(Stop(), "ann")
    pair.run(0.5)
    pair.mark()
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run(0.1)
    assert pair.streaming == list(Side) and pair.state == "HOLDING"
    assert [frame.kind for _, frame in pair.arm_frames(Side.LEFT)][:2] == [FrameKind.ECHO, FrameKind.HOLD]
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")


def test_an_arm_joins_only_from_a_steady_state() -> None:
    """0.3 s of steady, timely samples here as well; until then `enable` says what is missing."""
    pair = scene("at rest")
    pair.robot.inject({"fault": "arm_disabled", "side": "left", "duration_s": 1.5}, pair.now_ns)
    pair.run_until(lambda: pair.state == "HOLDING", 1.5)
    pair.run(3.0)
    pair.late_ns = 60 * MS
    pair.step(pair.now_ns + 60 * MS)
    refusal = pair.refused(Enable(epoch=pair.epoch), "ann")
    assert refusal.code is Code.PART_STALE and refusal.field == "left_arm" and pair.streaming == [Side.RIGHT]


def test_an_arm_that_is_disabled_while_enabling_is_left_out() -> None:
    """One arm disabled in ENABLING: the other one gets READY."""
    pair = scene("ENABLING")
    pair.disable_arm(Side.RIGHT)
    pair.run_until(lambda: pair.state == "ACTIVE")
    assert pair.streaming == [Side.LEFT]


@pytest.mark.parametrize(
    ("sim", "sides"),
    [
        (SimSettings(state_period_ns=10 * MS, right_mode="pose"), [Side.LEFT]),
        (SimSettings(state_period_ns=10 * MS, enable_left_arm=False), [Side.RIGHT]),
    ],
)
def test_only_arms_that_are_enabled_in_joint_mode_are_streamed(sim: SimSettings, sides: list[Side]) -> None:
    """On a mixed robot the other arm gets no joint setpoints, and a motion of it is refused with the reason."""
    pair = scene("at rest", Scene(sim))
    assert pair.streaming == sides and {frame.topic for _, frame in pair.frames} == {
        robot.joint_command(sides[0]),
        robot.FSM_ENABLE,
    }
    refusal = pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert refusal.code in {Code.WRONG_CONTROL_MODE, Code.ARM_DISABLED}
    pair.granted(Move(epoch=pair.epoch, targets_rad={sides[0]: away(pair, sides[0])}), "ann")


@pytest.mark.parametrize(
    ("sim", "code"),
    [
        (SimSettings(state_period_ns=10 * MS, left_mode="pose", right_mode="pose"), Code.WRONG_CONTROL_MODE),
        (SimSettings(state_period_ns=10 * MS, enable_left_arm=False, enable_right_arm=False), Code.NO_ARM_ENABLED),
    ],
)
def test_enable_needs_an_enabled_arm_in_joint_mode(sim: SimSettings, code: Code) -> None:
    """Refused with the reason, and the robot stays as it is."""
    pair = scene("IDLE", Scene(sim))
    assert pair.refused(Enable(epoch=pair.epoch), "ann").code is code
    assert pair.frames == []


# ----------------------------------------------------------------------------------------------------------- enable


def test_enable_succeeds_when_it_is_under_way_or_done_and_sends_nothing() -> None:
    """In ENABLING and ACTIVE; the outcome tells which."""
    pair = scene("ENABLING")
    attempt = pair.granted(Enable(epoch=pair.epoch), "ann")
    assert attempt["outcome"] == "running"
    pair.run_until(lambda: pair.state == "ACTIVE")
    again = pair.granted(Enable(epoch=pair.epoch), "ann")
    assert again["outcome"] == "ok" and again["attempt"] == attempt["attempt"]
    pair.run(0.2)
    assert pair.state == "ACTIVE" and pair.arm_kinds() <= {FrameKind.ECHO, FrameKind.HOLD} and set(pair.beats) == {1.0}


@pytest.mark.parametrize("value", [1, 2, 3, 6, 9, -1])
def test_enable_is_refused_while_the_fsm_is_not_in_pause(value: int) -> None:
    """FSM 1-2 without our 1.0, 3-6 and unknown values: FSM_BUSY; ERROR: FSM_ERROR."""
    pair = scene("IDLE")
    pair.robot.inject({"fault": "fsm_value", "value": value}, pair.now_ns)
    pair.run(0.1)
    refusal = pair.refused(Enable(epoch=pair.epoch), "ann")
    assert refusal.code is (Code.FSM_ERROR if value == -1 else Code.FSM_BUSY) and str(value) in refusal.message
    assert pair.state == "IDLE" and pair.frames == []


def test_enable_is_refused_while_fsm_state_is_not_heard() -> None:
    """`fsm_state` dead: refuse enable."""
    pair = scene("IDLE")
    pair.robot.inject({"fault": "drop", "topic": robot.FSM_STATE}, pair.now_ns)
    pair.run(0.6)
    assert pair.refused(Enable(epoch=pair.epoch), "ann").code is Code.FSM_UNKNOWN


def test_enable_is_refused_while_the_mode_is_not_known() -> None:
    """MODE_UNKNOWN after 3 s without `/api/current_mode`."""
    pair = scene("IDLE")
    pair.robot.inject({"fault": "drop", "topic": robot.CURRENT_MODE}, pair.now_ns)
    pair.run(4.1)
    assert pair.refused(Enable(epoch=pair.epoch), "ann").code is Code.MODE_UNKNOWN


def test_enable_is_refused_while_an_arms_state_is_dead() -> None:
    """PART_STALE, with the arm."""
    pair = scene("IDLE")
    pair.robot.inject({"fault": "drop", "topic": HEARD[Side.RIGHT]}, pair.now_ns)
    pair.run(0.2)
    refusal = pair.refused(Enable(epoch=pair.epoch), "ann")
    assert refusal.code is Code.PART_STALE and refusal.field == "right_arm"


def test_enable_waits_until_the_last_0_0_was_heard() -> None:
    """While 0.0 is being sent nothing is enabled, and the refusal says so."""
    pair = scene("ENABLING")
    pair.tell(Disable(epoch=pair.epoch), "ann")
    refusal = pair.refused(Enable(epoch=pair.epoch), "ann")
    assert refusal.code is Code.FSM_BUSY and "0.0" in refusal.message


def test_an_enabling_ends_when_somebody_else_enables_first() -> None:
    """FSM 1 before our first 1.0: FSM_BUSY, and no 0.0 of ours pauses the other program."""
    pair = scene("IDLE")
    pair.late_ns = 60 * MS
    pair.step(pair.now_ns + 60 * MS)  # so that seeding takes 0.3 s
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run(0.1)
    pair.mark()
    pair.robot.inject({"fault": "fsm_value", "value": 1}, pair.now_ns)
    pair.run(0.2)
    assert pair.state == "IDLE" and pair.beats == [] and pair.arm_frames() == []
    assert "somebody else enables" in " ".join(pair.told(Code.STATE_CHANGED))


def test_an_enabling_lasts_at_most_10_s_and_says_what_was_missing() -> None:
    """ENABLE_TIMEOUT: the robot stayed in SLOW_START; it is paused again."""
    pair = scene("ENABLING", Scene(snapshot_hz=50))
    pair.robot.inject({"fault": "fsm_value", "value": 1}, pair.now_ns)
    pair.run(9.0)
    assert pair.state == "ENABLING"
    pair.run_until(lambda: pair.state == "IDLE", 1.5)
    enable = pair.see().enable
    assert (enable.outcome, enable.code) == ("failed", "ENABLE_TIMEOUT")
    assert "10 s" in enable.message and "SLOW_START" in enable.message
    assert pair.beats[-1] == 0.0


def test_an_enabling_without_steady_state_says_so_and_sends_nothing() -> None:
    """What was missing: 0.3 s of steady, timely state; no 1.0 was out, so no 0.0 is owed."""
    pair = scene("IDLE", Scene(snapshot_hz=50))
    pair.robot.inject({"fault": "delay", "topic": HEARD[Side.LEFT], "delay_s": 0.25}, pair.now_ns)
    pair.run(1.0)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "IDLE", 10.5)
    enable = pair.see().enable
    assert enable.code == "ENABLE_TIMEOUT" and "steady, timely state from the left arm" in enable.message
    assert pair.frames == []


def test_a_heartbeat_that_does_nothing_is_told_once_with_what_is_known_of_its_way() -> None:
    """1.0 out for more than 1.5 s while the FSM stays PAUSE: HEARTBEAT_NOT_EFFECTIVE."""
    pair = scene("IDLE")
    pair.robot.inject({"fault": "pause"}, pair.now_ns)
    pair.robot.fsm.is_held = True
    says = RouteObserved(topic=robot.FSM_ENABLE, code=None, message="inactive", at_ns=pair.now_ns)
    pair.receive(says)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: bool(pair.beats))
    pair.run(1.45)
    assert not pair.told(Code.HEARTBEAT_NOT_EFFECTIVE)
    pair.run(3.0)
    (message,) = pair.told(Code.HEARTBEAT_NOT_EFFECTIVE)
    assert "/api/fsm/enable: inactive" in message and pair.state == "ENABLING"


@pytest.mark.parametrize("ending", ["disable", "release", "other"])
def test_every_way_out_of_enabling_names_its_reason(ending: str) -> None:
    """The outcome of an `enable` that failed has a code and a message."""
    pair = scene("ENABLING", Scene(snapshot_hz=50))
    if ending == "other":
        pair.granted(Acquire(name="ann", pid=1), "ann")
        pair.granted(Stop(reason="dog"), "bob")
    else:
        pair.granted({"disable": Disable, "release": Release}[ending](epoch=pair.epoch), "ann")
    enable = pair.see().enable
    assert (enable.outcome, enable.code) == ("failed", "STOPPED") and enable.message
