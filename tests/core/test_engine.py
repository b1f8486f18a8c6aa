"""The engine: what each event does, in which order a tick works, what a late one leaves out, and what comes out."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import msgspec
import pytest

from gateway.core.engine import Engine, Output
from gateway.core.messages.events import (
    ClientSeen,
    CommandRequested,
    EndpointHeard,
    ExitRequested,
    GuardSeen,
    HeldElsewhere,
    LinkDown,
    LinkUp,
    PartEnded,
    RobotsAnnounced,
    RouteObserved,
    SampleArrived,
    SampleRefused,
    SettingsRead,
    Suspended,
    TakenOver,
)
from gateway.core.messages.held import Held
from gateway.core.messages.outputs import FrameKind, Notice, Remembered, Reply
from gateway.core.messages.sightings import Befriended, ForeignData, Gateway, GatewayTokens
from gateway.core.output.pace import REST_NS, TICK_NS
from gateway.core.requests.answers import REPLIES_KEPT
from gateway.core.robot_state.body_model import BodyModel
from gateway.core.supervision.conditions import Conditions
from gateway.core.supervision.supervisor import State, Trigger
from gateway.errors import Code
from gateway.kinematics.description import nominal
from gateway.kinematics.identification.agreement import Agreement
from gateway.messages.incoming import OnLoss
from gateway.messages.requests import (
    Abandon,
    Acquire,
    DriveChassis,
    Enable,
    Estop,
    Move,
    Recover,
    RegisterEndpoint,
    Release,
    Request,
    Stop,
)
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import (
    CHASSIS_VELOCITY,
    CURRENT_MODE,
    FSM_ENABLE,
    FSM_STATE,
    LIFT_COMMAND,
    arm_state,
    gripper_command,
    joint_command,
)
from gateway.settings.settings import LinkSettings, LossSettings, Settings
from gateway.sim.robot.settings import SimSettings
from gateway.values import CurrentMode, FsmState, Side, Vector
from tests.pair import MS, START_NS, Pair, S

L, R = Side.LEFT, Side.RIGHT
LEAN = (*map(arm_state, Side), FSM_STATE, CURRENT_MODE)
"""State topics that matter here: fewer make a scene cheaper."""
SHORT_LOSS = LossSettings(free_after_ns=1 * S, down_after_ns=2 * S)


def pair_of(loss: LossSettings | None = None, model: str = "standard", remembered: Remembered | None = None) -> Pair:
    """A pair that hears what it needs; its link is up."""
    settings = Settings(loss=loss or LossSettings(), link=LinkSettings(model=model))
    pair = Pair(settings, SimSettings(state_period_ns=10 * MS, model=model), remembered)
    pair.topics = LEAN
    return pair


def active(loss: LossSettings | None = None, on_loss: OnLoss = OnLoss.HOLD) -> tuple[Pair, int]:
    """A pair in ACTIVE that the client `user` owns, and the epoch."""
    pair = pair_of(loss)
    epoch = pair.activate(on_loss=on_loss)
    pair.run(0.1)
    pair.notices.clear()
    pair.frames.clear()
    return pair, epoch


def beside(pair: Pair, side: Side = L, by_rad: float = 0.05) -> dict[Side, Vector]:
    """A goal a little beside where an arm is."""
    q_rad = tuple(float(q) for q in pair.robot.arms[side].q_rad)
    return {side: (q_rad[0] + by_rad, *q_rad[1:])}


def messages(pair: Pair, code: Code) -> list[str]:
    """What was said under a code."""
    return [notice.message for notice in pair.notices if notice.code is code]


def stages(pair: Pair) -> list[str]:
    """The stages of a loss, in the order in which they were told."""
    return [notice.facts["stage"] for notice in pair.notices if notice.code is Code.LOSS_STAGE]


def topics_of(output: Output) -> list[str]:
    """Topics of the frames of a tick, in order."""
    return [frame.topic for frame in output.frames]


def mode_known(pair):
    """Whether the engine's store has heard `/api/current_mode` on this link."""
    return pair.engine._coordinator.store.mode_received_ns is not None


def test_check_ins_keep_motion_allowed_and_their_lack_ends_it():
    """Of a stop endpoint; whoever moves."""
    pair, epoch = active()
    pair.granted(RegisterEndpoint(name="page", timeout_ns=200 * MS), "bob")
    pair.granted(Move(epoch=epoch, targets_rad=beside(pair, by_rad=0.3), speed=0.1))
    for _ in range(4):
        pair.receive(EndpointHeard(client_id="bob", at_ns=pair.now_ns))
        pair.run(0.15)
    assert pair.state == "ACTIVE"
    pair.run(0.1)
    assert pair.state == "HOLDING" and messages(pair, Code.ENDPOINT_SILENT)


# ------------------------------------------------------------------------------------------------ what is seen


def test_a_new_engine_has_nothing_and_sends_nothing():
    """Before the first event: OFFLINE, unowned, silent."""
    engine = Engine(Settings())
    assert (engine.state, engine.latches, engine.running_topics) == (State.OFFLINE, {}, ())
    assert (engine.owner_id, engine.open_stream_id, engine.is_streaming, engine.next_due_ns()) == (
        None,
        None,
        False,
        None,
    )
    output = engine.tick(START_NS)
    assert (output.frames, output.replies, output.notices, output.remembered, output.done) == ((), (), (), None, False)


def test_a_body_model_hears_the_robot_and_begins_anew_with_each_link():
    """It agrees after a second of the witness; another router, or a link that was lost, is another robot until shown."""
    model = BodyModel(nominal(), Settings())
    pair = Pair(model=model)
    pair.run(2.0)
    assert [model.verdict(side, pair.now_ns).state for side in Side] == [Agreement.AGREES] * 2
    for lose in (lambda: pair.up("bb"), pair.down, lambda: pair.receive(Suspended(slept_ns=S, at_ns=pair.now_ns))):
        lose()
        assert [model.verdict(side, pair.now_ns).pairs for side in Side] == [0, 0]
        pair.up()
        pair.run(2.0)
        assert [model.verdict(side, pair.now_ns).state for side in Side] == [Agreement.AGREES] * 2


def test_a_body_model_hears_only_what_is_believed():
    """Joints that come again and again with their old stamp say nothing about where the arm is now."""
    model = BodyModel(nominal(), Settings())
    pair = Pair(model=model)
    pair.run(2.0)
    pair.robot.inject({"fault": "freeze", "topic": arm_state(L)}, pair.now_ns)
    pair.run(1.0)
    states = [model.verdict(side, pair.now_ns).state for side in Side]
    assert states == [Agreement.UNKNOWN, Agreement.AGREES]


def test_latches_are_shown_as_a_copy():
    """Who looks at them cannot clear them: only `recover` does (DESIGN §8.7)."""
    engine = Engine(Settings(), Remembered(epoch=4, latches={Code.ESTOP: "estop() by ann"}))
    engine.latches.clear()
    assert engine.latches == {Code.ESTOP: "estop() by ann"}


def test_owner_streams_and_topics_are_seen():
    """Who owns the robot, what runs, when it is next due, and which stream of targets was opened last."""
    pair, epoch = active()
    assert (pair.engine.owner_id, pair.engine.open_stream_id, pair.engine.is_streaming) == ("user", None, True)
    assert pair.engine.running_topics == (
        *map(gripper_command, Side), *map(joint_command, Side), FSM_ENABLE,
    )  # fmt: skip
    assert pair.engine.next_due_ns() == pair.now_ns + 10 * MS
    first, second = pair.stream(epoch, L), pair.stream(epoch, R)
    assert first < second == pair.engine.open_stream_id


# ------------------------------------------------------------------------------------------------ events in


def test_a_sample_acts_at_once_and_a_refused_one_changes_no_value():
    """The store has it before the tick, so that requests are judged by the newest state."""
    pair = pair_of()
    mode = CurrentMode(
        api=True,
        joint_mode=dict.fromkeys(Side, True),
        arm_enabled=dict.fromkeys(Side, True),
        chassis_enabled=True,
        lift_enabled=False,
        collision_check=True,
    )
    pair.receive(
        SampleRefused(topic=CURRENT_MODE, code=Code.SAMPLE_REFUSED, message="no JSON", received_ns=pair.now_ns, count=2)
    )
    assert not mode_known(pair)
    pair.receive(SampleArrived(topic=CURRENT_MODE, value=mode, received_ns=pair.now_ns))
    assert mode_known(pair)
    seen = pair.see()
    assert seen.mode is not None and seen.topics[CURRENT_MODE].refused == 2


@pytest.mark.parametrize("value", [FsmState.READY, FsmState.PAUSE])
def test_only_a_pause_of_the_robot_ends_the_zeros(value):
    """0.0 is repeated until FSM 0 is seen; no other value is an answer to it (BEHAVIOUR, words: down)."""
    pair, _ = active()
    pair.granted(Estop())
    assert FSM_ENABLE in pair.engine.running_topics
    pair.topics = tuple(map(arm_state, Side))
    pair.run(0.2)  # an earlier sample may still tell of the time before
    pair.receive(SampleArrived(topic=FSM_STATE, value=int(value), received_ns=pair.now_ns))
    assert (FSM_ENABLE in pair.engine.running_topics) is (value is not FsmState.PAUSE)


@pytest.mark.parametrize(("late_ms", "state", "code"), [(130, "ACTIVE", ""), (160, "HOLDING", "TICK_LATE")])
def test_a_gap_beyond_the_arms_watchdog_ends_the_motion(late_ms, state, code):
    """The robot has stopped the arms meanwhile (manual §4.3): a setpoint at speed must not meet them."""
    pair, epoch = active()
    pair.move(epoch, {side: HOME_Q_RAD[side] for side in Side}, speed=0.5)
    pair.run(0.3)
    pair.late_ns = late_ms * MS
    pair.step(pair.now_ns + late_ms * MS)
    assert pair.state == state
    assert pair.see().motions[-1].code == code
    at_ns = pair.now_ns
    pair.run(0.2)
    assert (FrameKind.MOTION in pair.kinds_since(at_ns)) is (state == "ACTIVE")


def test_requests_wait_for_the_tick():
    """One reply each, in the tick after they arrived."""
    pair = pair_of()
    pair.tell(Acquire(name="ann", pid=1))
    assert pair.engine.owner_id is None
    output = pair.step()
    assert pair.engine.owner_id == "user" and [reply.facts for reply in output.replies] == [{"epoch": 1}]
    assert pair.step().replies == ()


def test_the_owner_and_stop_endpoints_are_heeded():
    """Nobody else's signs of life count; a lost owner's do, by which he comes back."""
    pair = pair_of()
    pair.step()
    assert pair.engine.heeded == frozenset()
    pair.tell(Acquire(name="ann", pid=1))
    pair.tell(RegisterEndpoint(name="page", timeout_ns=S, on_silence=OnLoss.HOLD), client="watcher")
    pair.step()
    assert pair.engine.heeded == {"user", "watcher"}


def test_who_may_undo_a_stop_is_known_until_it_is_undone():
    """Whoever keeps ids keeps his; of two who stopped nobody may, and without a latch there is nothing to undo."""
    pair = pair_of()
    pair.step()
    pair.tell(Acquire(name="ann", pid=1))
    pair.step()
    pair.tell(Stop())
    pair.step()
    assert pair.engine.stopper_id == ""
    pair.tell(Stop(), client="bob")
    pair.step()
    assert pair.engine.stopper_id == "bob" and pair.engine.heeded == {"user"}
    pair.tell(Stop(), client="carol")
    pair.step()
    assert pair.engine.stopper_id == ""


def test_of_several_targets_of_a_client_the_newest_is_followed():
    """A latest-value slot: an older one that came later in the same tick is not even refused."""
    pair, epoch = active()
    stream_id = pair.stream(epoch)
    goal = beside(pair)[L]
    for seq in (3, 5, 4):
        pair.target(epoch, stream_id, goal, seq=seq)
    pair.step()
    (view,) = pair.see().targets
    assert (view.seq, view.refused) == (5, 0)


def test_a_client_cannot_push_the_target_of_another_out():
    """Slots are kept apart by client: else anybody could starve the owner's stream."""
    pair, epoch = active()
    stream_id = pair.stream(epoch)
    goal = beside(pair)[L]
    pair.target(epoch, stream_id, goal, seq=5)
    pair.target(epoch, stream_id, goal, client="bob", seq=99)
    pair.step()
    (view,) = pair.see().targets
    assert (view.seq, view.refused) == (5, 0)


def test_the_link_comes_and_goes_with_a_notice_each():
    """A second LinkDown says nothing new."""
    pair = pair_of()
    pair.run(0.05)
    pair.down()
    pair.receive(LinkDown(at_ns=pair.now_ns))
    pair.step()
    assert [code for code in pair.codes() if code is not Code.STATE_CHANGED] == [Code.LINK_UP, Code.LINK_DOWN]
    assert pair.state == "OFFLINE"


@pytest.mark.parametrize(("zid", "restarts"), [("aa", 0), ("bb", 1)])
def test_another_router_means_that_the_robot_restarted(zid, restarts):
    """The first link and a return of the same router do not (BEHAVIOUR, robot restarted)."""
    pair = pair_of()
    pair.step()
    pair.down()
    pair.up(zid)
    pair.step()
    assert len(messages(pair, Code.ROBOT_RESTARTED)) == restarts


def test_a_new_transport_is_a_loss_of_the_old_one():
    """What was under way is lost, and nothing that was heard before counts; the arms fall silent."""
    pair, _ = active()
    pair.up("bb")
    assert pair.state == "OFFLINE" and not mode_known(pair)
    assert pair.engine.running_topics == ()
    pair.step()
    assert pair.codes()[:2] == [Code.LINK_DOWN, Code.STATE_CHANGED]
    assert pair.engine.owner_id == "user", "reconnect keeps the lease"


def test_a_sample_that_straggles_in_while_the_link_is_down_counts_for_nothing():
    """Whatever came before the new transport is of the old one."""
    pair = pair_of()
    pair.run_until(lambda: mode_known(pair))
    heard = pair.heard[CURRENT_MODE]
    pair.down()
    pair.receive(SampleArrived(topic=CURRENT_MODE, value=heard.value, received_ns=pair.now_ns))
    pair.up()
    assert not mode_known(pair)


@pytest.mark.parametrize("code", [None, Code.ROUTE_DEAD])
def test_a_dead_route_is_told_and_a_live_one_is_not(code):
    """Discovery reports both; people hear of what is wrong, with the topic."""
    pair = pair_of()
    pair.step()
    pair.notices.clear()
    pair.receive(RouteObserved(topic=FSM_ENABLE, code=code, message="no DDS reader", at_ns=pair.now_ns))
    pair.step()
    told = [(notice.code, notice.message, notice.facts) for notice in pair.notices if notice.code is Code.ROUTE_DEAD]
    assert told == ([] if code is None else [(code, "no DDS reader", {"topic": FSM_ENABLE})])


def test_robots_under_other_namespaces_are_told_and_refuse_until_that_is_over_or_the_link_is_lost():
    """Told once for each change; `enable` says it instead of a silence (BEHAVIOUR has no row; the settings' namespace)."""
    for ending in (RobotsAnnounced(elsewhere=(), at_ns=START_NS), LinkDown(at_ns=START_NS)):
        pair = pair_of()
        pair.is_deaf = True
        pair.run(0.3)
        pair.notices.clear()
        pair.receive(RobotsAnnounced(elsewhere=("bot1",), at_ns=pair.now_ns))
        pair.step()
        (told,) = messages(pair, Code.OTHER_NAMESPACE)
        assert "under namespace bot1" in told and "--namespace bot1" in told
        assert pair.engine._coordinator.other_robot is not None
        pair.receive(RobotsAnnounced(elsewhere=(), twins=("a1", "b2"), at_ns=pair.now_ns))
        pair.step()
        assert "a1, b2" in messages(pair, Code.TWO_ROBOTS)[0]
        pair.receive(ending)
        pair.step()
        assert pair.engine._coordinator.other_robot is None and len(messages(pair, Code.OTHER_NAMESPACE)) == 1


def test_a_suspend_frees_the_lease_and_takes_everything_down():
    """Nobody knows what happened meanwhile (BEHAVIOUR, suspend and resume)."""
    pair, _ = active()
    pair.receive(Suspended(slept_ns=2500 * MS, at_ns=pair.now_ns))
    pair.step()
    assert messages(pair, Code.SUSPENDED) == ["this host stood still for 2.5 s"]
    assert pair.engine.owner_id is None and pair.state == "READ_ONLY"
    assert [frame.values for _, frame in pair.frames if frame.topic == FSM_ENABLE] == [(0.0,)]


def test_after_a_request_to_end_the_engine_is_done_when_all_is_sent():
    """Brake, 0.0 until PAUSE, then done; never before (BEHAVIOUR, SIGTERM)."""
    pair, _ = active()
    pair.receive(ExitRequested(at_ns=pair.now_ns))
    pair.run_until(lambda: pair.done, 5.0)
    assert pair.robot.fsm.published == FsmState.PAUSE and pair.engine.running_topics == ()


def test_an_engine_that_lost_a_part_says_so():
    """Whoever runs it must not end as if it had been asked to."""
    pair, _ = active()
    assert not pair.engine.is_broken
    pair.receive(PartEnded(message="a thread ended", at_ns=pair.now_ns))
    pair.run_until(lambda: pair.done, 5.0)
    assert pair.engine.is_broken and pair.engine.latches == {Code.GATEWAY_BROKEN: "a thread ended"}


def test_settings_that_were_read_anew_are_those_of_the_next_tick():
    """A request that comes with them is judged by them."""
    pair, epoch = active()
    pair.receive(SettingsRead(values={"chassis.v_mps": 0.1}, message="chassis.v_mps = 0.1", at_ns=pair.now_ns))
    drive = pair.tell(DriveChassis(epoch=epoch, vx_mps=0.2, vy_mps=0.0, wz_radps=0.0))
    (reply,) = pair.step().replies
    assert reply.request_id == drive and reply.refusal.bound == "[-0.1, 0.1]"


# ------------------------------------------------------------------------------------------------ requests


def test_a_stop_comes_before_everything_that_arrived_with_it():
    """It jumps the queue: what was sent before it, or with it, moves nothing (DESIGN §8.5)."""
    pair, epoch = active()
    move = pair.tell(Move(epoch=epoch, targets_rad=beside(pair)))
    stop = pair.tell(Stop())
    output = pair.step()
    assert [reply.request_id for reply in output.replies] == [stop, move]
    assert [reply.refusal.code if reply.refusal else None for reply in output.replies] == [None, Code.STOPPED]


def again(pair: Pair, request: Request, request_id: int, client: str = "user") -> Reply:
    """Send a request under a number of the client's own choice; return its reply."""
    pair.receive(CommandRequested(client_id=client, request_id=request_id, request=request, received_ns=pair.now_ns))
    (reply,) = pair.step().replies
    return reply


def test_a_repeated_request_gets_the_first_reply_again():
    """It is carried out once, whatever was lost on the way; another client's numbers are its own."""
    pair, epoch = active()
    move = Move(epoch=epoch, targets_rad=beside(pair))
    first = again(pair, move, 900)
    assert again(pair, move, 900) is first and first.facts["motion_id"] == 1
    assert again(pair, move, 901).facts["motion_id"] == 2
    refusal = again(pair, move, 900, "bob").refusal
    assert refusal is not None and refusal.code is Code.NOT_OWNER


def test_refused_requests_are_counted_by_code():
    """Each once, however often its reply is asked for again; what was done is no refusal."""
    pair, epoch = active()
    move = Move(epoch=epoch, targets_rad=beside(pair))
    for number in (900, 900, 901):
        again(pair, move, number, "bob")
    again(pair, move, 902)
    assert pair.see().refused == {"NOT_OWNER": 2}


@pytest.mark.parametrize("request_", [Stop(), Estop()])
def test_a_stop_stops_whatever_its_number(request_):
    """Even one that was answered before is carried out again, never answered from memory."""
    pair = pair_of()
    pair.run_until(lambda: pair.state == "READ_ONLY")
    assert again(pair, request_, 7, "bob").refusal is None
    pair.granted(Recover())
    assert pair.engine.latches == {}
    assert again(pair, request_, 7, "bob").refusal is None
    assert len(pair.engine.latches) == 1


def test_only_so_many_replies_are_remembered():
    """Memory is bounded; a number that was forgotten is a new request."""
    pair = pair_of()
    assert again(pair, Acquire(name="ann", pid=1), 1).facts == {"epoch": 1}
    assert again(pair, Release(epoch=1), 2).refusal is None
    for request_id in range(3, REPLIES_KEPT + 1):
        pair.receive(
            CommandRequested(client_id="user", request_id=request_id, request=Recover(), received_ns=pair.now_ns)
        )
    assert len(pair.step().replies) == REPLIES_KEPT - 2
    assert again(pair, Acquire(name="ann", pid=1), 1).facts == {"epoch": 1} and pair.engine.owner_id is None
    again(pair, Recover(), REPLIES_KEPT + 1)
    assert again(pair, Acquire(name="ann", pid=1), 1).facts == {"epoch": 2} and pair.engine.owner_id == "user"


# ------------------------------------------------------------------------------------------------ the owner is lost


def test_a_lost_owner_is_told_and_the_robot_is_held_through_all_stages():
    """Lost: hold; then the lease is free; then everything goes down and the grip is lost (BEHAVIOUR, client lost)."""
    pair, _ = active(SHORT_LOSS)
    pair.kill()
    pair.step()
    assert (stages(pair), pair.state, pair.engine.owner_id) == (["lost"], "HOLDING", "user")
    assert messages(pair, Code.LOSS_STAGE) == ["user is lost"]
    pair.run(1.0)
    assert (stages(pair), pair.state, pair.engine.owner_id) == (["lost", "free"], "HOLDING", None)
    pair.run(1.0)
    assert (stages(pair), pair.state) == (["lost", "free", "down"], "READ_ONLY")


def test_an_owner_who_comes_back_ends_the_clocks():
    """Told as good news; the lease is his still."""
    pair, _ = active(SHORT_LOSS)
    pair.kill()
    pair.run(0.5)
    pair.receive(ClientSeen(client_id="user", at_ns=pair.now_ns))
    pair.alive.add("user")
    pair.run(3.0)
    assert (stages(pair), pair.state, pair.engine.owner_id) == (["lost", "back"], "HOLDING", "user")
    levels = {notice.facts["stage"]: notice.level.value for notice in pair.notices if notice.code is Code.LOSS_STAGE}
    assert levels == {"lost": "warning", "back": "info"}


def test_nothing_goes_down_where_nothing_is_held():
    """In STALE the end of the 60 s changes nothing and is not announced as a loss of the grip."""
    pair, _ = active(SHORT_LOSS)
    pair.is_deaf = True
    pair.kill()
    pair.run(3.0)
    assert (stages(pair), pair.state) == (["lost", "free"], "STALE")


def test_an_owner_lost_at_the_base_leaves_no_clock_of_the_hold():
    """Its lease gets free after its time; there is nothing that could go down."""
    pair = pair_of()
    pair.run_until(lambda: pair.state == "READ_ONLY")
    pair.own()
    pair.kill()
    lease = pair.see().lease
    assert lease.free_in_ns is not None and lease.down_in_ns is None


def test_an_owner_who_asked_for_a_pause_gets_it_when_he_is_lost():
    """`on_loss="pause"`: everything goes down at once and the lease is free."""
    pair, _ = active(on_loss=OnLoss.PAUSE)
    pair.kill()
    output = pair.step()
    assert [frame.values for frame in output.frames if frame.topic == FSM_ENABLE] == [(0.0,)]
    assert (pair.state, pair.engine.owner_id) == ("READ_ONLY", None)


def test_an_owner_who_abandons_is_lost_in_the_same_tick():
    """Brake and hold begin with the reply, not a tick later."""
    pair, epoch = active()
    reply = pair.ask(Abandon(epoch=epoch))
    assert (reply.refusal, pair.state, stages(pair)) == (None, "HOLDING", ["lost"])


# ------------------------------------------------------------------------------------------------ the robot


def test_conditions_are_looked_at_again_from_the_state_they_led_to():
    """ACTIVE with a dead mode and a pause: the brake does not hide the pause, both count in one tick."""
    pair, _ = active()
    pair.topics = tuple(topic for topic in LEAN if topic != CURRENT_MODE)
    pair.run_until(lambda: pair.now_ns - pair.heard[CURRENT_MODE].received_ns > 3 * S - 20 * MS)
    assert pair.state == "ACTIVE"
    pair.topics = ()
    pair.now_ns += 20 * MS
    pair.receive(SampleArrived(topic=FSM_STATE, value=0, received_ns=pair.now_ns))
    pair.step()
    changes = [notice.facts["to"] for notice in pair.notices if notice.code is Code.STATE_CHANGED]
    assert changes == ["HOLDING", "PAUSED"]


def test_a_condition_that_swings_does_not_hold_the_tick_up(monkeypatch):
    """So often and no more: the loop thread may never hang, whatever the robot's samples say."""
    looks = []

    def swing(self: Conditions, now_ns: int) -> Iterator[tuple[Trigger, str]]:
        looks.append(now_ns)
        yield (Trigger.FRESH if len(looks) % 2 == 0 else Trigger.STALE), "it swings"

    pair = pair_of()
    pair.run_until(lambda: pair.state == "READ_ONLY")
    monkeypatch.setattr(Conditions, "look", swing)
    pair.step()
    assert looks == [pair.now_ns] * 4


# ------------------------------------------------------------------------------------------------ motion


def test_a_motion_ends_when_the_arm_is_measured_at_its_goal():
    """The fresh measured state reaches the motions, and their end is told once."""
    pair, epoch = active()
    motion_id = pair.move(epoch, beside(pair))
    pair.run_until(lambda: Code.MOTION_ENDED in pair.codes(), 3.0)
    (ended,) = (notice for notice in pair.notices if notice.code is Code.MOTION_ENDED)
    assert ended.facts == {"motion_id": str(motion_id), "state": "reached", "code": ""}


def test_a_target_without_a_successor_brakes_the_arm_and_is_told():
    """1.5 s after the last one; the stream stays open (BEHAVIOUR, values)."""
    pair, epoch = active()
    stream_id = pair.stream(epoch, R)
    pair.target(epoch, stream_id, beside(pair, R)[R])
    pair.run(1.49)
    assert messages(pair, Code.TARGET_EXPIRED) == []
    pair.run(0.05)
    assert messages(pair, Code.TARGET_EXPIRED) == ["no target came in time: the right arm brakes and holds"]
    assert pair.engine.open_stream_id == stream_id


def test_a_stream_shows_that_its_targets_ask_for_too_much():
    """The reference lags behind targets that the limits do not let it follow, and the owner can see it."""
    pair, epoch = active()
    stream_id = pair.stream(epoch)
    home = beside(pair, by_rad=0.0)[L]
    seen = set()
    for seq in range(1, 60):
        offset = 0.4 if seq % 2 else -0.4
        pair.target(epoch, stream_id, (home[0] + offset, *home[1:]), seq=seq)
        pair.run(0.02)
        assert pair.snapshot is not None
        seen |= {view.limited for view in pair.snapshot.targets}
    assert True in seen
    pair.target(epoch, stream_id, home, seq=60)
    pair.run(1.0)
    assert [view.limited for view in pair.see().targets] == [False]


# ------------------------------------------------------------------------------------------------ late ticks


def test_a_late_tick_sends_stop_frames_only():
    """It is skipped, never caught up; a stop that came with it leaves all the same (BEHAVIOUR, tick late)."""
    pair, epoch = active()
    pair.move(epoch, beside(pair, by_rad=0.4))
    pair.run(0.2)
    pair.tell(Stop())
    pair.late_ns = 51 * MS
    output = pair.step()
    assert topics_of(output) == [CHASSIS_VELOCITY]
    assert messages(pair, Code.TICK_LATE) == ["a tick came 51 ms late and was skipped, not caught up"]
    assert joint_command(L) in topics_of(pair.step())


def test_a_tick_that_is_not_too_late_is_a_tick():
    """50 ms is the bound."""
    pair, _ = active()
    pair.late_ns = 50 * MS
    assert set(topics_of(pair.step())) >= {joint_command(L), joint_command(R)}
    assert messages(pair, Code.TICK_LATE) == []


def test_what_a_late_tick_finds_waiting_may_be_old():
    """Seeding begins anew after it: 0.3 s of samples until the first echo."""
    pair = pair_of()
    pair.run(0.6)
    epoch = pair.own()
    pair.late_ns = 60 * MS
    pair.step()
    late_ns = pair.now_ns
    pair.granted(Enable(epoch=epoch))
    pair.run_until(lambda: pair.sent_on(joint_command(L)) != [])
    assert pair.now_ns - late_ns >= 300 * MS


def test_the_snapshot_tells_of_ticks_and_of_the_worst_lateness():
    """Figures of the loop reach the outside."""
    pair = pair_of()
    for late_ms in (25, 3, 0):
        pair.late_ns = late_ms * MS
        pair.step()
    loop = pair.see().loop
    assert (loop.skipped, loop.worst_late_ns, loop.late_ns) == (2, 25 * MS, 0)
    assert loop.ticks == (pair.now_ns - START_NS) // TICK_NS


def test_ticks_may_be_rare_while_nobody_owns_the_robot_and_nothing_is_sent():
    """Unowned and silent, with a live robot or without one: every 50 ms, and often enough for whoever listens."""
    pair = pair_of()
    pair.run(0.2)
    assert (pair.state, pair.engine.rest_ns) == ("READ_ONLY", 20 * MS)
    pair.engine.is_watched = False
    assert pair.engine.rest_ns == REST_NS
    pair.down()
    pair.step()
    assert (pair.state, pair.engine.rest_ns) == ("OFFLINE", REST_NS)


def test_every_tick_counts_as_soon_as_anything_is_asked_owned_sent_or_owed():
    """From the request on, until the last stop frame and the last 0.0 have left; a daemon that ends does not rest."""
    pair = pair_of()
    pair.engine.is_watched = False
    pair.run(0.2)
    pair.tell(Stop())
    assert pair.engine.rest_ns == 0
    pair.step()
    assert pair.engine.rest_ns == 0, "chassis zeros for a second"
    pair.run(1.2)
    pair.granted(Recover())
    assert pair.engine.rest_ns == REST_NS
    epoch = pair.own()
    assert (pair.state, pair.engine.rest_ns) == ("IDLE", 0)
    pair.granted(Enable(epoch=epoch))
    pair.run_until(lambda: pair.state == "ACTIVE")
    assert pair.engine.rest_ns == 0
    pair.granted(Release(epoch=epoch))
    pair.run_until(lambda: pair.engine.rest_ns > 0)
    assert pair.state == "READ_ONLY" and not pair.engine.running_topics
    pair.receive(ExitRequested(at_ns=pair.now_ns))
    assert pair.engine.rest_ns == 0


def test_a_zero_that_is_owed_keeps_the_ticks_coming():
    """A 1.0 was out when the link was lost: the daemon waits for the moment at which it may take it back."""
    pair, epoch = active()
    pair.down()
    pair.step()
    pair.granted(Release(epoch=epoch))
    assert (pair.state, pair.engine.owner_id, pair.engine.rest_ns) == ("OFFLINE", None, 0)


# ------------------------------------------------------------------------------------------------ what comes out


def test_what_must_be_remembered_is_given_when_it_changes_and_only_then():
    """Epochs and latches reach the disk before they matter, and the disk is not written for nothing."""
    pair = pair_of(remembered=Remembered(epoch=4))
    linked = pair.step().remembered
    assert linked is not None and linked.routers
    assert linked == Remembered(epoch=4, routers=linked.routers)
    assert pair.step().remembered is None
    pair.tell(Acquire(name="ann", pid=1))
    assert pair.step().remembered == Remembered(epoch=5, routers=linked.routers)
    assert pair.step().remembered is None
    pair.tell(Estop(), "bob")
    assert pair.step().remembered == Remembered(epoch=5, latches={Code.ESTOP: "estop() by bob"}, routers=linked.routers)


def test_notices_and_replies_are_given_once():
    """The next tick begins with none."""
    pair = pair_of()
    pair.tell(Acquire(name="ann", pid=1))
    first, second = pair.step(), pair.step()
    assert Code.LEASE_CHANGED in [notice.code for notice in first.notices] and len(first.replies) == 1
    left: tuple[tuple[Reply, ...], tuple[Notice, ...]] = second.replies, second.notices
    assert left == ((), ())


def test_snapshots_come_at_their_rate_and_rarely_while_nobody_listens():
    """50 Hz; for those who ask without listening, every 200 ms; the numbers rise by one."""
    pair = pair_of()
    assert pair.step().snapshot is not None, "the first comes at once"
    given = [output.snapshot for output in (pair.step() for _ in range(100)) if output.snapshot]
    assert [snapshot.seq for snapshot in given] == list(range(2, 52))
    pair.engine.is_watched = False
    given = [output.snapshot for output in (pair.step() for _ in range(100)) if output.snapshot]
    assert [b.at_ns - a.at_ns for a, b in pairwise(given)] == [200 * MS] * 4


def test_grippers_leave_before_their_arms_and_the_heartbeat_never_overtakes_them():
    """Frames are in the order in which they must leave: 0.10 before the torque, setpoints before the heartbeat."""
    pair, _ = active()
    pair.tell(Stop())
    outputs = [pair.step() for _ in range(6)]
    full = next(output for output in outputs if len(output.frames) == 6)
    assert topics_of(full) == [
        *map(gripper_command, Side), *map(joint_command, Side), FSM_ENABLE, CHASSIS_VELOCITY,
    ]  # fmt: skip


@pytest.mark.parametrize("model", ["standard", "lift"])
def test_an_engine_that_failed_can_still_stop_everything(model):
    """0.0 when it is owed, zeros for the chassis, stop for the lift; no setpoint any more."""
    pair = pair_of(model=model)
    lift = [LIFT_COMMAND] * (model == "lift")
    pair.step()
    assert [frame.topic for frame in pair.engine.panic_frames(pair.now_ns)] == [CHASSIS_VELOCITY, *lift]
    pair.activate()
    frames = pair.engine.panic_frames(pair.now_ns)
    assert [frame.topic for frame in frames] == [FSM_ENABLE, CHASSIS_VELOCITY, *lift]
    assert frames[0].values == (0.0,) and {frame.kind for frame in frames} == {FrameKind.STOP}
    assert not set(pair.engine.running_topics) & set(map(joint_command, Side))
    pair.receive(LinkUp(router_zid="bb", at_ns=pair.now_ns))
    assert pair.state == "OFFLINE"


def test_a_bridge_that_delivers_everything_twice_is_told_once():
    """STATE_DUPLICATED with the count, and what helps (BEHAVIOUR, the bridge misbehaves)."""
    pair = pair_of()
    topic = arm_state(L)
    pair.run_until(lambda: topic in pair.heard)
    for _ in range(3):
        sample = pair.heard[topic]
        pair.receive(msgspec.structs.replace(sample, received_ns=pair.now_ns, count=200, duplicates=200))
        pair.run(0.02)
    (message,) = messages(pair, Code.STATE_DUPLICATED)
    assert "2 times" in message and "restart the robot's bridge" in message


def test_events_about_guards_reach_whoever_knows_them():
    """A guard that was lost is told; a hold elsewhere is shown; what a dead process had on the wire ends."""
    pair = pair_of()
    pair.run(0.1)
    pair.receive(GuardSeen(pid=7, zid="", is_linked=False, at_ns=pair.now_ns, lost="signal 9"))
    pair.receive(HeldElsewhere(is_held=True, at_ns=pair.now_ns))
    pair.receive(TakenOver(held=Held(at_ns=pair.now_ns, state="ENABLING", is_owed=True), at_ns=pair.now_ns))
    assert pair.engine.takeover.refused == "it was in ENABLING"
    guard = pair.see().guard
    assert (guard.pid, guard.lost, guard.earlier_holds) == (7, 1, True)
    assert pair.engine.rest_ns == 0, "the hold is to be taken over in the next tick"
    assert Code.GUARD_LOST in pair.codes() and Code.TAKEN_OVER in pair.codes()
    assert [frame.values for _, frame in pair.sent_on(FSM_ENABLE)][:1] == [(0.0,)]


def test_a_guards_engine_ends_its_hold_when_the_robot_is_not_heard():
    """A daemon's waits the stall out."""
    for is_guard in (True, False):
        pair, _ = active()
        held = pair.engine.takeover.show(pair.now_ns)
        pair.engine = Engine(pair.settings, is_guard=is_guard)
        pair.up()
        pair.run_until(lambda pair=pair: mode_known(pair) and pair.state == "READ_ONLY")
        pair.receive(TakenOver(held=msgspec.structs.replace(held, last_frame_ns=pair.now_ns), at_ns=pair.now_ns))
        pair.run(0.1)
        assert pair.state == "HOLDING"
        pair.is_deaf = True
        pair.frames.clear()
        pair.run(0.3)
        assert pair.state == "STALE"
        zeros = [frame for _, frame in pair.sent_on(FSM_ENABLE) if frame.values == (0.0,)]
        assert bool(zeros) is is_guard


def test_a_jump_that_is_believed_in_the_end_is_told_once():
    """Whoever held the arm there learns that it is said to be somewhere else."""
    pair = pair_of()
    topic = arm_state(L)
    pair.run_until(lambda: topic in pair.heard)
    pair.robot.inject({"fault": "jump", "side": "left", "joint": 2, "delta_rad": 0.6}, pair.now_ns)
    pair.run(2.0)
    (message,) = messages(pair, Code.STATE_JUMPED)
    assert topic in message and "joint 2 is 0.6" in message


# ------------------------------------------------------------------------------------------------ others


def test_what_is_seen_of_others_is_taken_and_our_claim_is_given():
    """Sightings act in the next tick; the number of the claim goes out with every tick."""
    pair, _ = active()
    output = pair.step()
    assert output.claim == 1
    pair.receive(GatewayTokens(gateways=(Gateway(zid="b", is_armed=True),), at_ns=pair.now_ns))
    pair.step()
    assert pair.state == "IDLE" and messages(pair, Code.OTHER_GATEWAY)
    pair.down()
    assert pair.step().claim == 0


def test_sessions_of_ours_are_remembered():
    """Our own of each link, the guard's: a restart of the daemon does not take them for somebody else."""
    pair = pair_of()
    pair.step()
    pair.receive(LinkUp(router_zid="aa", at_ns=pair.now_ns, own_zid="a1"))
    pair.receive(Befriended(zid="9a", at_ns=pair.now_ns))
    pair.step()
    assert pair.remembered.zids == ("a1", "9a")
    assert pair.step().remembered is None
    pair.restart()
    pair.receive(LinkUp(router_zid="aa", at_ns=pair.now_ns, own_zid="a2"))
    pair.receive(ForeignData(topic=FSM_ENABLE, zid="a1", at_ns=pair.now_ns))
    pair.step()
    assert pair.remembered.zids == ("a1", "9a", "a2") and messages(pair, Code.FOREIGN_WRITER) == []


@pytest.mark.parametrize(
    ("modes", "enabled", "is_posing"),
    [((True, True), True, False), ((True, False), True, True), ((True, False), False, False)],
)
def test_the_engine_says_whether_an_end_effector_decides_about_motion(modes, enabled, is_posing):
    """An enabled arm in end-effector mode: its pose must be decoded in time."""
    engine = Engine(Settings())
    assert not engine.is_posing
    mode = CurrentMode(
        api=True, joint_mode=dict(zip(Side, modes, strict=True)), arm_enabled=dict.fromkeys(Side, enabled),
        chassis_enabled=True, lift_enabled=False, collision_check=False,
    )  # fmt: skip
    engine.receive(SampleArrived(topic=CURRENT_MODE, value=mode, received_ns=5), 5)
    assert engine.is_posing is is_posing
