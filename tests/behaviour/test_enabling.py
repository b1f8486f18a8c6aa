"""BEHAVIOUR, Starting and continuing: what `enable` demands, says and leaves out, and arms that come and go."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gateway.core.messages.events import RouteObserved
from gateway.core.messages.outputs import FrameKind
from gateway.errors import Code
from gateway.messages.requests import Acquire, Disable, Enable, Move, Release, SetGripper, Stop
from gateway.robot.topics import (
    CHASSIS_STATE,
    CURRENT_MODE,
    FSM_ENABLE,
    FSM_STATE,
    arm_state,
    gripper_command,
    joint_command,
)
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side
from tests.behaviour.scene import HOME, LEAN, Scene, away, scene
from tests.pair import MS

HEARD = {side: arm_state(side) for side in Side}


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
    pair.topics = (*LEAN, CHASSIS_STATE)
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


@pytest.mark.parametrize("then", ["move", "grip", "disable", "release"])
def test_an_arm_that_joins_may_be_followed_at_once_by_the_next_request(then: str) -> None:
    """In the same tick: its first frames are echoes in whatever state that leads to, and no violation."""
    pair = scene("at rest")
    pair.robot.inject({"fault": "arm_disabled", "side": "left", "duration_s": 1.5}, pair.now_ns)
    pair.run_until(lambda: pair.state == "HOLDING", 1.5)
    pair.run(3.0)
    pair.mark()
    requests = {
        "move": Move(epoch=pair.epoch, targets_rad={Side.RIGHT: away(pair, Side.RIGHT)}),
        "grip": SetGripper(epoch=pair.epoch, side=Side.RIGHT, raw=0.3),
        "disable": Disable(epoch=pair.epoch),
        "release": Release(epoch=pair.epoch),
    }
    pair.tell(Enable(epoch=pair.epoch), "ann")
    pair.tell(requests[then], "ann")
    pair.run(0.1)
    assert pair.told(Code.GATE_VIOLATION) == [] and pair.told(Code.LATCHED) == []
    assert pair.state == {"move": "ACTIVE", "grip": "ACTIVE", "disable": "IDLE", "release": "READ_ONLY"}[then]


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
        (SimSettings(state_period_ns=10 * MS, enable_right_arm=False), [Side.LEFT]),
        (SimSettings(state_period_ns=10 * MS, enable_left_arm=False), [Side.RIGHT]),
    ],
)
def test_only_arms_that_are_enabled_are_streamed(sim: SimSettings, sides: list[Side]) -> None:
    """The other arm gets no setpoints, and a motion of it is refused with the reason."""
    pair = scene("at rest", Scene(sim))
    assert pair.streaming == sides and {frame.topic for _, frame in pair.frames} == {
        joint_command(sides[0]),
        gripper_command(sides[0]),
        FSM_ENABLE,
    }
    refusal = pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert refusal.code is Code.ARM_DISABLED
    pair.granted(Move(epoch=pair.epoch, targets_rad={sides[0]: away(pair, sides[0])}), "ann")


def test_enable_needs_an_enabled_arm() -> None:
    """Refused with the reason, and the robot stays as it is."""
    sim = SimSettings(state_period_ns=10 * MS, enable_left_arm=False, enable_right_arm=False)
    pair = Scene(sim)
    pair.topics = (*LEAN, CHASSIS_STATE)  # nothing of the arms comes, but the chassis
    pair = scene("IDLE", pair)
    assert pair.refused(Enable(epoch=pair.epoch), "ann").code is Code.NO_ARM_ENABLED
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
    pair.robot.inject({"fault": "drop", "topic": FSM_STATE}, pair.now_ns)
    pair.run(0.6)
    assert pair.refused(Enable(epoch=pair.epoch), "ann").code is Code.FSM_UNKNOWN


def test_enable_is_refused_while_the_mode_is_not_known() -> None:
    """MODE_UNKNOWN after 3 s without `/api/current_mode`."""
    pair = scene("IDLE")
    pair.robot.inject({"fault": "drop", "topic": CURRENT_MODE}, pair.now_ns)
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
    says = RouteObserved(topic=FSM_ENABLE, code=None, message="inactive", at_ns=pair.now_ns)
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
