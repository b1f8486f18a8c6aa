"""BEHAVIOUR, Stopping: what `stop`, `estop`, `recover`, `disable` and `release` do and send."""

from __future__ import annotations

from itertools import pairwise

import pytest

from gateway.core.messages.events import CommandRequested
from gateway.core.messages.outputs import FrameKind
from gateway.errors import Code
from gateway.messages.requests import (
    Cancel,
    CloseStream,
    Disable,
    Enable,
    Estop,
    Hold,
    Move,
    OpenStream,
    Recover,
    Release,
    SetGripper,
    Stop,
)
from gateway.robot.topics import CHASSIS_VELOCITY, FSM_ENABLE, FSM_STATE, LIFT_COMMAND, arm_state, gripper_command
from gateway.values import Side
from tests.behaviour.scene import HOME, REACHED_BY, Scene, scene
from tests.changed import replace
from tests.pair import MS, S
from tests.thoroughness import crossed

STATES = tuple(REACHED_BY)
ZEROS, STOPPED, OFF = (0.0, 0.0, 0.0), (0.0, 1.0), (0.0, 0.0)


# ------------------------------------------------------------------------------------------------------- plain stop


@pytest.mark.parametrize(("state", "client"), crossed(STATES, ["ann", "bob"]))
def test_a_stop_is_never_refused_and_stops_chassis_and_lift_at_once(state: str, client: str) -> None:
    """In every state, by anyone: chassis zeros and lift [0,1] in the same tick, at 20 Hz, for at least 1 s."""
    pair = scene(state, Scene(model="lift"))
    assert pair.ask(Stop(), client).refusal is None
    left = {frame.topic: frame.values for frame in pair.first_tick()}
    assert left[CHASSIS_VELOCITY] == ZEROS and left[LIFT_COMMAND] == STOPPED
    pair.run(1.5)
    for topic, stop in ((CHASSIS_VELOCITY, ZEROS), (LIFT_COMMAND, STOPPED)):
        times = [at_ns for at_ns, _ in pair.sent_on(topic, pair.mark_ns)]
        assert set(pair.values(topic)) == {stop} and times[-1] - times[0] >= 1 * S
        assert max(b - a for a, b in pairwise(times)) <= 50 * MS


@pytest.mark.parametrize("model", ["lite", "standard"])
def test_a_model_without_a_lift_gets_no_lift_frames(model: str) -> None:
    """The profile of the model has no `/api/servo/cmd` (manual §1.2)."""
    pair = scene("ACTIVE", Scene(model=model))
    pair.granted(Estop(), "ann")
    pair.run(1.5)
    assert pair.values(CHASSIS_VELOCITY) and not pair.values(LIFT_COMMAND)


@pytest.mark.parametrize("state", ["IDLE", "ACTIVE", "HOLDING", "PAUSED"])
def test_a_plain_stop_does_not_send_0_0(state: str) -> None:
    """0.0 belongs to estop, release, disable and ENABLING: a stop keeps the grip."""
    pair = scene(state)
    pair.granted(Stop(), "bob")
    pair.run(1.0)
    assert 0.0 not in pair.beats


def test_only_somebody_elses_stop_latches() -> None:
    """The owner goes on by a new motion; after another's stop only after `recover`."""
    pair = scene("ACTIVE")
    pair.granted(Stop(), "ann")
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    pair.granted(Stop(reason="dog"), "bob")
    refusal = pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert refusal.code is Code.LATCHED and "STOPPED_BY_OTHER" in refusal.message and "dog" in refusal.message
    assert pair.refused(Enable(epoch=pair.epoch), "ann").code is Code.LATCHED
    pair.granted(Recover(), "bob")
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")


def test_a_stop_ends_motions_and_streams_with_its_code() -> None:
    """Motions end aborted with STOPPED, later targets of a stream get STREAM_ENDED."""
    pair = scene("at rest", Scene(snapshot_hz=50))
    motion = pair.move(pair.epoch, {Side.LEFT: HOME[Side.LEFT]}, "ann")
    stream = pair.stream(pair.epoch, Side.RIGHT, "ann")
    pair.granted(Stop(reason="enough"), "ann")
    pair.target(pair.epoch, stream, HOME[Side.RIGHT], "ann")
    pair.run(0.1)
    view = pair.see()
    ended = next(m for m in view.motions if m.motion_id == motion)
    assert (ended.state, ended.code) == ("aborted", "STOPPED") and "enough" in ended.message
    (target,) = view.targets
    assert (target.open, target.code, target.refused, target.refusal_code) == (False, "STOPPED", 1, "STREAM_ENDED")


# ------------------------------------------------------------------------------------- requests from before a stop


@pytest.mark.parametrize("stop", [Stop(), Estop()])
@pytest.mark.parametrize("what", ["move", "stream", "enable", "recover"])
def test_what_was_asked_before_a_stop_is_refused_after_it(stop: Stop | Estop, what: str) -> None:
    """A request that arrived earlier and is looked at in the same tick, or later, moves and clears nothing."""
    pair = scene("IDLE" if what == "enable" else "HOLDING")
    requests = {
        "move": Move(epoch=pair.epoch, targets_rad=HOME),
        "stream": OpenStream(epoch=pair.epoch, side=Side.LEFT),
        "enable": Enable(epoch=pair.epoch),
        "recover": Recover(),
    }
    before_ns = pair.now_ns
    first = pair.tell(requests[what], "ann")
    pair.now_ns += 1
    pair.tell(stop, "bob")
    pair.step()
    late = CommandRequested(client_id="ann", request_id=999, request=requests[what], received_ns=before_ns)
    pair.receive(late)
    pair.step()
    refusals = {reply.request_id: reply.refusal for reply in pair.replies}
    assert refusals[first].code is Code.STOPPED and refusals[999].code in {Code.STOPPED, Code.LATCHED}
    pair.run(0.5)
    assert pair.engine.latches and not pair.moved()


def test_a_target_from_before_a_stop_moves_nothing() -> None:
    """Targets wait in a slot beside the requests: the stop comes first."""
    pair = scene("at rest")
    stream = pair.stream(pair.epoch, Side.LEFT, "ann")
    pair.target(pair.epoch, stream, HOME[Side.LEFT], "ann")
    pair.now_ns += 1
    pair.tell(Stop(), "ann")
    pair.mark()
    pair.run(0.3)
    assert not pair.moved() and pair.state == "HOLDING"


def test_a_repeated_request_gets_its_first_reply_again() -> None:
    """A client that did not get the reply asks again: nothing happens twice."""
    pair = scene("at rest")
    move = CommandRequested(
        client_id="ann",
        request_id=4000,
        request=Move(epoch=pair.epoch, targets_rad=HOME),
        received_ns=pair.now_ns,
    )
    pair.receive(move)
    pair.step()
    pair.run(0.2)
    pair.receive(replace(move, received_ns=pair.now_ns))
    pair.receive(replace(move, received_ns=pair.now_ns, client_id="bob"))
    pair.step()
    first, again, other = pair.replies[-3:]
    assert first.facts == again.facts and first.facts["motion_id"] == 1 and again.client_id == "ann"
    assert other.refusal.code is Code.NOT_OWNER


def test_another_request_under_a_number_that_was_used_is_refused() -> None:
    """It is not run, and not told that it was: a client that numbers wrongly hears of it."""
    pair = scene("at rest")
    grip = CommandRequested(
        client_id="ann",
        request_id=4000,
        request=SetGripper(epoch=pair.epoch, side=Side.LEFT, raw=0.5),
        received_ns=pair.now_ns,
        content=1,
    )
    other = replace(grip, request=SetGripper(epoch=pair.epoch, side=Side.LEFT, raw=0.9), content=2)
    for asked in (grip, other, grip):
        pair.receive(replace(asked, received_ns=pair.now_ns))
        pair.run(0.1)
    first, refused, again = pair.replies[-3:]
    assert first.facts["raw"] == again.facts["raw"] == 0.5
    assert refused.refusal.code is Code.BAD_REQUEST and refused.refusal.field == "request_id"
    assert set(pair.values(gripper_command(Side.LEFT))) == {(0.5,)}


def test_a_stop_stops_even_under_a_number_that_was_used_before() -> None:
    """Stopping twice harms nobody; a client that numbers wrongly must not lose its stop."""
    pair = scene("ACTIVE")
    pair.receive(CommandRequested(client_id="ann", request_id=4001, request=Recover(), received_ns=pair.now_ns))
    pair.step()
    pair.receive(CommandRequested(client_id="ann", request_id=4001, request=Stop(), received_ns=pair.now_ns))
    pair.step()
    assert pair.state == "HOLDING" and pair.replies[-1].facts == {"stop_undelivered": False}


# ------------------------------------------------------------------------------------------------------------ estop


@pytest.mark.parametrize("state", ["VR", "READ_ONLY", "IDLE", "ENABLING", "ACTIVE", "HOLDING", "PAUSED", "STOPPING"])
def test_an_estop_sends_everything_at_once_and_latches(state: str) -> None:
    """By anyone, in any state and mode: 0.0, chassis zeros, lift [0,1] and after a second [0,0]."""
    pair = scene(state, Scene(model="lift"))
    pair.granted(Estop(reason="smoke"), "carol")
    left = {frame.topic: frame.values for frame in pair.first_tick()}
    assert left[FSM_ENABLE] == OFF[:1] and left[CHASSIS_VELOCITY] == ZEROS
    assert left[LIFT_COMMAND] == STOPPED and "smoke" in pair.engine.latches[Code.ESTOP]
    pair.run(2.5)
    lift = pair.values(LIFT_COMMAND)
    assert lift[-1] == OFF and set(lift[:-1]) == {STOPPED} and len(lift) >= 21
    assert pair.fsm == 0 and pair.beats[-1] == 0.0 and not pair.arm_frames()


def test_0_0_is_repeated_at_20_hz_until_fsm_0_is_seen() -> None:
    """And no longer: the robot said that it pauses."""
    pair = scene("ACTIVE")
    pair.robot.inject({"fault": "drop", "topic": FSM_STATE, "duration_s": 0.4}, pair.now_ns)
    pair.granted(Estop(), "ann")
    pair.run(1.0)
    times = pair.beats_at_ns
    assert set(pair.beats) == {0.0} and 350 * MS <= times[-1] - times[0] <= 500 * MS
    assert max(b - a for a, b in pairwise(times)) <= 50 * MS and not pair.told(Code.STOP_NOT_EFFECTIVE)


@pytest.mark.parametrize("request_of", ["estop", "disable"])
def test_0_0_that_is_not_heard_ends_after_2_s_and_is_told_once(request_of: str) -> None:
    """STOP_NOT_EFFECTIVE, with what the FSM says and what to do."""
    pair = scene("at rest")
    pair.robot.inject({"fault": "fsm_value", "value": 2}, pair.now_ns)
    pair.granted(Estop() if request_of == "estop" else Disable(epoch=pair.epoch), "ann")
    pair.run(5.0)
    assert set(pair.beats) == {0.0} and 1950 * MS <= pair.beats_at_ns[-1] - pair.beats_at_ns[0] <= 2000 * MS
    (message,) = pair.told(Code.STOP_NOT_EFFECTIVE)
    assert "READY" in message and "physical emergency stop" in message and pair.state == "IDLE"


def test_without_transport_the_reply_says_that_the_stop_was_not_delivered() -> None:
    """`stop_undelivered`; with a transport it is false, stale or not."""
    pair = scene("OFFLINE")
    assert pair.granted(Stop(), "ann") == pair.granted(Estop(), "bob") == {"stop_undelivered": True}
    assert len(pair.told(Code.STOP_UNDELIVERED)) == 2
    assert scene("STALE").granted(Stop(), "ann") == {"stop_undelivered": False}


@pytest.mark.parametrize(("fsm", "is_vr"), crossed([1, 2, 0, 3, -1], [False, True]))
def test_an_estop_without_transport_is_sent_again_when_the_robot_is_back(fsm: int, is_vr: bool) -> None:
    """A latched e-stop is sent again when fresh and FSM is 1-2, in any mode, without waiting for the mode."""
    is_sent = fsm in {1, 2}
    pair = scene("OFFLINE")
    pair.granted(Estop(), "bob")
    pair.run(3.0)
    if is_vr:
        pair.robot.inject({"fault": "vr_mode"}, pair.now_ns)
    pair.robot.inject({"fault": "fsm_value", "value": fsm}, pair.now_ns)
    pair.up()
    pair.mark()
    pair.run(0.12)
    assert (0.0 in pair.beats) is is_sent
    pair.run(2.6)
    assert len(pair.beats) <= 41 and Code.ESTOP in pair.engine.latches


def test_an_estop_that_was_heard_is_not_sent_again_after_a_later_stall() -> None:
    """The robot paused; what drives it later is not for an old e-stop to pause."""
    pair = scene("IDLE")
    pair.granted(Estop(), "bob")
    pair.run(1.0)
    assert pair.fsm == 0
    pair.down()
    pair.run(0.5)
    pair.robot.inject({"fault": "fsm_value", "value": 2}, pair.now_ns)
    pair.up()
    pair.mark()
    pair.run(2.0)
    assert pair.beats == []


def test_an_estop_that_was_cut_short_by_a_loss_is_sent_again() -> None:
    """The transport went while 0.0 was being repeated; on return the FSM is still 2."""
    pair = scene("at rest")
    pair.robot.inject({"fault": "fsm_value", "value": 2}, pair.now_ns)
    pair.granted(Estop(), "bob")
    pair.run(0.2)
    pair.down()
    pair.run(3.0)
    pair.mark()
    pair.up()
    pair.run(0.3)
    assert 0.0 in pair.beats


def test_recover_ends_the_repetition_of_an_estop_that_was_not_heard() -> None:
    """What nobody latches any more is not sent again. In VR mode only an e-stop would be sent, no 0.0 that is owed."""
    pair = scene("at rest")
    pair.robot.inject({"fault": "fsm_value", "value": 2}, pair.now_ns)
    pair.granted(Estop(), "bob")
    pair.run(2.5)
    pair.granted(Recover(), "bob")
    pair.down()
    pair.robot.inject({"fault": "vr_mode"}, pair.now_ns)
    pair.run(0.2)
    pair.up()
    pair.mark()
    pair.run(2.0)
    assert pair.beats == []


def test_an_estop_goes_on_when_the_robot_is_switched_to_vr_mode() -> None:
    """Only an e-stop's 0.0 goes on in VR mode; a disable's would pause the VR operator."""
    for request, goes_on in ((Estop(), True), (None, False)):
        pair = scene("at rest")
        pair.robot.inject({"fault": "fsm_value", "value": 2}, pair.now_ns)
        pair.granted(request or Disable(epoch=pair.epoch), "ann")
        pair.run(0.2)
        pair.robot.inject({"fault": "vr_mode"}, pair.now_ns)
        pair.tell_mode(api=False)
        pair.step()
        pair.mark()
        pair.run(0.5)
        assert bool(pair.beats) is goes_on


# ---------------------------------------------------------------------------------------------------------- recover


def test_recover_clears_all_causes_and_changes_nothing_else() -> None:
    """Any client may; it never moves or enables: what is held stays held."""
    pair = scene("HOLDING")
    pair.granted(Stop(), "bob")
    pair.mark()
    assert pair.granted(Recover(), "carol") == {"cleared": ["STOPPED_BY_OTHER"]}
    assert not pair.engine.latches
    pair.run(0.5)
    pair.stays()


@pytest.mark.parametrize("fault", ["fsm", "fsm then silence", "names"])
def test_recover_clears_none_while_a_cause_persists(fault: str) -> None:
    """All causes or none: the refusal names the one that persists."""
    pair = scene("HOLDING")
    pair.granted(Stop(), "bob")
    topic = arm_state(Side.LEFT)
    what = {"fault": "wrong_names", "topic": topic} if fault == "names" else {"fault": "fsm_value", "value": -1}
    pair.robot.inject(what, pair.now_ns)
    pair.run(0.2)
    if fault == "fsm then silence":
        pair.robot.inject({"fault": "drop", "topic": FSM_STATE}, pair.now_ns)
        pair.run(1.0)
    refusal = pair.refused(Recover(), "bob")
    code = Code.JOINT_ORDER if fault == "names" else Code.FSM_ERROR
    assert refusal.code is Code.LATCH_PERSISTS and refusal.field == code.value
    assert set(pair.engine.latches) == {Code.STOPPED_BY_OTHER, code}
    pair.robot.clear()
    pair.run(1.2)
    assert set(pair.granted(Recover(), "bob")["cleared"]) == {"STOPPED_BY_OTHER", code.value}


def test_after_recover_the_hold_goes_on_and_motion_is_allowed() -> None:
    """HOLDING, latched: `recover` leaves heartbeat and hold frames as they are."""
    pair = scene("ACTIVE")
    pair.granted(Stop(), "bob")
    pair.run(1.0)
    pair.mark()
    pair.granted(Recover(), "bob")
    pair.run(0.5)
    assert pair.state == "HOLDING" and set(pair.beats) == {1.0} and not pair.moved()
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")


# ---------------------------------------------------------------------------------- disable, release, hold, cancel


@pytest.mark.parametrize("request_of", [Disable, Release])
def test_disable_and_release_brake_first_and_then_pause_the_robot(request_of: type) -> None:
    """The arms come to rest within their limits under 1.0, then 0.0 until FSM 0, then silence."""
    pair = scene("ACTIVE")
    pair.granted(request_of(epoch=pair.epoch), "ann")
    pair.stops_first()
    assert pair.state == ("IDLE" if request_of is Disable else "READ_ONLY")
    assert pair.owner == ("ann" if request_of is Disable else None)


def test_release_takes_the_lift_off_after_a_stop() -> None:
    """[0,0] on release: once the lift was commanded, its use ends with the servo off."""
    pair = scene("ACTIVE", Scene(model="lift"))
    pair.granted(Stop(), "ann")
    pair.granted(Release(epoch=pair.epoch), "ann")
    pair.run(3.0)
    lift = pair.values(LIFT_COMMAND)
    assert lift[-1] == OFF and set(lift[:-1]) == {STOPPED}


def test_hold_and_cancel_keep_the_lease_the_state_and_the_heartbeat() -> None:
    """The named arms brake and hold; ACTIVE goes on."""
    pair = scene("at rest", Scene(snapshot_hz=50))
    left = pair.move(pair.epoch, {Side.LEFT: HOME[Side.LEFT]}, "ann")
    right = pair.move(pair.epoch, {Side.RIGHT: HOME[Side.RIGHT]}, "ann")
    pair.run(0.3)
    pair.granted(Hold(epoch=pair.epoch, sides=(Side.LEFT,)), "ann")
    assert pair.granted(Cancel(epoch=pair.epoch, motion_id=right), "ann") == {"state": "cancelled"}
    pair.mark()
    pair.run(1.0)
    assert pair.state == "ACTIVE" and pair.arm_kinds() == {FrameKind.BRAKE, FrameKind.HOLD}
    states = {m.motion_id: (m.state, m.code) for m in pair.see().motions}
    assert states == {left: ("cancelled", "CANCELLED"), right: ("cancelled", "CANCELLED")}
    assert pair.refused(Cancel(epoch=pair.epoch, motion_id=77), "ann").code is Code.UNKNOWN_MOTION
    assert pair.refused(CloseStream(epoch=pair.epoch, stream_id=77), "ann").code is Code.UNKNOWN_STREAM
