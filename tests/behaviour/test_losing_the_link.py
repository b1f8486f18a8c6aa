"""BEHAVIOUR, Losing: links that stall, break or come back; what is owed afterwards."""

from __future__ import annotations

from itertools import pairwise

import msgspec
import pytest

from gateway.core.messages.events import ExitRequested, LinkUp, Suspended
from gateway.core.messages.outputs import FrameKind
from gateway.core.messages.sightings import ForeignData, Gateway, GatewayTokens
from gateway.errors import Code
from gateway.messages.requests import Disable, Enable, Estop, Move, Release, Stop
from gateway.robot.topics import CURRENT_MODE, FSM_ENABLE, FSM_STATE, arm_state, joint_command
from gateway.values import Side
from tests.behaviour.scene import HOME, LEAN, Scene, scene
from tests.pair import MS, S

# ------------------------------------------------------------------------------------------------------------ stale


def stall(pair: Scene, seconds: float, *, moving: bool = False) -> None:
    """Nothing of the robot arrives for so long; commands do. Judged from the stall on."""
    if moving:
        pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
        pair.run(0.4)
    pair.mark()
    pair.is_deaf = True
    pair.run(seconds)
    pair.is_deaf = False


def test_stale_is_entered_when_the_newest_state_is_older_than_100_ms() -> None:
    """And nothing that changes leaves from then on, nor any 1.0."""
    pair = scene("ACTIVE")
    pair.is_deaf = True
    heard_ns = max(sample.received_ns for topic, sample in pair.heard.items() if topic in LEAN[:2])
    pair.run(0.85)
    after = [frame.kind for at_ns, frame in pair.frames if at_ns - heard_ns > 100 * MS]
    assert pair.state == "STALE" and after == []


def test_at_rest_constant_frames_go_on_for_at_most_0_8_s() -> None:
    """Late or in a burst they change nothing; a dead state route alone does not drop the grip."""
    pair = scene("at rest")
    stall(pair, 3.0)
    stale_ns = next(n.at_ns for n in pair.notices if n.facts.get("to") == "STALE")
    after = [(at_ns, frame) for at_ns, frame in pair.arm_frames(Side.LEFT) if at_ns >= stale_ns]
    assert {frame.kind for _, frame in after} == {FrameKind.HOLD} and len({frame.values for _, frame in after}) == 1
    assert 780 * MS <= after[-1][0] - stale_ns <= 800 * MS
    assert max(b - a for (a, _), (b, _) in pairwise(after)) <= 10 * MS
    assert not [v for at_ns, v in zip(pair.beats_at_ns, pair.beats, strict=True) if at_ns >= stale_ns and v != 0.0]


@pytest.mark.parametrize("state", ["at rest", "ACTIVE", "HOLDING"])
def test_the_last_word_of_a_stall_that_outlives_its_time_is_0_0(state: str) -> None:
    """When it may resume no more: for 0.3 s, so that a robot's node that starts anew is handed no 1.0 by its bridge."""
    pair = scene(state)
    stall(pair, 4.0)
    stale_ns = next(n.at_ns for n in pair.notices if n.facts.get("to") == "STALE")
    after = [(at, v) for at, v in zip(pair.beats_at_ns, pair.beats, strict=True) if at >= stale_ns]
    assert {v for _, v in after} == {0.0} and len(after) == 30
    assert 800 * MS <= after[0][0] - stale_ns <= 820 * MS and after[-1][0] - stale_ns <= 1120 * MS
    assert pair.told(Code.STOP_NOT_EFFECTIVE) == []


def test_what_is_owed_after_the_last_word_is_paid_all_the_same() -> None:
    """Nobody may have heard it: 0.0 again to a robot that is seen to run, until it pauses."""
    pair = scene("at rest")
    pair.robot.inject({"fault": "fsm_value", "value": 2}, pair.now_ns)
    stall(pair, 3.0)
    pair.mark()
    pair.run_until(lambda: 0.0 in pair.beats, 1.5)
    pair.robot.clear()
    pair.run_until(lambda: pair.engine.running_topics.count(FSM_ENABLE) == 0, 2.1)
    assert pair.fsm == 0 and pair.state == "IDLE" and set(pair.beats) == {0.0}


@pytest.mark.parametrize("whose", ["vr", "fsm", "gateway", "data"])
def test_somebody_elses_robot_gets_no_last_word(whose: str) -> None:
    """VR mode, playback, another gateway, somebody's setpoints, each heard in the stall: no 0.0."""
    pair = scene("at rest")
    stall(pair, 0.3)
    pair.is_deaf = True
    if whose == "vr":
        pair.tell_mode(api=False)
    elif whose == "fsm":
        pair.is_deaf, pair.topics = False, (FSM_STATE,)
        pair.robot.inject({"fault": "fsm_value", "value": 3}, pair.now_ns)
    elif whose == "gateway":
        pair.receive(GatewayTokens(gateways=(Gateway(zid="b", is_armed=True),), at_ns=pair.now_ns))
    else:
        pair.receive(ForeignData(topic=joint_command(Side.LEFT), zid="b", at_ns=pair.now_ns))
    pair.mark()
    pair.run(2.0)
    assert pair.state == "STALE" and pair.beats == []


def test_the_last_word_does_not_end_an_estops_repetition() -> None:
    """2 s of 0.0 from the e-stop on, and again when the robot is back."""
    pair = scene("at rest")
    stall(pair, 0.6)
    pair.is_deaf = True
    pair.granted(Estop(), "bob")
    pair.mark()
    pair.run(3.0)
    assert set(pair.beats) == {0.0} and 1900 * MS <= pair.beats_at_ns[-1] - pair.beats_at_ns[0] <= 2010 * MS


@pytest.mark.parametrize("ending", ["release", "disable", "estop", "vr", "fsm", "error", "exit", "suspend", "no arm"])
def test_the_hold_in_stale_ends_at_once_with_whatever_would_end_holding(ending: str) -> None:
    """Release, disable, estop, VR, FSM 3-6 and ERROR, no arm left, exit, suspend."""
    pair = scene("at rest")
    stall(pair, 0.3)
    pair.is_deaf = True
    assert pair.state == "STALE" and pair.streaming
    requests = {"release": Release(epoch=pair.epoch), "disable": Disable(epoch=pair.epoch), "estop": Estop()}
    if ending in requests:
        pair.tell(requests[ending], "ann")
    elif ending == "vr":
        pair.tell_mode(api=False)
    elif ending == "no arm":
        pair.tell_mode(arm_enabled=dict.fromkeys(Side, False))
    elif ending in {"fsm", "error"}:
        pair.is_deaf, pair.topics = False, (FSM_STATE,)
        pair.robot.inject({"fault": "fsm_value", "value": 3 if ending == "fsm" else -1}, pair.now_ns)
        pair.run_until(lambda: pair.heard[FSM_STATE].value in {3, -1}, 0.1)
    elif ending == "exit":
        pair.receive(ExitRequested(at_ns=pair.now_ns))
    else:
        pair.receive(Suspended(slept_ns=S, at_ns=pair.now_ns))
    pair.mark()
    pair.run(0.3)
    assert pair.arm_frames() == [] and pair.streaming == [] and 1.0 not in pair.beats


def test_a_stop_in_stale_does_not_end_the_hold() -> None:
    """A plain stop keeps the grip, here as well."""
    pair = scene("at rest")
    stall(pair, 0.2)
    pair.is_deaf = True
    pair.granted(Stop(), "bob")
    pair.mark()
    pair.run(0.3)
    assert len(pair.arm_frames()) >= 58


# ------------------------------------------------------------------------------------------------------ short stalls


@pytest.mark.parametrize("state", ["at rest", "HOLDING"])
def test_a_short_stall_resumes_into_holding_without_a_gap(state: str) -> None:
    """Fresh again in < 0.8 s: 1.0 at once, still STALE; once seeded HOLDING, from the same setpoints."""
    pair = scene(state)
    held = pair.arm_frames_now()
    stall(pair, 0.4)
    back_ns = pair.now_ns
    pair.run_until(lambda: 1.0 in pair.beats[len(pair.beats) - 1 :] and pair.beats_at_ns[-1] >= back_ns, 0.2)
    assert pair.beats_at_ns[-1] - back_ns <= 70 * MS and pair.state == "STALE"
    pair.run_until(lambda: pair.state == "HOLDING", 0.5)
    assert pair.now_ns - back_ns >= 300 * MS
    pair.run(0.3)
    assert pair.arm_frames_now() == held and pair.arm_kinds() == {FrameKind.HOLD}
    assert all(pair.gap_ms(joint_command(side)) <= 11 for side in Side) and pair.fsm == 2
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert pair.state == "ACTIVE"


def test_a_short_stall_in_motion_resumes_from_where_the_arms_are() -> None:
    """The streams went silent at once; they start again from the measured state, and the motion is not resumed."""
    pair = scene("at rest")
    stall(pair, 0.4, moving=True)
    back_ns = pair.now_ns
    silent = [at_ns for at_ns, _ in pair.arm_frames() if at_ns <= back_ns]
    assert back_ns - silent[-1] >= 290 * MS
    pair.run_until(lambda: pair.state == "HOLDING", 0.6)
    again = [(at_ns, frame) for at_ns, frame in pair.arm_frames(Side.LEFT) if at_ns > back_ns]
    measured = pair.heard[arm_state(Side.LEFT)].value.q_rad
    assert again[0][1].kind is FrameKind.ECHO and again[0][0] - back_ns >= 290 * MS
    assert max(abs(a - b) for a, b in zip(again[0][1].values, measured, strict=True)) <= 0.01
    pair.run(0.5)
    assert pair.state == "HOLDING" and FrameKind.MOTION not in {frame.kind for at, frame in again}
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")


def test_a_stall_within_a_short_stall_is_one_stall() -> None:
    """1.0 ceases again at once; when all of it was shorter than 0.8 s it resumes all the same."""
    pair = scene("at rest")
    stall(pair, 0.25)
    pair.run(0.12)
    assert pair.state == "STALE" and pair.beats[-1] == 1.0
    pair.is_deaf = True
    pair.run(0.11)
    again_ns = pair.now_ns
    pair.run(0.1)
    assert not [at_ns for at_ns in pair.beats_at_ns if at_ns > again_ns] and len(pair.streaming) == 2
    pair.is_deaf = False
    pair.run_until(lambda: pair.state == "HOLDING", 0.7)
    assert pair.fsm == 2


def test_a_short_stall_needs_an_fsm_sample_that_came_after_it_began() -> None:
    """Without a new one READY is not known: no 1.0, and the stall is no longer short after 0.8 s."""
    pair = scene("at rest")
    pair.robot.inject({"fault": "drop", "topic": FSM_STATE}, pair.now_ns)
    pair.run(0.1)
    stall(pair, 0.3)
    back_ns = pair.now_ns
    pair.run_until(lambda: pair.state == "IDLE", 1.0)
    assert not [at_ns for at_ns in pair.beats_at_ns if at_ns > back_ns]


def test_a_backlog_that_still_says_ready_does_not_restart_a_robot_that_was_stopped_meanwhile() -> None:
    """Samples that queued up carry a fresh receive time: an FSM READY from before somebody's stop is not a new one."""
    pair = scene("at rest")
    pair.mark()
    pair.freeze()
    pair.run(0.25)
    pair.robot.inject({"fault": "pause"}, pair.now_ns)
    pair.run(0.1)
    begun_ns, backlog = pair.now_ns, pair.take_backlog()
    stopped = next(n for n, sample in enumerate(backlog) if sample.topic == FSM_STATE and sample.value == 0)
    for part in (backlog[:stopped], backlog[stopped:]):  # the burst takes two polls
        for sample in part:
            pair.receive(msgspec.structs.replace(sample, received_ns=pair.now_ns))
        pair.is_deaf = True
        pair.step()
        pair.is_deaf = False
    pair.run(1.0)
    assert not [v for at, v in zip(pair.beats_at_ns, pair.beats, strict=True) if at > begun_ns and v == 1.0]
    assert pair.fsm == 0 and pair.state == "IDLE"


def test_a_1_0_that_was_wrong_after_a_short_stall_is_taken_back_at_once() -> None:
    """The robot turns out to be paused while the arms are being seeded: our 1.0 restarted it, so 0.0 follows."""
    pair = scene("at rest")
    stall(pair, 0.3)
    back_ns = pair.now_ns
    pair.run_until(lambda: pair.beats_at_ns[-1] > back_ns, 0.2)
    assert pair.state == "STALE" and pair.beats[-1] == 1.0
    pair.robot.inject({"fault": "fsm_value", "value": 1, "duration_s": 0.2}, pair.now_ns)
    pair.run_until(lambda: pair.state == "IDLE", 0.2)
    pair.mark()
    pair.run(0.1)
    assert pair.beats[:1] == [0.0] and 1.0 not in pair.beats


@pytest.mark.parametrize("value", [0, 1])
def test_a_short_stall_in_which_the_robot_paused_is_not_resumed(value: int) -> None:
    """The new FSM sample does not say READY: base, no 1.0."""
    pair = scene("at rest")
    pair.mark()
    pair.is_deaf = True
    pair.run(0.2)
    pair.robot.inject({"fault": "fsm_value", "value": value}, pair.now_ns)
    pair.run(0.2)
    pair.is_deaf = False
    back_ns = pair.now_ns
    pair.run(0.5)
    assert pair.state == "IDLE" and 1.0 not in [
        v for at, v in zip(pair.beats_at_ns, pair.beats, strict=True) if at > back_ns
    ]
    assert not [at_ns for at_ns, _ in pair.arm_frames() if at_ns > back_ns + 60 * MS]


def test_an_fsm_that_falls_silent_while_seeding_ends_it_with_0_0() -> None:
    """`fsm_state` dead while seeding: down."""
    pair = scene("at rest")
    stall(pair, 0.2)
    back_ns = pair.now_ns
    pair.run_until(lambda: pair.beats_at_ns[-1] > back_ns, 0.2)
    assert pair.state == "STALE" and pair.beats[-1] == 1.0
    pair.robot.inject({"fault": "drop", "topic": FSM_STATE}, pair.now_ns)
    pair.robot.inject({"fault": "delay", "topic": arm_state(Side.LEFT), "delay_s": 0.2}, pair.now_ns)
    pair.run_until(lambda: pair.state == "IDLE", 0.7)
    pair.mark()
    pair.run(0.2)
    assert set(pair.beats) == {0.0} and pair.arm_frames() == []


def test_an_arm_that_stays_silent_after_a_short_stall_ends_the_way_back() -> None:
    """The link is fresh and one arm's state is dead: it cannot be seeded, and 1.0 does not go on for ever."""
    pair = scene("at rest")
    pair.robot.inject({"fault": "drop", "topic": arm_state(Side.LEFT)}, pair.now_ns)
    pair.is_deaf = True
    pair.run(0.3)
    pair.is_deaf = False
    pair.run_until(lambda: pair.state == "IDLE", 2.0)
    pair.run(1.5)
    assert pair.fsm == 0 and pair.beats[-1] == 0.0


def test_a_stall_from_pause_or_enabling_is_not_resumed() -> None:
    """Only ACTIVE and HOLDING are."""
    for state in ("PAUSED", "ENABLING"):
        pair = scene(state)
        stall(pair, 0.3)
        back_ns = pair.now_ns
        pair.run(0.5)
        assert pair.state == "IDLE" and pair.streaming == []
        assert 1.0 not in [v for at, v in zip(pair.beats_at_ns, pair.beats, strict=True) if at > back_ns]


# ------------------------------------------------------------------------------------------------- longer losses


def test_after_a_long_stall_0_0_is_sent_only_when_the_robot_is_known_to_be_ours() -> None:
    """FSM 1-2 and a *new* mode sample that says API: it might be somebody else's by now."""
    pair = scene("at rest")
    pair.robot.inject({"fault": "fsm_value", "value": 2}, pair.now_ns)
    stall(pair, 1.2)
    mode_before = pair.heard[CURRENT_MODE]
    back_ns = pair.now_ns
    pair.run_until(lambda: pair.state == "IDLE", 0.2)
    pair.mark()
    pair.run_until(lambda: 0.0 in pair.beats, 1.5)
    assert pair.heard[CURRENT_MODE] is not mode_before
    zero_ns = next(at for at, value in zip(pair.beats_at_ns, pair.beats, strict=True) if value == 0.0)
    assert zero_ns >= pair.heard[CURRENT_MODE].received_ns and zero_ns > back_ns
    pair.robot.clear()
    pair.run(0.5)
    assert pair.fsm == 0 and pair.state == "IDLE" and pair.streaming == []


@pytest.mark.parametrize(("fsm", "is_vr"), [(2, True), (3, False), (0, False), (6, False)])
def test_after_a_long_stall_nothing_is_sent_to_a_robot_that_is_somebody_elses(fsm: int, is_vr: bool) -> None:
    """VR by now, FSM 3-6, or paused by its own watchdog: no 0.0."""
    pair = scene("at rest")
    pair.mark()
    pair.is_deaf = True
    pair.run(1.2)
    pair.robot.inject({"fault": "fsm_value", "value": fsm}, pair.now_ns)
    if is_vr:
        pair.robot.inject({"fault": "vr_mode"}, pair.now_ns)
    pair.is_deaf = False
    back_ns = pair.now_ns
    pair.run(3.0)
    assert not [at_ns for at_ns in pair.beats_at_ns if at_ns > back_ns]


def test_a_0_0_that_is_owed_is_paid_when_vr_mode_ends() -> None:
    """API mode again: base, and 0.0 if owed."""
    pair = scene("at rest")
    pair.robot.inject({"fault": "fsm_value", "value": 2}, pair.now_ns)
    pair.robot.inject({"fault": "vr_mode", "duration_s": 1.0}, pair.now_ns)
    pair.tell_mode(api=False)
    pair.mark()
    pair.run(0.9)
    assert pair.state == "READ_ONLY" and pair.beats == []
    pair.run(1.5)
    assert pair.state == "IDLE" and 0.0 in pair.beats


@pytest.mark.parametrize("state", ["ENABLING", "ACTIVE", "HOLDING", "PAUSED"])
def test_a_lost_transport_ends_everything_and_a_reconnect_re_arms_nothing(state: str) -> None:
    """OFFLINE; on return the base, the lease kept, `enable` explicit."""
    pair = scene(state)
    pair.down()
    pair.run(1.5)
    assert pair.state == "OFFLINE" and pair.arm_frames() == [] and pair.beats == []
    pair.up()
    pair.run(2.0)
    assert pair.state == "IDLE" and pair.owner == "ann" and pair.arm_frames() == [] and 1.0 not in pair.beats
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE")


@pytest.mark.parametrize("zid", ["aa", "bb"])
def test_another_transport_is_a_lost_one(zid: str) -> None:
    """A robot that restarted has a new router id; a transport that was replaced lost what was under way."""
    pair = scene("ACTIVE", Scene(snapshot_hz=50))
    pair.receive(LinkUp(router_zid=zid, at_ns=pair.now_ns))
    assert pair.state == "OFFLINE"
    pair.run(2.0)
    assert pair.state == "IDLE" and pair.arm_frames() == [] and bool(pair.told(Code.ROBOT_RESTARTED)) is (zid == "bb")
    assert pair.see().motions[0].code == "NO_LINK"


def test_a_transport_that_is_back_in_the_same_tick_was_lost_all_the_same() -> None:
    """The robot is heard again before anybody looked: what is owed is paid, and an e-stop is sent again."""
    for request in (None, Estop()):
        pair = scene("at rest")
        pair.robot.inject({"fault": "fsm_value", "value": 2}, pair.now_ns)
        if request is not None:
            pair.granted(request, "bob")
        pair.mark()
        pair.receive(LinkUp(router_zid="aa", at_ns=pair.now_ns))
        pair.step()
        assert pair.state == "IDLE" and pair.arm_frames() == []
        pair.run(1.5)
        assert 0.0 in pair.beats and 1.0 not in pair.beats


def test_a_burst_after_a_stall_of_the_link_moves_nothing() -> None:
    """What waited in the stalled link arrives late and all at once: constant frames, and no 1.0 after the stall began."""
    pair = scene("ACTIVE")
    pair.freeze()
    pair.run(0.45)
    waiting = [frame for frame in pair._to_robot if frame.topic == FSM_ENABLE]
    arms = {joint_command(side) for side in Side}
    kinds = {frame.kind for frame in pair._to_robot if frame.topic in arms}
    assert len(waiting) <= 3 and FrameKind.HOLD not in kinds  # in motion: silence once it is stale
    pair.thaw()
    pair.run(1.0)
    assert pair.state == "HOLDING"
