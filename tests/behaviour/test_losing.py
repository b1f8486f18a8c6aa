"""BEHAVIOUR, Losing: clients that vanish, owners that change, links that stall or break, this host that sleeps."""

from __future__ import annotations

from itertools import pairwise

import pytest

from gateway import robot
from gateway.core.events import (
    Abandon,
    Acquire,
    ClientSeen,
    Disable,
    Enable,
    Estop,
    ExitRequested,
    FrameKind,
    LinkUp,
    Move,
    OnLoss,
    OpenStream,
    Release,
    Stop,
    Suspended,
    Take,
)
from gateway.errors import Code
from gateway.values import Side
from tests.behaviour.scene import HOME, LEAN, Scene, away, scene
from tests.pair import MS, S


def stages(pair: Scene) -> list[str]:
    """Stages of a loss that were told since the mark."""
    return [notice.facts["stage"] for notice in pair.notices if notice.code is Code.LOSS_STAGE]


def lose(pair: Scene) -> int:
    """Ann vanishes; return when [ns]."""
    pair.kill("ann")
    at_ns = pair.now_ns
    pair.step()
    return at_ns


# --------------------------------------------------------------------------------------------------- lost clients


def test_a_client_is_lost_after_250_ms_without_a_keepalive() -> None:
    """The criterion is the library's keepalive, not the spacing of targets."""
    pair = scene("ACTIVE")
    pair.alive.discard("ann")
    last_ns = pair.now_ns
    pair.run_until(lambda: pair.state == "HOLDING", 0.4)
    assert 200 * MS <= pair.now_ns - last_ns <= 260 * MS and stages(pair) == ["lost"]


def test_a_client_whose_token_is_gone_is_lost_at_once() -> None:
    """In mid-move: the arms brake in the very tick, and hold."""
    pair = scene("ACTIVE")
    lose(pair)
    assert pair.state == "HOLDING" and pair.arm_kinds() == {FrameKind.BRAKE}
    pair.brakes_and_holds()


def test_a_lost_client_keeps_the_lease_for_10_s_and_the_hold_for_60_s() -> None:
    """Stage by stage: free at 10 s, the hold goes on unowned, down at 60 s; every stage is told."""
    pair = scene("ACTIVE")
    lost_ns = lose(pair)
    pair.run(9.9)
    assert pair.owner == "ann" and pair.state == "HOLDING"
    pair.run_until(lambda: pair.owner is None, 0.2)
    assert 10 * S <= pair.now_ns - lost_ns <= 10 * S + 20 * MS
    pair.mark_ns = pair.now_ns
    pair.run(49.9 - 0.1)
    assert pair.state == "HOLDING" and set(pair.beats) == {1.0} and pair.arm_kinds() == {FrameKind.HOLD}
    pair.mark()
    pair.run_until(lambda: pair.state != "HOLDING", 0.3)
    assert 60 * S <= pair.now_ns - lost_ns <= 60 * S + 20 * MS and pair.state == "READ_ONLY"
    assert stages(pair) == ["down"]
    pair.run(0.3)
    assert set(pair.beats) <= {0.0, 1.0} and pair.beats[-1] == 0.0 and pair.fsm == 0


def test_after_60_s_the_lift_is_off() -> None:
    """[0,1] where the lift was commanded, [0,0] when everything goes down."""
    pair = scene("HOLDING", Scene(model="lift"))
    lose(pair)
    pair.run(59.0)
    pair.granted(Stop(), "bob")
    pair.run(3.0)
    assert pair.state == "READ_ONLY" and pair.values(robot.LIFT_COMMAND)[-1] == (0.0, 0.0)


@pytest.mark.parametrize("sign", ["keepalive", "acquire"])
def test_a_client_that_is_back_within_10_s_ends_the_clocks(sign: str) -> None:
    """It keeps its lease and epoch; what was held is held; it resumes explicitly."""
    pair = scene("ACTIVE")
    lose(pair)
    pair.run(9.5)
    assert pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann").code is Code.LEASE_LOST
    pair.alive.add("ann")
    if sign == "acquire":
        assert pair.granted(Acquire(name="ann", pid=1), "ann") == {"epoch": pair.epoch}
    pair.run(0.1)
    assert stages(pair) == ["lost", "back"] and pair.state == "HOLDING"
    pair.mark()
    pair.run(61.0)
    assert pair.state == "HOLDING" and stages(pair) == [] and pair.owner == "ann"
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert pair.state == "ACTIVE"


def test_a_keepalive_of_another_client_ends_no_clock() -> None:
    """Only the owner's own."""
    pair = scene("ACTIVE")
    lose(pair)
    for _ in range(20):
        pair.receive(ClientSeen(client_id="bob", at_ns=pair.now_ns))
        pair.run(0.6)
    assert pair.owner is None


def test_while_the_clocks_run_others_take_but_do_not_acquire() -> None:
    """LEASE_HELD until free; `take` works at once; a new owner ends both clocks."""
    pair = scene("ACTIVE")
    lose(pair)
    refusal = pair.refused(Acquire(name="bob", pid=2), "bob")
    assert refusal.code is Code.LEASE_HELD and "free in" in refusal.message
    pair.alive.add("bob")
    epoch = pair.granted(Take(name="bob", pid=2, reason="ann crashed"), "bob")["epoch"]
    pair.mark()
    pair.run(62.0)
    assert pair.owner == "bob" and pair.state == "HOLDING" and stages(pair) == []
    assert pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann").code is Code.LEASE_STALE
    pair.granted(Move(epoch=epoch, targets_rad=HOME), "bob")


def test_whoever_acquires_an_unowned_hold_goes_on_from_it() -> None:
    """Free after 10 s, held until 60 s: a new owner moves on without `enable`."""
    pair = scene("ACTIVE")
    lose(pair)
    pair.run(20.0)
    pair.alive.add("bob")
    epoch = pair.granted(Acquire(name="bob", pid=2), "bob")["epoch"]
    pair.mark()
    pair.run(45.0)
    assert pair.state == "HOLDING" and epoch == pair.epoch + 1
    pair.granted(Move(epoch=epoch, targets_rad=HOME), "bob")
    assert pair.state == "ACTIVE" and FrameKind.ECHO not in pair.arm_kinds()


@pytest.mark.parametrize("state", ["ENABLING", "ACTIVE", "HOLDING", "PAUSED"])
def test_on_loss_pause_goes_down_at_once(state: str) -> None:
    """For users who prefer a paused robot over a held load: 0.0 in the same tick, the lease is free."""
    pair = scene(state)
    pair.granted(Acquire(name="ann", pid=1, on_loss=OnLoss.PAUSE), "ann")
    pair.mark()
    lose(pair)
    pair.goes_down()
    assert pair.owner is None


def test_a_client_lost_while_nothing_is_held_costs_only_its_lease() -> None:
    """IDLE: free after 10 s; there is nothing to go down after 60 s, and nobody says that a grip was lost."""
    pair = scene("IDLE")
    lose(pair)
    pair.run(62.0)
    assert pair.owner is None and pair.state == "READ_ONLY" and stages(pair) == ["lost", "free"] and not pair.frames


def test_a_client_that_leaves_its_lease_is_lost_at_once() -> None:
    """`abandon`: as client lost, and only asking for the lease again brings it back."""
    pair = scene("ACTIVE")
    pair.tell(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    pair.granted(Abandon(epoch=pair.epoch), "ann")
    assert pair.state == "HOLDING" and FrameKind.MOTION not in pair.arm_kinds()
    pair.run(1.0)
    assert pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann").code is Code.LEASE_LOST
    pair.granted(Acquire(name="ann", pid=1), "ann")
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")


def test_a_lost_client_while_stopping_is_still_stopped() -> None:
    """STOPPING goes on to its end; the lease is free after 10 s."""
    pair = scene("STOPPING")
    lose(pair)
    pair.stops_first()
    pair.run(10.0)
    assert pair.owner is None and stages(pair) == ["lost", "free"]


# -------------------------------------------------------------------------------------------------------- takeover


def test_a_takeover_in_mid_motion_brakes_first() -> None:
    """The epoch moves at once; the old motion ends LEASE_LOST; new commands get TAKEOVER_BRAKING until rest."""
    pair = scene("ACTIVE", Scene(snapshot_hz=50))
    pair.alive.add("bob")
    epoch = pair.granted(Take(name="bob", pid=2, reason="my turn"), "bob")["epoch"]
    assert epoch == pair.epoch + 1 and pair.arm_kinds() == {FrameKind.BRAKE}
    assert pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann").code is Code.LEASE_STALE
    refused = 0
    while pair.ask(Move(epoch=epoch, targets_rad=HOME), "bob").refusal is not None:
        assert pair.replies[-1].refusal.code is Code.TAKEOVER_BRAKING
        refused += 1
    assert refused > 5 and pair.state == "ACTIVE"
    last_brake = max(at for at, frame in pair.arm_frames() if frame.kind is FrameKind.BRAKE)
    first_move = min(at for at, frame in pair.arm_frames() if frame.kind is FrameKind.MOTION)
    assert last_brake < first_move
    ended = pair.see().motions[0]
    assert (ended.state, ended.code) == ("aborted", "LEASE_LOST") and "my turn" in ended.message


def test_a_takeover_of_a_brake_waits_for_it_too() -> None:
    """The owner was lost a moment ago and the arms still brake: no command before rest."""
    pair = scene("ACTIVE")
    lose(pair)
    epoch = pair.granted(Take(name="bob", pid=2, reason="my turn"), "bob")["epoch"]
    pair.alive.add("bob")
    for request in (Move(epoch=epoch, targets_rad=HOME), OpenStream(epoch=epoch, side=Side.LEFT)):
        assert pair.refused(request, "bob").code is Code.TAKEOVER_BRAKING
    pair.run(1.0)
    pair.granted(OpenStream(epoch=epoch, side=Side.LEFT), "bob")


def test_a_late_command_of_a_former_owner_moves_nothing() -> None:
    """Two owners never interleave: streamed targets of the old epoch are dropped as well."""
    pair = scene("at rest")
    stream = pair.stream(pair.epoch, Side.LEFT, "ann")
    pair.target(pair.epoch, stream, HOME[Side.LEFT], "ann")
    pair.run(0.1)
    pair.tell(Take(name="bob", pid=2, reason="test"), "bob")
    pair.target(pair.epoch, stream, away(pair, Side.LEFT, 0.5), "ann")
    pair.mark()
    pair.run(1.0)
    assert FrameKind.MOTION not in pair.arm_kinds() and pair.state == "HOLDING"


def test_the_owner_who_takes_what_he_owns_changes_nothing() -> None:
    """Same epoch, no brake."""
    pair = scene("ACTIVE")
    assert pair.granted(Take(name="ann", pid=1, reason="habit"), "ann") == {"epoch": pair.epoch}
    assert pair.state == "ACTIVE"


def test_of_two_who_acquire_at_once_one_gets_the_lease() -> None:
    """The first one; the other hears who has it."""
    pair = scene("READ_ONLY")
    first, second = pair.tell(Acquire(name="ann", pid=1), "ann"), pair.tell(Acquire(name="bob", pid=2), "bob")
    pair.step()
    replies = {reply.request_id: reply for reply in pair.replies}
    assert replies[first].refusal is None and replies[second].refusal.code is Code.LEASE_HELD
    assert "'ann' (pid 1)" in replies[second].refusal.message


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
    pair.run(1.0)
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
    assert not [at_ns for at_ns in pair.beats_at_ns if at_ns >= stale_ns]


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
        pair.is_deaf, pair.topics = False, (robot.FSM_STATE,)
        pair.robot.inject({"fault": "fsm_value", "value": 3 if ending == "fsm" else -1}, pair.now_ns)
        pair.run_until(lambda: pair.heard[robot.FSM_STATE].value in {3, -1}, 0.1)
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
    assert all(pair.gap_ms(robot.joint_command(side)) <= 11 for side in Side) and pair.fsm == 2
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
    measured = pair.heard[robot.arm_state(Side.LEFT)].value.q_rad
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
    pair.robot.inject({"fault": "drop", "topic": robot.FSM_STATE}, pair.now_ns)
    pair.run(0.1)
    stall(pair, 0.3)
    back_ns = pair.now_ns
    pair.run_until(lambda: pair.state == "IDLE", 1.0)
    assert not [at_ns for at_ns in pair.beats_at_ns if at_ns > back_ns]


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
    pair.robot.inject({"fault": "drop", "topic": robot.FSM_STATE}, pair.now_ns)
    pair.robot.inject({"fault": "delay", "topic": robot.arm_state(Side.LEFT), "delay_s": 0.2}, pair.now_ns)
    pair.run_until(lambda: pair.state == "IDLE", 0.7)
    pair.mark()
    pair.run(0.2)
    assert set(pair.beats) == {0.0} and pair.arm_frames() == []


def test_an_arm_that_stays_silent_after_a_short_stall_ends_the_way_back() -> None:
    """The link is fresh and one arm's state is dead: it cannot be seeded, and 1.0 does not go on for ever."""
    pair = scene("at rest")
    pair.robot.inject({"fault": "drop", "topic": robot.arm_state(Side.LEFT)}, pair.now_ns)
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
    mode_before = pair.heard[robot.CURRENT_MODE]
    back_ns = pair.now_ns
    pair.run_until(lambda: pair.state == "IDLE", 0.2)
    pair.run_until(lambda: 0.0 in pair.beats, 1.5)
    assert pair.heard[robot.CURRENT_MODE] is not mode_before
    zero_ns = next(at for at, value in zip(pair.beats_at_ns, pair.beats, strict=True) if value == 0.0)
    assert zero_ns >= pair.heard[robot.CURRENT_MODE].received_ns and zero_ns > back_ns
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


def test_a_burst_after_a_stall_of_the_link_moves_nothing() -> None:
    """What waited in the stalled link arrives late and all at once: constant frames, and no 1.0 after the stall began."""
    pair = scene("ACTIVE")
    pair.freeze()
    pair.run(0.45)
    waiting = [frame for frame in pair._to_robot if frame.topic == robot.FSM_ENABLE]
    kinds = {frame.kind for frame in pair._to_robot if frame.topic != robot.FSM_ENABLE}
    assert len(waiting) <= 3 and FrameKind.HOLD not in kinds  # in motion: silence once it is stale
    pair.thaw()
    pair.run(1.0)
    assert pair.state == "HOLDING"


# --------------------------------------------------------------------------------------------------- time and host


@pytest.mark.parametrize("step_s", [3600.0, -3600.0])
@pytest.mark.parametrize("state", ["ACTIVE", "HOLDING"])
def test_a_jump_of_the_robots_clock_changes_nothing(step_s: float, state: str) -> None:
    """Ages are monotonic; stamps are compared with each other only."""
    pair = scene(state)
    pair.robot.inject({"fault": "clock_step", "step_s": step_s}, pair.now_ns)
    pair.run(0.5)
    assert pair.state == state and all(pair.gap_ms(robot.joint_command(side)) <= 11 for side in Side)
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")


def test_enabling_works_after_a_jump_of_the_robots_clock() -> None:
    """The least lag of before the jump says nothing about the samples after it."""
    for step_s in (3600.0, -3600.0):
        pair = scene("IDLE")
        pair.robot.inject({"fault": "clock_step", "step_s": step_s}, pair.now_ns)
        pair.granted(Enable(epoch=pair.epoch), "ann")
        pair.run_until(lambda pair=pair: pair.state == "ACTIVE", 10.0)


@pytest.mark.parametrize("state", ["IDLE", "ENABLING", "ACTIVE", "HOLDING", "PAUSED", "STOPPING", "STALE"])
def test_a_suspend_frees_the_lease_and_takes_everything_down(state: str) -> None:
    """Nothing of what was held is held any more; nobody owns the robot; it is told."""
    pair = scene(state)
    pair.receive(Suspended(slept_ns=30 * S, at_ns=pair.now_ns))
    pair.run(0.5)
    assert pair.owner is None and pair.arm_frames() == [] and 1.0 not in pair.beats and pair.told(Code.SUSPENDED)
    assert state in {"IDLE", "STALE"} or pair.beats[0] == 0.0


def test_a_suspend_that_finds_only_old_state_holds_nothing_either() -> None:
    """After a sleep the newest state is old: STALE, but nothing is held there and nothing resumes."""
    pair = scene("HOLDING")
    pair.now_ns += 2 * S
    pair.receive(Suspended(slept_ns=2 * S, at_ns=pair.now_ns))
    pair.mark()
    pair.is_deaf = True
    pair.run(0.3)
    assert pair.state == "STALE" and pair.arm_frames() == [] and 1.0 not in pair.beats
    pair.is_deaf = False
    pair.run(1.0)
    assert pair.state == "READ_ONLY" and pair.arm_frames() == [] and 1.0 not in pair.beats


@pytest.mark.parametrize(("late_ms", "is_skipped"), [(20, False), (50, False), (51, True), (300, True)])
def test_a_tick_that_is_more_than_50_ms_late_is_skipped_and_told(late_ms: int, is_skipped: bool) -> None:
    """Never caught up: the next tick goes on by one period's step."""
    pair = scene("ACTIVE")
    pair.late_ns = late_ms * MS
    output = pair.step(pair.now_ns + late_ms * MS)
    assert bool(output.frames) is not is_skipped and bool(pair.told(Code.TICK_LATE)) is is_skipped
    pair.run(0.2)
    values = [frame.values for _, frame in pair.sent_on(robot.joint_command(Side.LEFT))]
    assert max(abs(b - a) for x, y in pairwise(values) for a, b in zip(x, y, strict=True)) <= 0.01 + 1e-6
    assert pair.state == "ACTIVE"


def test_a_late_tick_still_sends_stop_frames() -> None:
    """0.0, chassis zeros and lift leave whatever the time is."""
    pair = scene("ACTIVE")
    pair.tell(Estop(), "bob")
    pair.late_ns = 400 * MS
    output = pair.step(pair.now_ns + 400 * MS)
    assert {frame.topic for frame in output.frames} == {robot.FSM_ENABLE, robot.CHASSIS_VELOCITY}
