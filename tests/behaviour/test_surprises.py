"""BEHAVIOUR, The robot does something by itself: samples that cannot be right, in every state. None moves, each tells why.

The table says what must be *seen*, in the words of `test_transitions.py`. What the robot's FSM, modes and silences do is
judged there, cell by cell; here it is what the samples of one arm do: from when the gateway can know of it.
"""

from __future__ import annotations

from functools import lru_cache

import pytest

from gateway.codes import Code
from gateway.core.messages.events import LinkUp, SampleRefused
from gateway.core.messages.outputs import FrameKind
from gateway.messages.requests import Enable, Move
from gateway.robot.topics import CURRENT_MODE, STATE_TOPICS, arm_state, ee_pose, joint_command
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side
from tests.behaviour.scene import HOME, Scene, away, scene
from tests.behaviour.test_transitions import WORDS
from tests.pair import MS, S
from tests.thoroughness import crossed

LEFT = arm_state(Side.LEFT)
STATES = ("READ_ONLY", "VR", "IDLE", "ENABLING", "at rest", "ACTIVE", "HOLDING", "PAUSED", "STOPPING")

DEAD = {
    "READ_ONLY": "nothing",
    "VR": "nothing",
    "IDLE": "nothing",
    "ENABLING": "down",
    "at rest": "hold",
    "ACTIVE": "hold",
    "HOLDING": "=",
    "PAUSED": "=",
    "STOPPING": "stops",
}
"""What is seen in each state when an arm's samples are not believed for 100 ms: the row "one part's state dead"."""

LASTING = {
    "a jump": {"fault": "jump", "side": "left", "joint": 2, "delta_rad": 0.6},
    "NaN": {"fault": "nan", "topic": LEFT},
    "a joint too few": {"fault": "short", "topic": LEFT},
    "one stamp for ever": {"fault": "freeze", "topic": LEFT},
}
SAID = {"a jump": "away from where it was", "NaN": "nan", "a joint too few": "7", "one stamp for ever": "not newer"}
"""What the reason must name."""

HARMLESS = {
    "reordered": {"fault": "reorder", "topic": LEFT},
    "three times": {"fault": "duplicate", "topic": LEFT, "copies": 3},
    "clock an hour on": {"fault": "clock_step", "step_s": 3600.0},
    "clock an hour back": {"fault": "clock_step", "step_s": -3600.0},
}


def watched(state: str) -> Scene:
    """Return a scene whose snapshots come at 50 Hz."""
    return scene(state, Scene(snapshot_hz=50))


def _let_it_last(pair: Scene, fault: dict) -> None:
    """Judge from the tick in which the last believed sample is too old. ENABLING is kept from ending meanwhile."""
    if pair.state == "ENABLING":
        pair.robot.inject({"fault": "fsm_value", "value": 1}, pair.now_ns)
    pair.robot.inject(fault, pair.now_ns)
    if fault["fault"] == "freeze":
        pair.step()  # the sample that is repeated from now on
    believed_ns = pair.heard[LEFT].received_ns
    while pair.now_ns - believed_ns <= 100 * MS:
        pair.mark_ns = pair.now_ns + 1
        pair.step()
    pair.robot.clear("fsm_value")


def _reasons(pair: Scene) -> list[str]:
    """Return what a user can read: findings, why the enabling failed, notices."""
    seen = pair.see()
    return [*(finding.message for finding in seen.findings), seen.enable.message, *(n.message for n in pair.notices)]


@pytest.mark.parametrize(("name", "state"), crossed(LASTING, STATES))
def test_samples_that_cannot_be_right_make_the_part_dead_in_every_state(name: str, state: str) -> None:
    """As when nothing came: braked, held or down; the reason is said; and when it ends, nothing moves by itself."""
    pair = watched(state)
    _let_it_last(pair, LASTING[name])
    WORDS[DEAD[state]](pair)
    pair.run(0.5)
    assert any(SAID[name] in text for text in _reasons(pair))
    if name == "a jump":  # by now it is the new truth: an encoder was set, or the first one was wrong
        assert len(pair.told(Code.STATE_JUMPED)) == 1 and pair.see().topics[LEFT].age_ns < 50 * MS
    else:
        assert "SAMPLE_REFUSED" in [finding.code for finding in pair.see().findings]
    pair.robot.clear()
    pair.run(1.0)
    assert not pair.moved() and pair.state != "ACTIVE"


@lru_cache
def _calm(state: str) -> Scene:
    """Return how it looks when nothing happens."""
    pair = watched(state)
    pair.run(0.6)
    return pair


@pytest.mark.parametrize(("name", "state"), crossed(HARMLESS, STATES))
def test_stamps_that_repeat_jump_or_come_in_another_order_change_nothing(name: str, state: str) -> None:
    """A late or repeated sample is counted and not used; a clock that is set is another clock, not a loss."""
    pair, calm = watched(state), _calm(state)
    pair.robot.inject(HARMLESS[name], pair.now_ns)
    pair.run(0.6)
    assert pair.state == calm.state and not pair.engine.latches
    assert pair.arm_kinds() == calm.arm_kinds() and pair.beats == calm.beats
    for side in pair.streaming:
        assert pair.gap_ms(joint_command(side)) <= 11
    assert max((*pair.speeds(), 0.0)) <= 1.01  # a value out of turn moved nothing faster than allowed
    if name in ("reordered", "three times"):
        assert pair.see().topics[LEFT].refused >= 10


@pytest.mark.parametrize("state", [*STATES, "STALE"])
def test_a_robot_that_restarted_is_another_one_in_every_state(state: str) -> None:
    """Another router: as transport lost; the lease is kept, nothing is sent, nothing resumes; said."""
    pair = watched(state)
    owner = pair.owner
    pair.receive(LinkUp(router_zid="bb", at_ns=pair.now_ns))
    assert pair.state == "OFFLINE"
    pair.mark_ns = pair.now_ns + 1
    pair.is_deaf = True
    pair.run(0.2)
    assert pair.state in {"OFFLINE", "STALE"} and pair.arm_frames() == [] and pair.beats == []
    assert pair.told(Code.ROBOT_RESTARTED)
    pair.is_deaf = False
    pair.run(1.5)
    assert pair.arm_frames() == [] and 1.0 not in pair.beats and pair.owner == owner
    assert pair.state in {"IDLE", "READ_ONLY"}


# ------------------------------------------------------------------------------------------------- a jump that stays


def test_a_jump_while_holding_is_held_on_and_not_followed() -> None:
    """The reference stays; motion is refused with value and bound until the owner has the reference walk to the arm."""
    pair = watched("HOLDING")
    before = pair.arm_frames_now()
    pair.robot.inject({"fault": "jump", "side": "left", "joint": 2, "delta_rad": -0.6}, pair.now_ns)
    pair.run(3.0)
    assert pair.state == "HOLDING" and pair.arm_frames_now() == before and pair.arm_kinds() == {FrameKind.HOLD}
    refusal = pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert refusal.code is Code.TRACKING_ERROR and float(refusal.value) == pytest.approx(0.6, abs=0.02)
    assert refusal.bound == "0.3" and "enable" in refusal.hint
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run(0.05)
    assert pair.arm_kinds(Side.LEFT) == {FrameKind.HOLD, FrameKind.WALK} and FrameKind.WALK not in pair.arm_kinds(
        Side.RIGHT
    )


def test_a_small_jump_is_within_what_an_arm_does() -> None:
    """0.1 rad is no more than noise and time allow: the stream goes on from its setpoint, whatever is measured."""
    pair = watched("HOLDING")
    before = pair.arm_frames_now()
    pair.robot.inject({"fault": "jump", "side": "left", "joint": 2, "delta_rad": 0.1}, pair.now_ns)
    pair.run(1.0)
    assert pair.arm_frames_now() == before and pair.see().topics[LEFT].refused == 0
    pair.mark()
    pair.granted(Move(epoch=pair.epoch, targets_rad={Side.LEFT: away(pair, Side.LEFT)}), "ann")
    pair.run(0.5)
    assert max(pair.speeds()) <= 1.01


@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_a_jump_by_what_an_arm_can_do_in_the_time_is_believed(speed: float) -> None:
    """After a gap an arm may be elsewhere: the bound grows with the time since the last believed sample, to its death."""
    pair = watched("HOLDING")
    pair.robot.inject({"fault": "drop", "topic": LEFT, "duration_s": 0.08}, pair.now_ns)
    pair.robot.inject({"fault": "jump", "side": "left", "joint": 2, "delta_rad": 0.08 * speed}, pair.now_ns)
    pair.run(0.3)
    assert pair.see().topics[LEFT].refused == 0 and pair.state == "HOLDING"


@pytest.mark.parametrize("state", ["IDLE", "PAUSED"])
def test_after_a_jump_that_stays_a_stream_starts_where_the_arm_says_it_is(state: str) -> None:
    """No first setpoint is further than 0.01 rad from what is measured then (§1.3)."""
    pair = watched(state)
    pair.robot.inject({"fault": "jump", "side": "left", "joint": 2, "delta_rad": -0.6}, pair.now_ns)
    pair.run(1.5)
    pair.mark()
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: FrameKind.ECHO in pair.arm_kinds(Side.LEFT), 1.0)
    first = next(frame for _, frame in pair.arm_frames(Side.LEFT) if frame.kind is FrameKind.ECHO)
    measured = pair.heard[LEFT].value.q_rad
    assert max(abs(a - b) for a, b in zip(first.values, measured, strict=True)) < 0.01


def test_a_single_glitch_is_nothing_in_any_state() -> None:
    """One sample of 0.6 rad, one NaN: counted; the stream, the motion and the state go on."""
    for state in ("ENABLING", "ACTIVE", "HOLDING", "PAUSED"):
        for fault in (LASTING["a jump"], LASTING["NaN"]):
            pair = watched(state)
            pair.robot.inject({**fault, "duration_s": 0.012}, pair.now_ns)
            pair.run(0.08)
            assert pair.state == state and 1 <= pair.see().topics[LEFT].refused <= 3


def test_a_mode_that_cannot_be_read_is_unknown_after_3_s_with_the_reason() -> None:
    """`/api/current_mode` as garbage: as if it had not come, and what is wrong with it is said."""
    pair = watched("at rest")
    pair.topics = tuple(topic for topic in pair.topics if topic != CURRENT_MODE)
    for _ in range(35):
        pair.receive(
            SampleRefused(topic=CURRENT_MODE, code=Code.SAMPLE_REFUSED, message="not JSON: x", received_ns=pair.now_ns)
        )
        pair.run(0.1)
    assert pair.state == "HOLDING"
    assert pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann").code is Code.MODE_UNKNOWN
    (finding,) = [finding for finding in pair.see().findings if finding.code == "SAMPLE_REFUSED"]
    assert "not JSON" in finding.message and finding.facts["silent_s"] * S > 3 * S


@pytest.mark.parametrize("fault", ["jump", "nan", "drop"])
def test_an_arm_in_end_effector_mode_is_held_when_its_pose_cannot_be_right(fault: str) -> None:
    """A jump, NaN or silence of `current_ee_pose` is the part's: both arms hold, and the reason is said."""
    pair = Scene(SimSettings(state_period_ns=10 * MS, right_mode="pose"), snapshot_hz=50)
    pair.topics = STATE_TOPICS
    pair = scene("at rest", pair)
    topic = ee_pose(Side.RIGHT)
    faults = {"jump": {"fault": "jump", "side": "right", "joint": 2, "delta_rad": 0.6}}
    pair.robot.inject(faults.get(fault, {"fault": fault, "topic": topic}), pair.now_ns)
    pair.run_until(lambda: pair.state == "HOLDING", 0.15)
    pair.mark()
    pair.run(0.6)
    assert pair.state == "HOLDING" and not pair.moved() and set(pair.beats) == {1.0}
    if fault == "jump":
        assert any(topic in message and "position" in message for message in pair.told(Code.STATE_JUMPED))
    else:
        (seen,) = [finding for finding in pair.see().findings if topic in finding.message]
        assert seen.code == ("SAMPLE_REFUSED" if fault == "nan" else "ROUTE_SUSPECT")
