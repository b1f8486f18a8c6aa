"""BEHAVIOUR, The robot does something by itself: pauses, modes, samples that cannot be believed, another robot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest

from gateway.core.messages.events import SampleArrived, SampleRefused
from gateway.core.messages.outputs import FrameKind
from gateway.errors import Code
from gateway.messages.requests import Enable, Estop, Move, Recover, Release, Stop
from gateway.robot.topics import CURRENT_MODE, FSM_STATE, arm_state, joint_command
from gateway.values import Side
from tests.behaviour.scene import HOME, Scene, away, scene
from tests.pair import MS
from tests.thoroughness import crossed

LEFT = arm_state(Side.LEFT)


# ----------------------------------------------------------------------------------------------------------- pauses


@pytest.mark.parametrize("state", ["ACTIVE", "HOLDING"])
def test_a_robot_that_pauses_by_itself_is_held_in_pause(state: str) -> None:
    """Somebody may have pressed the physical stop: no 1.0, 0.0 until FSM 0, arm streams as in HOLDING; told."""
    pair = scene(state)
    pair.robot.inject({"fault": "pause"}, pair.now_ns)
    pair.run_until(lambda: pair.state == "PAUSED", 0.1)
    pair.mark_ns = pair.now_ns
    pair.run(1.0)
    assert pair.state == "PAUSED" and 1.0 not in pair.beats and not pair.moved()
    assert len(pair.beats) <= 4 and all(pair.gap_ms(joint_command(side)) <= 11 for side in Side)
    assert "paused by itself" in pair.told(Code.STATE_CHANGED)[-1]
    assert pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann").code is Code.ROBOT_PAUSED


def test_a_pause_too_short_to_be_seen_is_a_pause() -> None:
    """READY -> SLOW_START: our own 1.0 restarted it; 0.0 follows until FSM 0, and the owner must enable again."""
    pair = scene("ACTIVE")
    pair.robot.fsm.pause()
    pair.robot.fsm.enable(1.0, pair.robot.now_ns)  # between two samples of /fsm_state
    pair.run_until(lambda: pair.state == "PAUSED", 0.2)
    assert "too short to be seen" in pair.told(Code.STATE_CHANGED)[-1]
    pair.run(0.5)
    assert pair.fsm == 0 and pair.beats[-1] == 0.0 and pair.state == "PAUSED"
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE")


def test_somebody_who_enables_a_paused_robot_is_paused() -> None:
    """FSM READY or 1 in PAUSED: 0.0, until the owner enables."""
    pair = scene("PAUSED")
    pair.robot.fsm.enable(1.0, pair.robot.now_ns)
    pair.run(0.5)
    assert pair.state == "PAUSED" and pair.fsm == 0 and 0.0 in pair.beats


def test_a_pause_while_stopping_is_what_was_asked_for() -> None:
    """Nobody says that the robot paused by itself when our own 0.0 made it."""
    for request in (Release, None):
        pair = scene("STOPPING") if request is None else scene("HOLDING")
        if request is not None:
            pair.granted(request(epoch=pair.epoch), "ann")
        pair.run(2.0)
        told = " ".join(pair.told(Code.STATE_CHANGED))
        assert "by itself" not in told and "as our 0.0 asked for" in told


def test_a_pause_that_our_1_0_undid_while_stopping_is_followed_by_0_0() -> None:
    """The arms still brake under 1.0, which restarts a robot that has paused by itself before its FSM 0 is here."""
    pair = scene("STOPPING")
    pair.robot.fsm.pause()
    pair.robot.fsm.enable(1.0, pair.robot.now_ns)
    pair.receive(SampleArrived(topic=FSM_STATE, value=0, received_ns=pair.now_ns))  # it was under way
    pair.step()
    pair.goes_down()


def test_an_enabled_robot_that_falls_back_while_enabling_is_paused_again() -> None:
    """From SLOW_START to PAUSE: down, and the outcome says ROBOT_PAUSED."""
    pair = scene("ENABLING", Scene(snapshot_hz=50))
    pair.robot.inject({"fault": "fsm_value", "value": 0}, pair.now_ns)
    pair.run_until(lambda: pair.state == "IDLE", 0.2)
    enable = pair.see().enable
    assert (enable.outcome, enable.code) == ("failed", "ROBOT_PAUSED")
    assert pair.beats[-1] == 0.0


def test_a_robot_whose_fsm_is_not_heard_is_held_in_pause() -> None:
    """`fsm_state` dead for 0.5 s: PAUSED, with 0.0 for at most 2 s; `enable` when it is heard again."""
    pair = scene("at rest")
    pair.robot.inject({"fault": "drop", "topic": FSM_STATE, "duration_s": 4.0}, pair.now_ns)
    pair.run(0.4)
    assert pair.state == "ACTIVE"
    pair.run_until(lambda: pair.state == "PAUSED", 0.2)
    pair.mark()
    pair.run(3.0)
    assert 40 <= len(pair.beats) <= 41 and set(pair.beats) == {0.0}
    assert pair.refused(Enable(epoch=pair.epoch), "ann").code is Code.FSM_UNKNOWN
    pair.run(1.0)
    pair.granted(Enable(epoch=pair.epoch), "ann")


def test_a_paused_owner_can_still_go_down_when_0_0_found_no_hearing() -> None:
    """A repetition that ended without FSM 0 is not begun anew by the level, but is by `release`."""
    pair = scene("PAUSED")
    pair.robot.inject({"fault": "fsm_value", "value": 2}, pair.now_ns)
    pair.run(4.0)
    assert 40 <= len(pair.beats) <= 42 and len(pair.told(Code.STOP_NOT_EFFECTIVE)) == 1
    pair.mark()
    pair.granted(Release(epoch=pair.epoch), "ann")
    pair.run(0.2)
    assert set(pair.beats) == {0.0} and len(pair.beats) >= 4


# ------------------------------------------------------------------------------------------------------------ modes


def test_an_unknown_mode_brakes_and_refuses_motion() -> None:
    """MODE_UNKNOWN after 3 s without `/api/current_mode`: HOLDING; motion again when it is heard."""
    pair = scene("at rest")
    stream = pair.stream(pair.epoch, Side.LEFT, "ann")
    pair.robot.inject({"fault": "drop", "topic": CURRENT_MODE, "duration_s": 5.0}, pair.now_ns)
    for n in range(400):
        pair.target(pair.epoch, stream, away(pair, Side.LEFT, 0.01 * (n % 2)), "ann")
        pair.step()
    assert pair.state == "HOLDING"
    assert pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann").code is Code.MODE_UNKNOWN
    pair.run(2.0)
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")


@pytest.mark.parametrize("state", ["ENABLING", "ACTIVE", "HOLDING", "PAUSED"])
def test_vr_mode_gets_no_arm_frame_no_1_0_and_no_0_0(state: str) -> None:
    """The FSM's topic bypasses the MUX (§3.1.1): a 0.0 would pause the VR operator."""
    pair = scene(state)
    pair.robot.inject({"fault": "vr_mode"}, pair.now_ns)
    pair.tell_mode(api=False)
    pair.run(2.0)
    assert pair.state == "READ_ONLY" and pair.arm_frames() == [] and pair.beats == []
    assert pair.refused(Enable(epoch=pair.epoch), "ann").code is Code.MODE_VR
    pair.granted(Estop(), "bob")
    assert pair.beats == [0.0]


@pytest.mark.parametrize("value", [3, 4, 5, 6, 7, -2])
def test_a_robot_that_plays_or_is_driven_by_vr_gets_nothing(value: int) -> None:
    """FSM 3-6 and unknown values: off."""
    pair = scene("ACTIVE", Scene(snapshot_hz=50))
    pair.robot.inject({"fault": "fsm_value", "value": value}, pair.now_ns)
    pair.run_until(lambda: pair.state == "IDLE", 0.1)
    pair.mark()
    pair.run(1.0)
    assert pair.arm_frames() == [] and pair.beats == [] and pair.see().motions[0].code == "FSM_BUSY"


def test_the_last_arm_that_leaves_its_mode_takes_everything_down() -> None:
    """Nothing is held any more, though the arms are enabled in the other mode: down."""
    pair = scene("at rest")
    pair.disable_arm(Side.LEFT, as_mode=True)
    pair.step()
    assert pair.state == "HOLDING" and pair.streaming == [Side.RIGHT]
    pair.robot.inject({"fault": "control_mode", "side": "right", "mode": "pose"}, pair.now_ns)
    pair.tell_mode(joint_mode=dict.fromkeys(Side, False))
    pair.mark()
    pair.step()
    pair.goes_down()


def test_the_last_streamed_arm_that_is_disabled_takes_everything_down() -> None:
    """The other one is enabled again, but not streamed: nothing is held, so nothing must stay armed."""
    pair = scene("at rest")
    pair.disable_arm(Side.LEFT)
    pair.step()
    pair.tell_mode(arm_enabled={Side.LEFT: True, Side.RIGHT: False})
    pair.mark()
    pair.run(0.02)
    assert pair.state == "IDLE" and 0.0 in pair.beats


# ---------------------------------------------------------------------------------------------------------- samples


@pytest.mark.parametrize(
    "fault",
    [
        {"fault": "jump", "side": "left", "joint": 2, "delta_rad": 0.6},
        {"fault": "nan", "topic": LEFT},
        {"fault": "short", "topic": LEFT},
    ],
    ids=["jump", "NaN", "wrong length"],
)
def test_samples_that_cannot_be_believed_are_counted_and_the_part_goes_dead_if_they_last(fault: dict) -> None:
    """One is nothing; more than 100 ms of them brakes and holds."""
    pair = scene("ACTIVE", Scene(snapshot_hz=50))
    pair.robot.inject({**fault, "duration_s": 0.05}, pair.now_ns)
    pair.run(0.15)
    assert pair.state == "ACTIVE" and pair.see().topics[LEFT].refused >= 3
    pair.robot.inject({**fault, "duration_s": 0.2}, pair.now_ns)
    pair.run_until(lambda: pair.state == "HOLDING", 0.13)
    assert pair.see().motions[0].code == "PART_LOST"


@pytest.mark.parametrize("state", ["READ_ONLY", "IDLE", "ACTIVE", "STALE"])
def test_joint_names_in_another_order_are_latched(state: str) -> None:
    """The robot never reorders, so this is not our robot (manual §4.0.3); said once, cleared by `recover`."""
    pair = scene(state)
    pair.robot.inject({"fault": "drop", "topic": LEFT, "duration_s": 0.1}, pair.now_ns)
    for _ in range(8):
        pair.run(0.01)
        at_ns = pair.now_ns
        pair.receive(SampleRefused(topic=LEFT, code=Code.JOINT_ORDER, message="names are swapped", received_ns=at_ns))
    pair.run(0.5)
    assert pair.engine.latches == {Code.JOINT_ORDER: "names are swapped"} and pair.streaming == []
    assert len(pair.told(Code.LATCH_CHANGED)) == 1
    pair.is_deaf = False
    pair.run(1.2)
    assert pair.granted(Recover(), "bob") == {"cleared": ["JOINT_ORDER"]}


def test_joint_names_of_a_few_samples_latch_nothing() -> None:
    """A connection that comes back may bring the other arm's: they are refused, and the arm goes on by those around them."""
    pair = scene("ACTIVE", Scene(snapshot_hz=50))
    pair.robot.inject({"fault": "wrong_names", "topic": LEFT, "duration_s": 0.04}, pair.now_ns)
    pair.run(0.5)
    assert pair.state == "ACTIVE" and not pair.engine.latches and pair.see().topics[LEFT].refused >= 3


# ------------------------------------------------------------------------------------------------------------- FSM


def test_an_fsm_error_while_nothing_of_ours_ran_is_a_condition() -> None:
    """It refuses `enable` while it lasts, and nothing is latched."""
    pair = scene("IDLE")
    pair.robot.inject({"fault": "fsm_error", "duration_s": 0.5}, pair.now_ns)
    pair.run(0.2)
    assert pair.refused(Enable(epoch=pair.epoch), "ann").code is Code.FSM_ERROR and not pair.engine.latches
    pair.run(0.6)
    pair.granted(Enable(epoch=pair.epoch), "ann")


def test_an_fsm_error_sends_0_0_and_latches() -> None:
    """Down with L; the motion ends with FSM_ERROR."""
    pair = scene("ACTIVE", Scene(snapshot_hz=50))
    pair.robot.inject({"fault": "fsm_error", "duration_s": 0.5}, pair.now_ns)
    pair.run_until(lambda: pair.state == "IDLE", 0.1)
    pair.mark_ns = pair.now_ns
    pair.run(1.5)
    assert set(pair.beats) == {0.0} and len(pair.beats) >= 8 and set(pair.engine.latches) == {Code.FSM_ERROR}
    assert pair.see().motions[0].code == "FSM_ERROR"


def test_an_error_that_shows_only_while_stale_is_latched_after_our_own_1_0() -> None:
    """The slow topics may still speak: FSM ERROR in STALE is ours if a 1.0 was out, else not."""
    for state, is_latched in (("STALE", True), ("IDLE", False)):
        pair = scene(state)
        pair.robot.inject({"fault": "fsm_error"}, pair.now_ns)
        pair.is_deaf, pair.topics = False, (FSM_STATE,)
        pair.run(0.3)
        assert pair.state == "STALE" and bool(pair.engine.latches) is is_latched


# --------------------------------------------------------------------------------------------------------- tracking


def test_an_arm_that_does_not_follow_is_latched_after_0_3_s() -> None:
    """More than 0.3 rad from its setpoint for 0.3 s: brake, HOLDING, L, with joint distance and bound."""
    pair = scene("at rest", Scene(snapshot_hz=50))
    pair.robot.inject({"fault": "blocked", "side": "left"}, pair.now_ns)
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    pair.mark()
    pair.run_until(lambda: pair.state == "HOLDING", 3.0)
    measured = pair.heard[LEFT].value.q_rad
    off_since = next(
        at_ns
        for at_ns, frame in pair.arm_frames(Side.LEFT)
        if max(abs(a - b) for a, b in zip(frame.values, measured, strict=True)) > 0.3
    )
    assert 290 * MS <= pair.now_ns - off_since <= 330 * MS
    assert "0.3 rad is the bound" in pair.engine.latches[Code.TRACKING_ERROR]
    assert pair.see().motions[0].code == "TRACKING_ERROR" and pair.see().shown == "FAULT"


FAR = {Side.LEFT: (*HOME[Side.LEFT][:3], 1.8, *HOME[Side.LEFT][4:]), Side.RIGHT: HOME[Side.RIGHT]}
"""So far away that the arms still move at full speed when one is found not to follow."""


def blocked(ends: str = "by itself") -> Scene:
    """Return a scene whose left arm met something on its way, until its motion has become a hold; both brake yet."""
    pair = scene("at rest", Scene(snapshot_hz=50))
    pair.robot.inject({"fault": "blocked", "side": "left"}, pair.now_ns)
    pair.granted(Move(epoch=pair.epoch, targets_rad=FAR), "ann")
    pair.mark()
    if ends != "by itself":
        pair.run_until(lambda: off_rad(pair) > 0.4, 3.0)
        pair.kill("ann") if ends == "client lost" else pair.granted(Stop(), ends)
    pair.run_until(lambda: pair.state == "HOLDING", 3.0)
    latched = {"by itself": Code.TRACKING_ERROR, "bob": Code.STOPPED_BY_OTHER}
    assert list(pair.engine.latches) == [code for end, code in latched.items() if end == ends]
    return pair


def off_rad(pair: Scene) -> float:
    """How far the left arm really is from its setpoint [rad]."""
    return float(np.max(np.abs(pair.robot.arms[Side.LEFT].q_rad - pair.arm_frames_now()[Side.LEFT])))


@pytest.mark.parametrize("ends", ["by itself", "ann", "bob", "client lost"])
def test_an_arm_that_met_something_presses_on_it_no_longer_and_flies_nowhere_once_it_is_free(ends: str) -> None:
    """Whatever ends the motion. Braked, then given way within 4 s: smoothly, without a gap, with the grip; latches stay."""
    pair = blocked(ends)
    latches = dict(pair.engine.latches)
    pair.run(4.5)
    frames = [frame.values for _, frame in pair.arm_frames(Side.LEFT)]
    rates = np.diff(np.asarray(frames), axis=0) / 0.01
    assert np.max(np.abs(rates)) <= 1.0 + 1e-6 and np.max(np.abs(np.diff(rates, axis=0))) / 0.01 <= 3.0 + 1e-6
    assert off_rad(pair) < 0.02 and pair.arm_kinds(Side.RIGHT) == {FrameKind.MOTION, FrameKind.BRAKE, FrameKind.HOLD}
    assert len(pair.told(Code.WALK)) == 1 and set(pair.beats) == {1.0} and pair.gap_ms(joint_command(Side.LEFT)) <= 11
    here = pair.robot.arms[Side.LEFT].q_rad.copy()
    pair.robot.clear()
    pair.run(1.0)
    assert np.allclose(pair.robot.arms[Side.LEFT].q_rad, here, atol=0.01)
    assert pair.engine.latches == latches and pair.state == "HOLDING"


def test_it_gives_way_once_and_holds_then() -> None:
    """An arm that is pushed on, or sinks under what it carries, is not followed further."""
    pair = blocked()
    pair.run(4.5)
    held = pair.arm_frames_now()[Side.LEFT]
    pair.push(Side.LEFT, 0.5)
    pair.run(1.0)
    assert pair.arm_frames_now()[Side.LEFT] == held and len(pair.told(Code.WALK)) == 1


@pytest.mark.parametrize("who", ["ann", "bob"])
@pytest.mark.parametrize("after_s", [0.1, 1.0])
def test_a_stop_ends_the_giving_way(who: str, after_s: float) -> None:
    """Anybody's, before it begins and under way: after a stop in the hold no setpoint changes but to brake."""
    pair = blocked()
    pair.run(after_s)
    pair.granted(Stop(), who)
    pair.run(0.4)
    pair.mark()
    pair.run(3.0)
    assert pair.arm_kinds() == {FrameKind.HOLD} and not pair.moved() and pair.state == "HOLDING"


def shaken(pair: Scene, seconds: float) -> None:
    """Let time pass while somebody shakes the left arm."""
    for n in range(round(seconds * 100)):
        pair.robot.arms[Side.LEFT].q_rad = pair.robot.arms[Side.LEFT].q_rad + (0.05 if n % 2 else -0.05)
        pair.run(0.01)


def test_it_gives_way_only_to_an_arm_that_stands_still() -> None:
    """While its samples do not agree where it is nobody knows: it waits for them."""
    pair = blocked()
    shaken(pair, 1.2)
    assert not pair.told(Code.WALK)
    pair.run_until(lambda: bool(pair.told(Code.WALK)), 0.2)
    pair.run(3.0)
    assert off_rad(pair) < 0.02


def test_it_gives_way_to_no_arm_that_was_not_heard_meanwhile() -> None:
    """Nobody saw what happened to it: it is held, until `enable` or `recover` asks for the walk."""
    pair = blocked()
    pair.robot.inject({"fault": "drop", "topic": LEFT, "duration_s": 0.3}, pair.now_ns)
    pair.run(4.0)
    assert not pair.told(Code.WALK) and off_rad(pair) > 0.5


def test_recover_in_the_middle_of_it_goes_on_with_it_and_motion_waits_for_the_end() -> None:
    """The latch is cleared at once; the owner moves on when the setpoint is where the arm is."""
    pair = blocked()
    pair.run(1.0)
    pair.robot.clear()
    pair.granted(Recover(), "bob")
    assert pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann").code is Code.STOPPING
    pair.run(3.0)
    assert not pair.engine.latches and off_rad(pair) < 0.3
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert pair.state == "ACTIVE"


def test_a_moment_away_from_the_setpoint_is_no_tracking_error() -> None:
    """Less than 0.3 s: nothing happens."""
    pair = scene("at rest")
    pair.robot.inject({"fault": "blocked", "side": "left"}, pair.now_ns)
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    pair.mark()
    measured = pair.heard[LEFT].value.q_rad
    pair.run_until(
        lambda: max(abs(a - b) for a, b in zip(pair.arm_frames_now()[Side.LEFT], measured, strict=True)) > 0.32, 3.0
    )
    pair.run(0.1)
    pair.robot.clear()
    pair.run(2.0)
    assert pair.state == "ACTIVE" and not pair.engine.latches


# ---------------------------------------------------------------------------------------------------------- notices


LASTING: dict[str, Callable[[Scene], object]] = {
    "part dead": lambda p: p.robot.inject({"fault": "drop", "topic": LEFT}, p.now_ns),
    "fsm dead": lambda p: p.robot.inject({"fault": "drop", "topic": FSM_STATE}, p.now_ns),
    "mode unknown": lambda p: p.robot.inject({"fault": "drop", "topic": CURRENT_MODE}, p.now_ns),
    "FSM ERROR": lambda p: p.robot.inject({"fault": "fsm_error"}, p.now_ns),
    "SLOW_START": lambda p: p.robot.inject({"fault": "fsm_value", "value": 1}, p.now_ns),
    "blocked": lambda p: p.robot.inject({"fault": "blocked", "side": "left"}, p.now_ns),
    "names": lambda p: p.robot.inject({"fault": "wrong_names", "topic": LEFT}, p.now_ns),
    "VR": lambda p: p.robot.inject({"fault": "vr_mode"}, p.now_ns),
    "one arm": lambda p: p.disable_arm(Side.LEFT),
    "both arms": lambda p: (p.disable_arm(Side.LEFT), p.disable_arm(Side.RIGHT)),
    "stale": lambda p: setattr(p, "is_deaf", True),
    "transport": lambda p: p.down(),
    "client": lambda p: p.kill("ann"),
    "stop": lambda p: (p.tell(Stop(), "bob"), p.robot.inject({"fault": "fsm_value", "value": 2}, p.now_ns)),
}
"""What happens and lasts."""


@pytest.mark.parametrize(("name", "state"), crossed(LASTING, ["ACTIVE", "HOLDING", "PAUSED", "IDLE"]))
def test_what_lasts_is_told_once(name: str, state: str) -> None:
    """Conditions are levels, looked at on every tick; people hear of each occurrence at most once."""
    pair = scene(state)
    LASTING[name](pair)
    pair.run(4.2)
    told = Counter((notice.code, notice.message) for notice in pair.notices)
    assert not told or max(told.values()) == 1, told.most_common(3)
    assert len(pair.notices) <= 8, Counter(notice.code for notice in pair.notices)
