"""The handler: who gets the lease, what `enable` demands, what a stop does, and what `recover` clears."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gateway.core.handover.takeover import LATCHED_BEFORE, Takeover
from gateway.core.messages.events import PartEnded, SampleRefused, TargetArrived
from gateway.core.messages.outputs import Level
from gateway.core.messages.sightings import Gateway, Means, Writer
from gateway.core.requests.handler import RequestHandler
from gateway.core.requests.moves import Facts
from gateway.core.streams.heartbeat import Beat
from gateway.core.supervision.supervisor import State
from gateway.errors import Code, Refusal
from gateway.messages.incoming import OnLoss
from gateway.messages.requests import (
    Abandon,
    Acquire,
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
    Request,
    Stop,
    Take,
)
from gateway.robot.limits import JOINT_UPPER_RAD
from gateway.robot.topics import arm_state, joint_command
from gateway.values import FsmState, Role, Side, Vector
from tests.changed import replace
from tests.core.stage import GOAL, MIDDLE, MS, L, R, S, Stage

FALSE = dict.fromkeys(Side, False)
ACQUIRE_BOB = Acquire(name="bob", pid=8)
TAKE_BOB = Take(name="bob", pid=8, reason="he left")


class Scene(Stage):
    """A stage with a handler."""

    def __init__(self, state: State = State.IDLE, **how: object) -> None:
        super().__init__(state, **how)
        self.handler = RequestHandler(self.coordinator, self.phases)

    def granted(self, request: Request, client: str = "ann", received_ns: int | None = None) -> Facts:
        """Ask for what must be granted; return the facts."""
        answer = self.handler.answer(self.command(request, client, received_ns), self.now_ns)
        assert not isinstance(answer, Refusal), answer
        return answer

    def refused(self, request: Request, client: str = "ann", received_ns: int | None = None) -> Refusal:
        """Ask for what must be refused; state and latches stay as they are."""
        before = self.state, dict(self.coordinator.supervisor.latches), self.coordinator.lease.epoch
        answer = self.handler.answer(self.command(request, client, received_ns), self.now_ns)
        assert isinstance(answer, Refusal), answer
        assert (self.state, self.coordinator.supervisor.latches, self.coordinator.lease.epoch) == before
        return answer

    def refused_enable(self) -> Refusal:
        """Ann's `enable` must be refused."""
        return self.refused(Enable(epoch=self.epoch))

    def enable(self) -> Facts:
        """Ann's `enable` must be granted."""
        return self.granted(Enable(epoch=self.epoch))

    @property
    def owner(self) -> str | None:
        """Who owns the robot."""
        owner = self.coordinator.lease.owner
        return owner.client_id if owner else None

    @property
    def latches(self) -> dict[Code, str]:
        """What is latched."""
        return self.coordinator.supervisor.latches


# ------------------------------------------------------------------------------------------------ the lease


def test_a_free_robot_is_given_to_who_asks():
    """READ_ONLY becomes IDLE; the reply has the epoch, a notice the owner."""
    scene = Scene(State.READ_ONLY, owner=None)
    assert scene.granted(Acquire(name="ann", pid=7)) == {"epoch": 1}
    assert (scene.owner, scene.state) == ("ann", State.IDLE)
    assert scene.told(Code.LEASE_CHANGED) == ["ann (pid 7) owns the robot, epoch 1"]


def test_an_owner_who_asks_again_keeps_his_epoch_and_nothing_is_told():
    """It is the same lease; `on_loss` may change."""
    scene = Scene()
    again = Acquire(name="ann", pid=7, on_loss=OnLoss.PAUSE)
    assert scene.granted(again) == {"epoch": scene.epoch} and scene.told(Code.LEASE_CHANGED) == []
    assert scene.coordinator.lease.view(scene.now_ns).on_loss == "pause"


def test_a_robot_that_is_owned_is_given_to_nobody_else():
    """The refusal says whose it is; nothing moves."""
    scene = Scene()
    refusal = scene.refused(ACQUIRE_BOB, "bob")
    assert refusal.code is Code.LEASE_HELD and "'ann'" in refusal.message and scene.owner == "ann"


@pytest.mark.parametrize("request_", [ACQUIRE_BOB, TAKE_BOB, Enable(epoch=1), Disable(epoch=1)])
def test_a_daemon_that_ends_takes_no_owner_and_no_orders(request_):
    """What it holds is on its way down."""
    scene = Scene()
    scene.coordinator.is_exiting = True
    client = "bob" if isinstance(request_, (Acquire, Take)) else "ann"
    assert scene.refused(request_, client).code is Code.EXITING


def test_a_takeover_brakes_first_and_tells_why():
    """Epoch and owner change at once; the former motion ends as LEASE_LOST; new motions wait until rest."""
    scene = Scene(State.ACTIVE)
    scene.granted(Move(epoch=scene.epoch, targets_rad=GOAL))
    scene.run(40)
    assert scene.granted(TAKE_BOB, "bob") == {"epoch": scene.epoch + 1}
    assert (scene.owner, scene.state) == ("bob", State.HOLDING)
    assert scene.told(Code.LEASE_CHANGED) == ["bob (pid 8) took the robot from ann: he left"]
    (notice,) = [notice for notice in scene.coordinator.notices if notice.code is Code.LEASE_CHANGED]
    assert (dict(notice.facts), notice.at_ns) == ({"epoch": str(scene.epoch + 1)}, scene.now_ns)
    assert [view.code for view in scene.coordinator.body.motions.views()] == ["LEASE_LOST"]
    move = Move(epoch=scene.epoch + 1, targets_rad={L: MIDDLE[L]})
    assert scene.refused(move, "bob").code is Code.TAKEOVER_BRAKING
    scene.q_rad = {side: scene.coordinator.body.arms[side].reference.rest_values() for side in Side}
    scene.coordinator.store.reset()  # the arms followed meanwhile; steps of the samples are no matter of this test
    scene.run(100)
    assert scene.granted(move, "bob")["motion_id"] == 2


def test_a_robot_that_nobody_owns_can_be_taken_too():
    """The same word for people, whoever owns it."""
    scene = Scene(State.READ_ONLY, owner=None)
    assert scene.granted(TAKE_BOB, "bob") == {"epoch": 1}
    assert scene.told(Code.LEASE_CHANGED) == ["bob (pid 8) took the robot from nobody: he left"]


def test_taking_needs_a_reason():
    """It is shown to the former owner."""
    scene = Scene()
    assert scene.refused(Take(name="bob", pid=8, reason=" "), "bob").field == "reason"
    assert scene.owner == "ann"


def test_an_owner_who_takes_his_own_robot_is_not_braked():
    """He has it already: nothing is cut, nothing is told."""
    scene = Scene(State.ACTIVE)
    scene.granted(Move(epoch=scene.epoch, targets_rad=GOAL))
    assert scene.granted(Take(name="ann", pid=7, reason="mine")) == {"epoch": scene.epoch}
    assert scene.state is State.ACTIVE and len(scene.coordinator.body.motions.running) == 1
    assert scene.coordinator.notices == []


def test_releasing_stops_first():
    """ACTIVE: brake, then 0.0; the lease is free at once."""
    scene = Scene(State.ACTIVE)
    assert scene.granted(Release(epoch=scene.epoch)) == {}
    assert (scene.owner, scene.state) == (None, State.STOPPING)
    assert scene.told(Code.LEASE_CHANGED) == ["the lease was released"]


@pytest.mark.parametrize("make", [Release, Abandon, Disable, Enable])
def test_only_the_owner_gives_up_or_orders(make):
    """Another client, and an old epoch, change nothing."""
    scene = Scene(State.ACTIVE)
    assert scene.refused(make(epoch=scene.epoch), "bob").code is Code.NOT_OWNER
    scene.granted(TAKE_BOB, "bob")
    assert scene.refused(make(epoch=scene.epoch), "bob").code is Code.LEASE_STALE
    assert scene.owner == "bob"


def test_an_owner_who_abandons_counts_as_lost():
    """The lease stays his until the clocks have run; the engine tells the supervisor (`Lease.poll`)."""
    scene = Scene(State.ACTIVE)
    assert scene.granted(Abandon(epoch=scene.epoch)) == {}
    assert scene.coordinator.lease.lost and scene.owner == "ann"


# ------------------------------------------------------------------------------------------------ enable


def test_enable_begins_an_attempt_for_the_enabled_arms():
    """The outcome is seen in the snapshot; a disabled arm is left alone."""
    scene = Scene()
    assert scene.enable() == {"attempt": 1, "outcome": "running", "walking": False}
    assert (scene.state, scene.coordinator.sides) == (State.ENABLING, (L, R))
    other = Scene()
    other.say_mode(arm_enabled={L: False, R: True})
    other.enable()
    assert other.coordinator.sides == (R,)


@pytest.mark.parametrize(
    ("state", "outcome"), [(State.ENABLING, "running"), (State.ACTIVE, "ok"), (State.HOLDING, "ok")]
)
def test_enable_where_it_is_done_or_under_way_is_a_success(state, outcome):
    """Nothing is sent and no attempt is counted (BEHAVIOUR, `enable` when ENABLING or ACTIVE)."""
    scene = Scene(state)
    assert scene.enable() == {"attempt": 1, "outcome": outcome, "walking": False}
    assert scene.state is state and scene.enable()["attempt"] == 1


def test_enable_is_refused_after_a_stop_that_came_later():
    """What was sent before it must not start the robot again."""
    scene = Scene()
    scene.granted(Stop())
    request = Enable(epoch=scene.epoch)
    assert scene.refused(request, received_ns=scene.now_ns - 1).code is Code.STOPPED
    scene.run(1)
    assert scene.enable()["attempt"] == 1


@pytest.mark.parametrize(
    ("state", "code"),
    [(State.STOPPING, Code.STOPPING), (State.STALE, Code.STATE_STALE), (State.OFFLINE, Code.NO_LINK)],
)
def test_enable_is_refused_where_the_table_says_so(state, code):
    """With the table's own code."""
    assert Scene(state).refused_enable().code is code


@pytest.mark.parametrize("state", [State.IDLE, State.PAUSED, State.HOLDING])
def test_enable_is_refused_while_something_is_latched(state):
    """Only `recover` clears it (DESIGN §8.7)."""
    scene = Scene(state, latches={Code.TRACKING_ERROR: "the left arm was held"})
    refusal = scene.refused_enable()
    assert refusal.code is Code.LATCHED and "the left arm was held" in refusal.message


def in_mode(**changes: object) -> Callable[[Scene], None]:
    """The robot's mode is another one."""
    return lambda scene: scene.say_mode(**changes)


def with_fsm(value: int) -> Callable[[Scene], None]:
    """The robot's FSM is in another state."""

    def change(scene: Scene) -> None:
        scene.fsm = value
        scene.run(1)

    return change


def unheard(scene: Scene) -> None:
    """`/fsm_state` falls silent."""
    scene.fsm = None
    scene.run(51)


def unknown_mode(scene: Scene) -> None:
    """`/api/current_mode` falls silent."""
    scene.mode = None
    scene.run(301)


def zeros_running(scene: Scene) -> None:
    """0.0 is still being repeated."""
    scene.coordinator.body.heartbeat.zeros(scene.now_ns)


def right_arm_silent(scene: Scene) -> None:
    """The state of one arm is dead."""
    scene.dumb = {R}
    scene.run(11)


def right_arm_forgotten(scene: Scene) -> None:
    """One arm has not been heard since the link came back."""
    scene.dumb = {R}
    scene.coordinator.store.reset()
    scene.run(2)


def far_outside(scene: Scene) -> None:
    """The left arm's first joint stands 0.1 rad beyond its limit."""
    scene.push(L, JOINT_UPPER_RAD[L][0] + 0.1 - MIDDLE[L][0])


@pytest.mark.parametrize(
    ("happens", "code", "field"),
    [
        (unknown_mode, Code.MODE_UNKNOWN, "mode"),
        (in_mode(api=False), Code.MODE_VR, "mode"),
        (in_mode(arm_enabled=FALSE), Code.NO_ARM_ENABLED, ""),
        (unheard, Code.FSM_UNKNOWN, ""),
        (with_fsm(FsmState.ERROR), Code.FSM_ERROR, ""),
        (with_fsm(FsmState.SLOW_START), Code.FSM_BUSY, "fsm_state"),
        (with_fsm(FsmState.READY), Code.FSM_BUSY, "fsm_state"),
        (with_fsm(FsmState.PLAY), Code.FSM_BUSY, "fsm_state"),
        (zeros_running, Code.FSM_BUSY, ""),
        (right_arm_silent, Code.PART_STALE, "right_arm"),
        (right_arm_forgotten, Code.PART_STALE, "right_arm"),
        (far_outside, Code.START_OUTSIDE_LIMITS, "left_arm[0]"),
    ],
)
def test_enable_is_refused_while_the_robot_is_in_no_state_for_it(happens, code, field):
    """No attempt is begun, and the robot hears nothing (BEHAVIOUR, transitions and values)."""
    scene = Scene()
    happens(scene)
    refusal = scene.refused_enable()
    assert (refusal.code, refusal.field) == (code, field)
    assert field != "fsm_state" or (refusal.value, refusal.bound) == (str(int(scene.fsm)), "0")
    assert scene.coordinator.enable.attempt == 0
    assert {frame.values for frame in scene.run(5)} <= {(0.0,)}, "nothing but a 0.0 that was under way"


def test_an_arm_that_was_never_heard_cannot_be_enabled():
    """Its stream would have nowhere to start."""
    scene = Scene(dumb={R})
    refusal = scene.refused_enable()
    assert (refusal.code, refusal.field) == (Code.PART_STALE, "right_arm")


def test_enable_goes_on_from_a_pause_without_a_gap():
    """PAUSED re-seeds at once: the streams are live (BEHAVIOUR, starting and continuing)."""
    scene = Scene(State.PAUSED)
    scene.fsm = int(FsmState.PAUSE)
    scene.coordinator.body.heartbeat.silence()
    scene.run(1)
    assert scene.enable()["outcome"] == "running" and scene.state is State.ENABLING
    assert len(scene.coordinator.body.running_arms) == 2


def test_enable_in_holding_leads_strayed_references_back():
    """*walk*: the grip is kept, the reply says that it takes a while."""
    scene = Scene(State.HOLDING)
    scene.push(L, 0.4)
    scene.run(5)
    assert scene.enable() == {"attempt": 1, "outcome": "ok", "walking": True}
    assert scene.state is State.HOLDING and len(scene.told(Code.WALK)) == 1


def test_enable_in_holding_says_when_an_arm_cannot_be_led_back():
    """Outside its limits there is no way back; nothing walks."""
    scene = Scene(State.HOLDING)
    far_outside(scene)
    scene.run(5)
    assert scene.refused_enable().code is Code.START_OUTSIDE_LIMITS
    assert not scene.coordinator.body.is_walking


def test_enable_in_holding_starts_an_arm_that_was_enabled_again():
    """Only then, and only when its state can be trusted (BEHAVIOUR, an arm is enabled again)."""
    scene = Scene(State.HOLDING, sides=(L,))
    scene.dumb = {R}
    scene.run(20)
    assert scene.refused_enable().code is Code.PART_STALE
    scene.dumb = set()
    scene.run(40)
    assert scene.enable()["outcome"] == "ok" and len(scene.coordinator.body.running_arms) == 2


def test_disable_brakes_to_rest_and_keeps_the_lease():
    """0.0 follows at rest."""
    scene = Scene(State.ACTIVE)
    assert scene.granted(Disable(epoch=scene.epoch)) == {}
    assert (scene.state, scene.owner) == (State.STOPPING, "ann")


# ------------------------------------------------------------------------------------------------ motion requests


def test_every_motion_request_is_carried_out():
    """The handler knows a place for each kind of request."""
    scene = Scene(State.ACTIVE)
    epoch = scene.epoch
    assert scene.granted(Move(epoch=epoch, targets_rad=GOAL))["motion_id"] == 1
    assert scene.granted(Cancel(epoch=epoch, motion_id=1)) == {"state": "cancelled"}
    assert scene.granted(OpenStream(epoch=epoch, side=L))["stream_id"] == 1
    assert scene.granted(Hold(epoch=epoch, sides=(R,))) == {}
    assert scene.granted(CloseStream(epoch=epoch, stream_id=1)) == {"code": "CANCELLED"}


def test_a_target_reaches_its_stream():
    """And its arm begins to move."""
    scene = Scene(State.ACTIVE)
    scene.granted(OpenStream(epoch=scene.epoch, side=L))
    goal: Vector = GOAL[L]
    scene.handler.take_target(
        TargetArrived(client_id="ann", stream_id=1, epoch=scene.epoch, seq=4, values=goal, received_ns=scene.now_ns),
        scene.now_ns,
    )
    scene.run(10)
    assert scene.coordinator.body.targets.views()[0].seq == 4 and not scene.coordinator.body.is_at_rest


# ------------------------------------------------------------------------------------------------ stop


@pytest.mark.parametrize(
    ("client", "reason", "message"),
    [
        ("ann", "", "stop() by the owner"),
        ("ann", "spill", "stop() by the owner: spill"),
        ("bob", "", "stop() by bob"),
        ("bob", "spill", "stop() by bob: spill"),
    ],
)
def test_anybody_stops_and_only_the_owners_stop_leaves_no_latch(client, reason, message):
    """The motion ends, the chassis gets zeros, the robot is held."""
    scene = Scene(State.ACTIVE)
    scene.granted(Move(epoch=scene.epoch, targets_rad=GOAL))
    assert scene.granted(Stop(reason=reason), client) == {"stop_undelivered": False}
    assert scene.latches == ({} if client == "ann" else {Code.STOPPED_BY_OTHER: message})
    assert scene.state is State.HOLDING and scene.coordinator.body.chassis.running
    assert [view.message for view in scene.coordinator.body.motions.views()] == [message]


@pytest.mark.parametrize("code", [Code.ESTOP, Code.STOPPED_BY_OTHER])
def test_a_stop_says_the_name_that_came_along_and_is_judged_by_the_id(code):
    """The remedy is to ask who stopped the robot; nobody becomes the owner by calling himself so."""
    scene = Scene(State.ACTIVE)
    request = Estop() if code is Code.ESTOP else Stop()
    stop = replace(scene.command(request, "0a1b2c3d"), name="ann")
    scene.handler.answer(stop, scene.now_ns)
    assert scene.latches == {code: f"{'estop' if code is Code.ESTOP else 'stop'}() by ann"}
    assert scene.coordinator.supervisor.stopper == "0a1b2c3d"


@pytest.mark.parametrize(("reason", "message"), [("", "estop() by ann"), ("smoke", "estop() by ann: smoke")])
@pytest.mark.parametrize("state", [State.READ_ONLY, State.IDLE, State.ACTIVE, State.HOLDING, State.PAUSED])
def test_an_estop_pauses_the_robot_and_latches_even_for_the_owner(state, reason, message):
    """In any state: 0.0, zeros for the chassis (BEHAVIOUR, estop)."""
    scene = Scene(state)
    assert scene.granted(Estop(reason=reason)) == {"stop_undelivered": False}
    assert scene.latches == {Code.ESTOP: message}
    assert scene.coordinator.body.heartbeat.beat is Beat.ZERO and scene.coordinator.body.chassis.running
    assert scene.coordinator.body.running_arms == ()


def test_anybody_stops_a_robot_that_nobody_owns():
    """A stop needs no lease; without an owner it is always somebody else's."""
    scene = Scene(State.READ_ONLY, owner=None)
    scene.granted(Stop(), "ann")
    assert scene.latches == {Code.STOPPED_BY_OTHER: "stop() by ann"}


@pytest.mark.parametrize("request_", [Stop(), Estop()])
def test_a_stop_without_transport_says_that_it_was_not_delivered(request_):
    """Loudly, with the remedy: the physical emergency stop."""
    scene = Scene(State.OFFLINE)
    assert scene.granted(request_, "bob") == {"stop_undelivered": True}
    levels = [notice.level for notice in scene.coordinator.notices if notice.code is Code.STOP_UNDELIVERED]
    assert levels == [Level.ERROR] and len(scene.latches) == 1
    assert "physical emergency stop" in scene.told(Code.STOP_UNDELIVERED)[0]


# ------------------------------------------------------------------------------------------------ recover


def test_recover_clears_all_causes_and_says_which():
    """By anybody; it neither moves nor enables (DESIGN §8.7)."""
    scene = Scene(latches={Code.ESTOP: "estop() by ann", Code.TRACKING_ERROR: "blocked"})
    assert scene.granted(Recover(), "bob") == {"cleared": ["ESTOP", "TRACKING_ERROR"]}
    assert (scene.latches, scene.state, scene.coordinator.is_estop_unheard) == ({}, State.IDLE, False)
    assert scene.told(Code.LATCH_CHANGED) == ["recover() by bob cleared ESTOP, TRACKING_ERROR"]


def test_recover_with_nothing_latched_is_no_news():
    """It is granted, and nothing is told."""
    scene = Scene(State.ACTIVE)
    assert scene.granted(Recover()) == {"cleared": []} and scene.coordinator.notices == []


def test_recover_lets_silent_endpoints_go_only_with_a_reason():
    """Who let them go, and why, is told."""
    scene = Scene()
    scene.coordinator.endpoints.register("pad", "page", 500 * MS, OnLoss.HOLD, scene.now_ns)
    scene.coordinator.endpoints.look(scene.now_ns + S, 0)
    assert scene.refused(Recover()).field == "reason" and scene.coordinator.endpoints.silent == ["page"]
    assert scene.granted(Recover(reason="its page was closed")) == {"cleared": [], "dismissed": ["page"]}
    assert scene.told(Code.ENDPOINT_CHANGED) == ["recover() by ann let stop endpoint 'page' go: its page was closed"]


@pytest.mark.parametrize(("state", "code"), [(State.OFFLINE, Code.NO_LINK), (State.STALE, Code.STATE_STALE)])
def test_recover_needs_to_see_the_robot(state, code):
    """Nobody can know whether a cause persists."""
    scene = Scene(state, latches={Code.ESTOP: "estop() by ann"})
    refusal = scene.refused(Recover())
    assert refusal.code is code and refusal.message.startswith("recover() needs to see the robot")


def test_recover_that_was_sent_before_a_stop_clears_nothing():
    """It meant another latch."""
    scene = Scene()
    scene.granted(Estop(), "bob")
    assert scene.refused(Recover(), received_ns=scene.now_ns).code is Code.STOPPED
    scene.run(1)
    assert scene.granted(Recover()) == {"cleared": ["ESTOP"]}


@pytest.mark.parametrize(("fsm", "is_silent", "persists"), [(-1, False, True), (-1, True, True), (0, False, False)])
def test_an_fsm_in_error_persists_until_another_value_is_heard(fsm, is_silent, persists):
    """Silence is no recovery; the other causes stay, too: all or none."""
    scene = Scene(latches={Code.FSM_ERROR: "motor fault", Code.ESTOP: "estop() by ann"})
    with_fsm(fsm)(scene)
    if is_silent:
        unheard(scene)
    if persists:
        assert scene.refused(Recover()).field == "FSM_ERROR"
    else:
        assert scene.granted(Recover()) == {"cleared": ["FSM_ERROR", "ESTOP"]}


def test_an_fsm_in_error_that_was_never_latched_does_not_bind_recover():
    """While nothing of ours ran it is a condition, not a latch (BEHAVIOUR, the robot does something by itself)."""
    scene = Scene(latches={Code.ESTOP: "estop() by ann"})
    with_fsm(FsmState.ERROR)(scene)
    assert scene.granted(Recover()) == {"cleared": ["ESTOP"]}


@pytest.mark.parametrize("latch", [Code.JOINT_ORDER, Code.ESTOP])
def test_a_wrong_order_of_joints_persists_while_it_is_heard(latch):
    """It is not our robot; a second after the last such sample the cause is gone."""
    scene = Scene(latches={latch: "before"})
    for at_ns in (scene.now_ns - 50 * MS, scene.now_ns):
        wrong = SampleRefused(topic=arm_state(L), code=Code.JOINT_ORDER, message="names differ", received_ns=at_ns)
        scene.coordinator.store.receive(wrong, scene.now_ns)
    if latch is Code.JOINT_ORDER:
        refusal = scene.refused(Recover())
        assert (refusal.code, refusal.message, refusal.field) == (Code.LATCH_PERSISTS, "names differ", "JOINT_ORDER")
        scene.run(101)
    assert scene.granted(Recover()) == {"cleared": [latch.value]}


def test_recover_in_holding_leads_strayed_references_back():
    """What is held stays held; the reference walks to the arm that was pushed away."""
    scene = Scene(State.HOLDING, latches={Code.TRACKING_ERROR: "pushed"})
    scene.push(L, 0.4)
    scene.run(5)
    assert scene.granted(Recover()) == {"cleared": ["TRACKING_ERROR"]}
    assert scene.state is State.HOLDING and scene.coordinator.body.is_walking


def test_recover_leads_references_back_once_the_silent_endpoint_is_let_go():
    """It is in nobody's way any more."""
    scene = Scene(State.HOLDING)
    scene.push(L, 0.4)
    scene.run(5)
    scene.coordinator.endpoints.register("pad", "page", 500 * MS, OnLoss.HOLD, scene.now_ns)
    scene.coordinator.endpoints.look(scene.now_ns + S, 0)
    assert scene.granted(Recover(reason="its page was closed"))["dismissed"] == ["page"]
    assert scene.coordinator.body.is_walking


def test_recover_clears_even_when_an_arm_cannot_be_led_back():
    """And tells why nothing walks: the latch's cause is gone, the arm's place is another matter."""
    scene = Scene(State.HOLDING, latches={Code.TRACKING_ERROR: "pushed"})
    far_outside(scene)
    scene.run(5)
    assert scene.granted(Recover()) == {"cleared": ["TRACKING_ERROR"]}
    assert len(scene.told(Code.START_OUTSIDE_LIMITS)) == 1 and not scene.coordinator.body.is_walking


def test_recover_outside_of_holding_leads_nothing():
    """PAUSED: the robot does not follow; the next `enable` starts where the arms are."""
    scene = Scene(State.PAUSED, latches={Code.ESTOP: "before"})
    scene.push(L, 0.4)
    scene.granted(Recover())
    assert not scene.coordinator.body.is_walking


def test_enable_is_refused_while_an_earlier_daemons_guard_holds():
    """Nothing of ours must leave beside it."""
    scene = Scene(State.IDLE)
    scene.coordinator.guard.earlier_holds = True
    assert scene.refused_enable().code is Code.HELD_BY_GUARD
    assert scene.state is State.IDLE


# ------------------------------------------------------------------------------------------------ others


def announce(scene: Scene, *zids: str) -> None:
    """These sessions announce setpoints, and no others."""
    writers = [Writer(topic=joint_command(L), zid=zid, means=Means.TOKEN) for zid in zids]
    scene.coordinator.others.see_writers(writers, scene.now_ns)


def test_enable_is_refused_beside_somebody_else_by_name():
    """A writer by FOREIGN_WRITER, a gateway by OTHER_GATEWAY; both go away by themselves, nothing is latched."""
    scene = Scene()
    announce(scene, "b")
    refusal = scene.refused_enable()
    assert refusal.code is Code.FOREIGN_WRITER and "zenoh session b" in refusal.message
    scene.coordinator.others.see_gateways([Gateway(zid="c", is_armed=True)], scene.now_ns)
    refusal = scene.refused_enable()
    assert (refusal.code, refusal.value) == (Code.OTHER_GATEWAY, "c")
    announce(scene)
    scene.coordinator.others.see_gateways([], scene.now_ns)
    scene.enable()


@pytest.mark.parametrize("latch", [Code.FOREIGN_WRITER, Code.ESTOP])
def test_a_foreign_writer_persists_while_it_is_there(latch):
    """Only a latch of its own binds `recover`; another gateway is no writer."""
    scene = Scene(latches={latch: "test"})
    announce(scene, "b")
    if latch is Code.ESTOP:
        assert scene.granted(Recover())["cleared"] == ["ESTOP"]
        return
    refusal = scene.refused(Recover())
    assert (refusal.code, refusal.field) == (Code.LATCH_PERSISTS, "FOREIGN_WRITER") and "b" in refusal.message
    announce(scene)
    scene.coordinator.others.see_gateways([Gateway(zid="c", is_armed=True)], scene.now_ns)
    assert scene.granted(Recover())["cleared"] == ["FOREIGN_WRITER"]


def test_what_a_kind_of_request_would_meet_can_be_asked_without_asking_for_it():
    """The same answer as the request's own, and nothing is begun."""
    stage = Stage(State.IDLE)
    handler = RequestHandler(stage.coordinator, stage.phases)
    command = stage.command(None, "ann", stage.now_ns + 1)
    assert handler.may["enable"](command, stage.epoch, stage.now_ns) is None and stage.state is State.IDLE
    assert handler.may["left_arm"](command, stage.epoch, stage.now_ns).code is Code.NOT_ENABLED
    assert handler.may["enable"](command, stage.epoch + 1, stage.now_ns).code is Code.NOT_OWNER
    assert "lift" not in handler.may and "lift" in RequestHandler(Stage(model="lift").coordinator, stage.phases).may


def test_the_desk_goes_on_with_what_takes_more_than_one_tick(monkeypatch):
    """Once a tick, whatever it is."""
    scene, steps = Scene(State.ACTIVE), []
    monkeypatch.setattr(scene.handler._cartesian, "step", steps.append)
    scene.handler.move_on(scene.now_ns)
    assert steps == [scene.now_ns]


def test_a_gateway_that_is_broken_cannot_be_recovered():
    """It ends; the next one can."""
    scene = Scene(latches={Code.ESTOP: "before"})
    scene.phases.end(PartEnded(message="a thread ended", at_ns=scene.now_ns), scene.now_ns)
    refusal = scene.refused(Recover())
    assert (refusal.code, refusal.field) == (Code.LATCH_PERSISTS, "GATEWAY_BROKEN")
    assert set(scene.coordinator.supervisor.latches) == {Code.ESTOP, Code.GATEWAY_BROKEN}


# ------------------------------------------------------------------------------------------------ roles


def asked(scene: Scene, request: Request, client: str, role: Role) -> Code | None:
    """Ask under a role; return the code of the refusal."""
    answer = scene.handler.answer(replace(scene.command(request, client), role=role), scene.now_ns)
    return answer.code if isinstance(answer, Refusal) else None


def test_only_an_admin_takes_the_robot_by_force():
    """An operator takes it from nobody, and again from himself."""
    scene = Scene(State.IDLE)
    assert asked(scene, TAKE_BOB, "bob", Role.OPERATOR) is Code.NOT_PERMITTED and scene.owner == "ann"
    assert asked(scene, Take(name="ann", pid=7, reason="x"), "ann", Role.OPERATOR) is None
    assert asked(scene, TAKE_BOB, "bob", Role.ADMIN) is None and scene.owner == "bob"
    empty = Scene(State.IDLE)
    empty.granted(Release(epoch=empty.epoch))
    assert empty.owner is None and asked(empty, TAKE_BOB, "bob", Role.OPERATOR) is None


@pytest.mark.parametrize("stop", [Stop(), Estop()])
def test_an_operator_undoes_no_stop_of_somebody_else(stop):
    """His own he may, faults he may; a stop that two have left, or an earlier daemon, is for an admin."""
    scene = Scene(State.IDLE)
    scene.granted(stop, "bob", received_ns=scene.now_ns - 1)
    assert asked(scene, Recover(), "ann", Role.OPERATOR) is Code.NOT_PERMITTED
    assert asked(scene, Recover(), "bob", Role.OPERATOR) is None and not scene.coordinator.supervisor.latches
    for client in ("bob", "bob", "carol"):
        scene.granted(stop, client, received_ns=scene.now_ns - 1)
    assert asked(scene, Recover(), "bob", Role.OPERATOR) is Code.NOT_PERMITTED
    assert asked(scene, Recover(), "carol", Role.OPERATOR) is Code.NOT_PERMITTED
    assert asked(scene, Recover(), "ann", Role.ADMIN) is None
    scene.coordinator.latch(Code.TRACKING_ERROR, "blocked", scene.now_ns)
    assert asked(scene, Recover(), "carol", Role.OPERATOR) is None


def test_a_stop_of_an_earlier_daemon_is_nobodys_own():
    """It does not know any more who it was."""
    scene = Scene(State.IDLE)
    scene.coordinator.latch(Code.ESTOP, "estop() by bob", scene.now_ns)
    assert asked(scene, Recover(), "bob", Role.OPERATOR) is Code.NOT_PERMITTED


def test_a_stop_that_was_handed_over_is_nobodys_own():
    """Whoever stopped before, with a latch that was undone, with none, or with one that stands still, may not undo it."""
    for client, is_recovered in (("bob", True), ("ann", False), ("bob", False)):
        scene = Scene(State.IDLE)
        scene.granted(Stop(), client, received_ns=scene.now_ns - 1)
        if is_recovered:
            assert asked(scene, Recover(), client, Role.OPERATOR) is None
        takeover = Takeover(scene.coordinator, lambda topic, values, step: None, is_guard=False)
        takeover.latch(Code.ESTOP, LATCHED_BEFORE, scene.now_ns)
        assert asked(scene, Recover(), client, Role.OPERATOR) is Code.NOT_PERMITTED
        assert asked(scene, Recover(), client, Role.ADMIN) is None


def test_only_an_admin_lets_a_silent_stop_endpoint_go():
    """With a reason or without: somebody else watched."""
    scene = Scene(State.IDLE)
    scene.coordinator.endpoints.register("pad", "page", 500 * MS, OnLoss.HOLD, scene.now_ns)
    scene.coordinator.endpoints.look(scene.now_ns + S, 0)
    assert asked(scene, Recover(reason="its page was closed"), "ann", Role.OPERATOR) is Code.NOT_PERMITTED
    assert asked(scene, Recover(reason="its page was closed"), "ann", Role.ADMIN) is None


@pytest.mark.parametrize("role", Role)
def test_no_role_keeps_a_stop_away(role):
    """Not even a viewer's."""
    scene = Scene(State.ACTIVE)
    assert asked(scene, Stop(), "bob", role) is None and asked(scene, Estop(), "bob", role) is None
    assert Code.ESTOP in scene.coordinator.supervisor.latches
