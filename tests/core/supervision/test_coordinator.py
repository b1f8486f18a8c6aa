"""The coordinator: what the table says is carried out on streams, motions, latches and lease, and nothing besides."""

from __future__ import annotations

import pytest

from gateway.core.body.motions import Motion, MotionState
from gateway.core.messages.events import SampleArrived
from gateway.core.messages.outputs import Frame, FrameKind, Level, Notice, Remembered
from gateway.core.motion.motion import plan
from gateway.core.robot_state.body_model import BodyModel
from gateway.core.robot_state.contact import Contacts
from gateway.core.streams.heartbeat import Beat
from gateway.core.supervision.coordinator import AT_BASE, Coordinator, EnableRecord
from gateway.core.supervision.supervisor import BASE, END_CODE, LATCH_CODE, STREAMING, TABLE, Action, State, Trigger
from gateway.errors import Code, Refusal
from gateway.kinematics.description import nominal
from gateway.messages.incoming import OnLimit
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import CHASSIS_VELOCITY, FSM_ENABLE, LIFT_COMMAND, arm_state, ee_pose, joint_command
from gateway.settings.settings import Settings
from gateway.values import ArmState, Side, Space
from tests.core.stage import GOAL, MIDDLE, MS, PLACE, L, R, S, Stage

ZERO, ONE = (0.0,), (1.0,)
LIVE = (State.ACTIVE, State.HOLDING, State.PAUSED)


class Scene(Stage):
    """A stage whose coordinator is asked directly."""

    def fire(self, trigger: Trigger, message: str = "") -> None:
        """Something happens now."""
        self.coordinator.fire(trigger, self.now_ns, message)

    def go(self, to: State, why: str = "test") -> None:
        """Enter a state."""
        self.coordinator.go(to, self.now_ns, why)

    def motion(self, *sides: Side) -> Motion:
        """These arms are on their way in one motion, fast enough not to be at rest."""
        body = self.coordinator.body
        paths = plan({side: body.arms[side].reference for side in sides}, {side: GOAL[side] for side in sides})
        motion = body.motions.open({side: GOAL[side] for side in sides}, None, paths[sides[0]].duration_ns)
        for side in sides:
            body.arms[side].follow_path(paths[side], self.epoch)
        self.run(20)
        assert not body.is_at_rest
        return motion

    def sent(self, topic: str, ticks: int = 6) -> list[Frame]:
        """Let time pass; return what was due on one topic."""
        return [frame for frame in self.run(ticks) if frame.topic == topic]

    def beats(self, ticks: int = 6) -> set[tuple[float, ...]]:
        """Let time pass; return which heartbeats were due."""
        return {frame.values for frame in self.sent(FSM_ENABLE, ticks)}

    def disable(self, *sides: Side) -> None:
        """These arms are disabled in the robot's configuration."""
        self.say_mode(arm_enabled={side: side not in sides for side in Side})

    def deafen(self, *sides: Side) -> None:
        """The state of these arms is dead."""
        self.dumb = set(sides)
        self.run(11)

    @property
    def notices(self) -> list[Notice]:
        """What was said."""
        return self.coordinator.notices


# ------------------------------------------------------------------------------------------------ the record of enable


def test_the_first_reason_for_which_an_enabling_fails_counts():
    """What follows from it is no reason; the next attempt begins with none."""
    record = EnableRecord()
    assert (record.attempt, record.outcome) == (0, "none")
    record.begin((L,))
    record.blame(Code.FSM_ERROR, "first")
    record.blame(Code.NOT_ENABLED, "second")
    assert (record.sides, record.outcome, record.code, record.message) == ((L,), "running", Code.FSM_ERROR, "first")
    record.begin((L, R))
    assert (record.attempt, record.sides, record.code, record.message) == (2, (L, R), None, "")


# ------------------------------------------------------------------------------------------------ what survives


def test_a_new_daemon_remembers_latches_and_never_gives_an_old_epoch():
    """And gives on what it has itself (BEHAVIOUR: latches and epoch survive a restart)."""
    coordinator = Coordinator(Settings(), Remembered(epoch=4, latches={Code.TRACKING_ERROR: "blocked"}))
    assert coordinator.supervisor.latches == {Code.TRACKING_ERROR: "blocked"}
    assert coordinator.remembered() == Remembered(epoch=4, latches={Code.TRACKING_ERROR: "blocked"})
    scene = Scene()
    scene.coordinator.latch(Code.FSM_ERROR, "motor", scene.now_ns)
    assert scene.coordinator.remembered() == Remembered(epoch=scene.epoch, latches={Code.FSM_ERROR: "motor"})


@pytest.mark.parametrize(("code", "unheard"), [(Code.ESTOP, True), (Code.TRACKING_ERROR, False)])
def test_an_estop_that_is_remembered_may_not_have_been_heard(code, unheard):
    """The daemon may have died with it; any other latch owes the robot nothing."""
    assert Coordinator(Settings(), Remembered(latches={code: "before"})).is_estop_unheard is unheard


# ------------------------------------------------------------------------------------------------ the body model


def test_without_a_model_nothing_is_moved_by_one():
    """Switched off in the configuration: refused, with the remedy in the code's table; there is nothing to forget."""
    coordinator = Coordinator(Settings(), Remembered())
    coordinator.forget_state()
    refusal = coordinator.model_refusal(L, S)
    assert refusal is not None and (refusal.code, refusal.field) == (Code.MODEL_OFF, "model.check")


def test_without_dynamics_nobody_feels_anything():
    """Neither without a model nor with one alone: refused, with the setting; with observers, those."""
    model = BodyModel(nominal(), Settings())
    for coordinator in (Coordinator(Settings(), Remembered()), Coordinator(Settings(), Remembered(), model)):
        refusal = coordinator.contacts
        assert isinstance(refusal, Refusal) and (refusal.code, refusal.field) == (Code.MODEL_OFF, "model.dynamics")
    model.contacts = Contacts({}, model.refusal)
    assert coordinator.contacts is model.contacts


def test_what_is_forgotten_of_the_robot_is_forgotten_of_its_model():
    """Another link may end at another robot: neither freshness nor the verdict is taken along."""
    model = BodyModel(nominal(), Settings())
    coordinator = Coordinator(Settings(), Remembered(), model)
    for count in range(60):
        now_ns = S + count * 50 * MS
        pose = model.arms[L].forward(HOME_Q_RAD[L])
        state = ArmState(q_rad=HOME_Q_RAD[L], dq_radps=(), tau_nm=(), stamp_ns=now_ns)
        for topic, value in ((ee_pose(L), pose), (arm_state(L), state)):
            model.hear(SampleArrived(topic=topic, value=value, received_ns=now_ns), now_ns)
    assert coordinator.model_refusal(L, now_ns) is None
    coordinator.forget_state()
    refusal = coordinator.model_refusal(L, now_ns)
    assert refusal is not None and refusal.code is Code.MODEL_UNKNOWN


# ------------------------------------------------------------------------------------------------ where it rests


def no_transport(scene: Scene) -> None:
    """The router is gone."""
    scene.coordinator.transport_up = False


def never_heard(scene: Scene) -> None:
    """Another daemon, whose robot has said nothing yet."""
    scene.coordinator = Coordinator(Settings(), Remembered())
    scene.coordinator.transport_up = True


def stall(scene: Scene) -> None:
    """No state for longer than 100 ms."""
    scene.now_ns += 101 * MS


def mode_silent(scene: Scene) -> None:
    """The mode is unknown."""
    scene.mode = None
    scene.run(301)


@pytest.mark.parametrize(
    ("happens", "base"),
    [
        (lambda scene: None, State.IDLE),
        (no_transport, State.OFFLINE),
        (never_heard, State.OFFLINE),
        (stall, State.STALE),
        (lambda scene: scene.say_mode(api=False), State.READ_ONLY),
        (lambda scene: scene.coordinator.lease.clear(scene.now_ns), State.READ_ONLY),
        (mode_silent, State.IDLE),
    ],
)
def test_the_base_is_where_transport_state_mode_and_owner_say(happens, base):
    """OFFLINE without transport or any state, STALE without fresh state, READ_ONLY in VR or unowned, else IDLE."""
    scene = Scene()
    happens(scene)
    assert scene.coordinator.base(scene.now_ns) is base


# ------------------------------------------------------------------------------------------------ which arms


def test_the_arms_are_those_that_are_enabled_or_stream():
    """While enabling those that were asked for, though nothing is sent for them yet; none where nothing runs."""
    enabling = Scene(State.ENABLING, sides=(R,))
    assert enabling.coordinator.sides == (R,) and enabling.coordinator.body.running_arms == ()
    assert Scene(State.ACTIVE, sides=(L,)).coordinator.sides == (L,)
    assert Scene(State.IDLE).coordinator.sides == ()


@pytest.mark.parametrize(
    ("happens", "lost"),
    [
        (lambda scene: None, {}),
        (lambda scene: scene.disable(L), {L: Code.ARM_DISABLED}),
        (lambda scene: scene.say_mode(joint_mode={L: True, R: False}), {R: Code.ARM_DISABLED}),
        (lambda scene: scene.deafen(R), {R: Code.PART_LOST}),
        (mode_silent, {}),
        (lambda scene: (scene.deafen(L, R), scene.disable(R)), {L: Code.PART_LOST, R: Code.ARM_DISABLED}),
    ],
)
def test_an_arm_is_lost_when_it_is_disabled_or_in_another_mode_or_dead(happens, lost):
    """An unknown mode takes no arm away; of two reasons the robot's configuration is told."""
    scene = Scene(State.ACTIVE)
    happens(scene)
    assert scene.coordinator.lost_arms(scene.now_ns) == lost


def test_an_arm_that_does_not_stream_cannot_be_lost():
    """Nobody asked for it."""
    scene = Scene(State.ACTIVE, sides=(L,))
    scene.deafen(R)
    assert scene.coordinator.lost_arms(scene.now_ns) == {}


# ------------------------------------------------------------------------------------------------ firing


@pytest.mark.parametrize("state", State)
def test_every_trigger_leads_where_the_table_says(state):
    """A refused one nowhere, and without a word; a latch is set where its cell says so, under its cause."""
    for trigger in Trigger:
        scene = Scene(state)
        cell = scene.coordinator.fire(trigger, scene.now_ns, "so it is")
        assert cell == TABLE[trigger][state]
        base = State.READ_ONLY if Action.FREE in cell.do else State.IDLE
        base = State.OFFLINE if state is State.OFFLINE else base
        assert scene.state is {None: state, BASE: base}.get(cell.to, cell.to), trigger
        latched = {LATCH_CODE[trigger]: "so it is"} if Action.LATCH in cell.do else {}
        assert scene.coordinator.supervisor.latches == latched, trigger
        assert (scene.coordinator.lease.owner is None) == (Action.FREE in cell.do), trigger
        if cell.refuse is not None:
            assert scene.notices == [], trigger


def test_every_trigger_that_latches_or_cuts_has_a_code_for_it():
    """A motion that ends without its own code would tell its caller nothing."""

    def rows(action: Action) -> set[Trigger]:
        return {trigger for trigger, row in TABLE.items() if any(action in cell.do for cell in row.values())}

    assert rows(Action.LATCH) == set(LATCH_CODE)
    assert rows(Action.CUT) <= set(END_CODE)


@pytest.mark.parametrize(("message", "told"), [("it was pushed", "it was pushed"), ("", "tracking error")])
def test_what_happens_is_told_in_words_and_else_by_its_name(message, told):
    """In the latch, in the notices and with the motion that ended."""
    scene = Scene(State.ACTIVE)
    motion = scene.motion(L)
    scene.fire(Trigger.TRACKING, message)
    assert (motion.code, motion.message) == (Code.TRACKING_ERROR, told)
    assert scene.coordinator.supervisor.latches == {Code.TRACKING_ERROR: told}
    assert scene.told(Code.LATCH_CHANGED) == [f"latched TRACKING_ERROR: {told}"]
    assert scene.told(Code.STATE_CHANGED) == [f"ACTIVE -> HOLDING: {told}"]


def test_a_cause_that_is_latched_already_is_not_told_again():
    """The first message stays."""
    scene = Scene(State.IDLE)
    for message in ("first", "second"):
        scene.coordinator.latch(Code.FSM_ERROR, message, scene.now_ns)
    assert scene.told(Code.LATCH_CHANGED) == ["latched FSM_ERROR: first"]
    assert [(notice.level, notice.facts) for notice in scene.notices] == [(Level.ERROR, {"code": "FSM_ERROR"})]


# ------------------------------------------------------------------------------------------------ motions that end


def test_a_cut_ends_motions_and_targets_and_brakes():
    """With the code of what cut them; the setpoint comes to rest and is held."""
    scene = Scene(State.ACTIVE)
    body = scene.coordinator.body
    motion = scene.motion(L)
    stream = body.targets.open(R, "ann", scene.epoch, 1.0, OnLimit.CLIP, None)
    scene.fire(Trigger.CLIENT_LOST)
    assert (motion.state, motion.code) == (MotionState.ABORTED, Code.CLIENT_LOST)
    assert (stream.is_open, stream.code) == (False, Code.CLIENT_LOST)
    assert {frame.kind for frame in scene.sent(joint_command(L), 3)} == {FrameKind.BRAKE}
    scene.run(100)
    assert body.is_at_rest and scene.state is State.HOLDING


def test_how_a_motion_ended_is_told_with_its_id_state_and_code():
    """Loud when something ended it, quiet when it arrived; why only where there is a reason."""
    scene = Scene()
    book = scene.coordinator.body.motions
    good, bad = book.open({L: GOAL[L]}, None, S), book.open({R: GOAL[R]}, None, S)
    book.end(good, MotionState.REACHED, None, "")
    book.end(bad, MotionState.ABORTED, Code.STATE_STALE, "no state")
    scene.coordinator.report_ended([good, bad], scene.now_ns)
    assert [(notice.level, notice.message, notice.facts) for notice in scene.notices] == [
        (Level.INFO, "motion 1 reached", {"motion_id": "1", "state": "reached", "code": ""}),
        (
            Level.WARNING,
            "motion 2 aborted: no state",
            {"motion_id": "2", "state": "aborted", "code": "STATE_STALE"},
        ),
    ]


@pytest.mark.parametrize(
    ("happens", "trigger", "code", "told"),
    [
        (
            lambda scene: scene.disable(R),
            Trigger.ARM_DISABLED,
            Code.ARM_DISABLED,
            "left arm PART_LOST, right arm ARM_DISABLED: gone",
        ),
        (
            lambda scene: scene.deafen(L),
            Trigger.PART_DEAD,
            Code.PART_LOST,
            "left arm PART_LOST, right arm PART_LOST: gone",
        ),
    ],
)
def test_a_motion_of_two_arms_ends_for_both_when_one_is_lost(happens, trigger, code, told):
    """With a code for each, told once; the other arm brakes (BEHAVIOUR, two arms in one motion)."""
    scene = Scene(State.ACTIVE)
    motion = scene.motion(L, R)
    happens(scene)
    scene.fire(trigger, "gone")
    assert (motion.state, motion.code, motion.message) == (MotionState.ABORTED, code, told)
    assert scene.told(Code.MOTION_ENDED) == [f"motion 1 aborted: {told}"]
    assert scene.state is State.HOLDING


def test_motions_of_one_arm_end_with_what_happened_when_the_other_is_lost():
    """They share nothing: the code is the trigger's."""
    scene = Scene(State.ACTIVE)
    left, right = scene.motion(L), scene.motion(R)
    scene.deafen(R)
    scene.fire(Trigger.PART_DEAD, "gone")
    assert {(motion.code, motion.message) for motion in (left, right)} == {(Code.PART_LOST, "gone")}


def test_a_disabled_arm_falls_silent_and_the_other_is_held():
    """The robot takes no more setpoints for it; only the next `enable` brings it back."""
    scene = Scene(State.ACTIVE)
    scene.disable(L)
    scene.fire(Trigger.ARM_DISABLED)
    assert scene.sent(joint_command(L)) == []
    assert {frame.kind for frame in scene.sent(joint_command(R))} == {FrameKind.HOLD}
    assert scene.coordinator.enable.sides == (R,) and scene.state is State.HOLDING


def test_an_arm_is_let_go_where_nothing_else_happens():
    """In HOLDING the cell is empty: there is nothing to brake."""
    scene = Scene(State.HOLDING)
    scene.disable(R)
    scene.fire(Trigger.ARM_DISABLED)
    assert scene.coordinator.sides == scene.coordinator.enable.sides == (L,) and scene.notices == []


def test_an_arm_whose_state_is_dead_goes_on_being_held():
    """The robot still follows it; its stream is not let go."""
    scene = Scene(State.ACTIVE)
    scene.deafen(L)
    scene.fire(Trigger.PART_DEAD)
    assert scene.coordinator.sides == (L, R) and scene.state is State.HOLDING


# ------------------------------------------------------------------------------------------------ entering a state


@pytest.mark.parametrize("state", State)
def test_to_go_where_one_is_changes_nothing(state):
    """No notice, no beginning anew: levels fire on every tick."""
    scene = Scene(state)
    since_ns = scene.coordinator.supervisor.since_ns
    scene.run(1)
    scene.go(state)
    assert scene.notices == [] and scene.coordinator.supervisor.since_ns == since_ns


@pytest.mark.parametrize("to", [state for state in State if state is not State.ENABLING])
def test_a_change_of_state_is_told_louder_when_the_robot_is_lost(to):
    """With both states as facts."""
    scene = Scene(State.ENABLING)
    scene.go(to, "because")
    (notice,) = scene.notices
    loud = to in {State.PAUSED, State.STALE, State.OFFLINE}
    assert notice.level is (Level.WARNING if loud else Level.INFO)
    assert (notice.code, notice.message) == (Code.STATE_CHANGED, f"ENABLING -> {to}: because")
    assert notice.facts == {"came_from": "ENABLING", "to": to.value}


@pytest.mark.parametrize("to", State)
def test_arms_stream_where_they_may_and_nowhere_else(to):
    """In STALE only because they are at rest; from an enabling they would be silent there, too."""
    scene = Scene(State.STOPPING if to is State.ACTIVE else State.ACTIVE)
    scene.go(to)
    assert bool(scene.coordinator.body.running_arms) == (to in STREAMING | {State.STALE})


@pytest.mark.parametrize("to", LIVE)
def test_an_echo_becomes_a_hold_when_the_robot_follows(to):
    """In ENABLING it is none yet."""
    scene = Scene(State.ENABLING)
    assert scene.phases.starting.seed((L, R), scene.now_ns) is None
    topic = joint_command(L)
    assert {frame.kind for frame in scene.sent(topic)} == {FrameKind.ECHO}
    scene.go(to)
    assert {frame.kind for frame in scene.sent(topic)} == {FrameKind.HOLD}


@pytest.mark.parametrize("to", State)
def test_no_one_is_sent_where_the_robot_is_not_armed(to):
    """1.0 ceases at once in PAUSED, STALE and the base; 0.0 that is under way goes on everywhere."""
    armed = {State.ENABLING, State.ACTIVE, State.HOLDING, State.STOPPING}
    scene = Scene(State.HOLDING if to is State.ACTIVE else State.ACTIVE)
    scene.go(to)
    assert scene.beats() == ({ONE} if to in armed else set())
    ending = Scene(State.HOLDING if to is State.ACTIVE else State.ACTIVE)
    ending.coordinator.body.heartbeat.zeros(ending.now_ns)
    ending.go(to)
    assert ending.beats() == {ZERO}


@pytest.mark.parametrize("to", State)
def test_where_nothing_is_held_nothing_has_to_go_down(to):
    """The 60 s end in the base only; a lost owner's 10 s go on."""
    scene = Scene(State.HOLDING if to is State.ACTIVE else State.ACTIVE)
    lease = scene.coordinator.lease
    lease.abandon("ann", scene.epoch, scene.now_ns)
    scene.go(to)
    assert (lease.view(scene.now_ns).down_in_ns is None) == (to in AT_BASE)
    assert lease.view(scene.now_ns).free_in_ns == 10 * S


def test_an_enabling_that_becomes_active_is_done_and_any_other_end_is_a_failure():
    """Blamed on what ended it, unless there was a reason already."""
    outcomes = []
    for to, reason in ((State.ACTIVE, None), (State.IDLE, None), (State.IDLE, Code.FSM_BUSY)):
        scene = Scene(State.ENABLING)
        record = scene.coordinator.enable
        if reason is not None:
            record.blame(reason, "before")
        scene.go(to, "because")
        outcomes.append((record.outcome, record.code, record.message))
    assert outcomes == [
        ("ok", None, ""),
        ("failed", Code.NOT_ENABLED, "because"),
        ("failed", Code.FSM_BUSY, "before"),
    ]


@pytest.mark.parametrize(("trigger", "code"), [(Trigger.FSM_ERROR, Code.FSM_ERROR), (Trigger.OWNER_STOP, Code.STOPPED)])
def test_an_enabling_that_is_cut_fails_with_the_code_of_what_cut_it(trigger, code):
    """And with its words."""
    scene = Scene(State.ENABLING)
    scene.fire(trigger, "ended")
    record = scene.coordinator.enable
    assert (record.outcome, record.code, record.message) == ("failed", code, "ended")


def test_what_is_cut_after_an_enabling_does_not_change_how_it_went():
    """It was a success."""
    scene = Scene(State.ENABLING)
    scene.go(State.ACTIVE)
    scene.fire(Trigger.OTHER_STOP)
    assert (scene.coordinator.enable.outcome, scene.coordinator.enable.code) == ("ok", None)


# ------------------------------------------------------------------------------------------------ STALE


@pytest.mark.parametrize("came_from", [state for state in State if state is not State.STALE])
def test_only_a_stall_of_a_held_robot_can_be_short(came_from):
    """From ACTIVE or HOLDING it may be resumed; a paused arm is held, too, but not resumed (BEHAVIOUR, stale)."""
    scene = Scene(came_from)
    scene.go(State.STALE)
    assert scene.coordinator.can_resume == (came_from in {State.ACTIVE, State.HOLDING})
    assert scene.coordinator.stale_hold == (came_from in LIVE)
    assert bool(scene.sent(joint_command(L))) == (came_from in LIVE)


def test_an_arm_that_moves_when_the_state_is_lost_falls_silent():
    """Only constant frames may go on; the stall can still be short."""
    scene = Scene(State.ACTIVE)
    scene.motion(L)
    scene.fire(Trigger.STALE)
    assert scene.state is State.STALE and scene.coordinator.can_resume
    assert not scene.coordinator.stale_hold and scene.coordinator.body.running_arms == ()


def test_without_an_arm_there_is_nothing_to_hold_in_a_stall():
    """A robot whose arms have all been let go."""
    scene = Scene(State.HOLDING, sides=())
    scene.go(State.STALE)
    assert not scene.coordinator.stale_hold


@pytest.mark.parametrize("trigger", [Trigger.DISABLE, Trigger.HOLD_OVER, Trigger.ESTOP, Trigger.JOINT_ORDER])
def test_what_would_end_a_hold_ends_it_in_a_stall_at_once(trigger):
    """No hold frame, no 1.0 any more and no way back, though the robot is still not heard."""
    scene = Scene(State.HOLDING)
    scene.go(State.STALE)
    scene.coordinator.resuming = True
    scene.coordinator.body.heartbeat.ones(scene.now_ns)
    scene.now_ns += 101 * MS
    scene.fire(trigger)
    coordinator = scene.coordinator
    assert scene.state is State.STALE
    assert not (
        coordinator.stale_hold or coordinator.can_resume or coordinator.resuming or coordinator.body.running_arms
    )
    assert coordinator.body.heartbeat.beat is not Beat.ONE


def test_the_way_back_is_given_up_only_where_it_is_taken():
    """In HOLDING streams and heartbeat go on."""
    scene = Scene(State.HOLDING)
    scene.coordinator.give_up_resuming()
    assert scene.beats() == {ONE} and len(scene.coordinator.body.running_arms) == 2


def test_an_interrupted_resumption_sends_no_one():
    """What is not one sends what it did."""
    scene = Scene(State.STALE)
    heartbeat = scene.coordinator.body.heartbeat
    heartbeat.zeros(scene.now_ns)
    scene.coordinator.stop_resuming()
    assert scene.beats() == {ZERO}
    heartbeat.ones(scene.now_ns)
    scene.coordinator.resuming = True
    scene.coordinator.stop_resuming()
    assert scene.beats() == set() and not scene.coordinator.resuming


def test_any_change_of_state_ends_a_resumption():
    """It belongs to one stall."""
    scene = Scene(State.HOLDING)
    scene.go(State.STALE)
    scene.coordinator.resuming = True
    scene.go(State.HOLDING)
    assert not (scene.coordinator.resuming or scene.coordinator.can_resume or scene.coordinator.stale_hold)


# ------------------------------------------------------------------------------------------------ 0.0


@pytest.mark.parametrize("trigger", [Trigger.DISABLE, Trigger.RELEASE])
def test_after_a_loss_a_zero_leaves_only_when_it_is_owed(trigger):
    """Our 1.0 was out, or it was not."""
    owed = Scene(State.STALE)
    owed.fire(trigger)
    assert owed.beats() == {ZERO}
    never = Scene(State.STALE)
    never.coordinator.body.heartbeat.is_owed = False
    never.fire(trigger)
    assert never.beats() == set()


def test_beside_another_writer_one_zero_is_all():
    """Never two setpoints in turn (BEHAVIOUR, foreign data)."""
    scene = Scene(State.HOLDING)
    scene.fire(Trigger.FOREIGN_DATA)
    assert [frame.values for frame in scene.sent(FSM_ENABLE, 30)] == [ZERO]


@pytest.mark.parametrize("trigger", [Trigger.FSM_FOREIGN, Trigger.VR_MODE, Trigger.OTHER_GATEWAY])
def test_an_fsm_that_is_not_ours_hears_neither_one_nor_zero(trigger):
    """It would pause somebody else's work."""
    scene = Scene(State.ACTIVE)
    scene.fire(trigger)
    assert scene.beats() == set() and scene.state is State.IDLE


def test_without_transport_only_an_estop_begins_to_repeat_zero():
    """Any other 0.0 might arrive at somebody else's robot."""
    scene = Scene(State.HOLDING)
    scene.coordinator.transport_up = False
    scene.fire(Trigger.DISABLE)
    scene.fire(Trigger.AT_REST)
    assert ZERO not in scene.beats() and not scene.coordinator.is_estop_unheard
    scene.fire(Trigger.ESTOP)
    assert scene.beats() == {ZERO} and scene.coordinator.is_estop_unheard
    assert scene.coordinator.body.heartbeat.is_estop


def pause_unheard() -> Scene:
    """A pause whose 0.0 was repeated for its time while the robot stayed READY."""
    scene = Scene(State.PAUSED)
    scene.fire(Trigger.FSM_READY)
    scene.run(210)
    assert scene.coordinator.body.heartbeat.gave_up_at_ns is not None
    return scene


@pytest.mark.parametrize("trigger", [Trigger.FSM_READY, Trigger.FSM_SLOW_START])
def test_a_zero_that_found_no_hearing_is_not_begun_anew_by_what_merely_stays(trigger):
    """The level asks on every tick; a stop that somebody asks for is sent again."""
    scene = pause_unheard()
    scene.fire(trigger)
    assert scene.beats() == set()
    scene.fire(Trigger.DISABLE)
    assert scene.beats() == {ZERO}


def test_another_pause_is_told_to_the_robot_again():
    """What was not heard before belongs to the one before."""
    scene = pause_unheard()
    scene.go(State.ACTIVE)
    scene.run(1)
    scene.go(State.PAUSED)
    scene.fire(Trigger.FSM_READY)
    assert scene.beats() == {ZERO}


# ------------------------------------------------------------------------------------------------ chassis, lift, lease


def test_a_stop_stops_the_ground_for_a_second():
    """Chassis zeros and lift [0,1], whoever drove them; the arms are only braked."""
    scene = Scene(State.ACTIVE, model="lift")
    scene.fire(Trigger.OWNER_STOP)
    due = scene.run(120)
    chassis = [frame.values for frame in due if frame.topic == CHASSIS_VELOCITY]
    lift = [frame.values for frame in due if frame.topic == LIFT_COMMAND]
    assert set(chassis) == {(0.0, 0.0, 0.0)} and set(lift) == {(0.0, 1.0)}
    assert {frame.values for frame in due if frame.topic == FSM_ENABLE} == {ONE}


def test_an_estop_takes_the_lifts_servo_off_in_the_end():
    """[0,1] for a second, then [0,0] once; 0.0, and a latch."""
    scene = Scene(State.ACTIVE, model="lift")
    scene.fire(Trigger.ESTOP, "red button")
    due = scene.run(120)
    lift = [frame.values for frame in due if frame.topic == LIFT_COMMAND]
    assert lift[-1] == (0.0, 0.0) and set(lift[:-1]) == {(0.0, 1.0)}
    assert {frame.values for frame in due if frame.topic == FSM_ENABLE} == {ZERO}
    assert scene.coordinator.supervisor.latches == {Code.ESTOP: "red button"}


def test_a_sleep_of_this_host_frees_the_lease_and_says_so():
    """The epoch stays spent."""
    scene = Scene(State.HOLDING)
    scene.fire(Trigger.SUSPENDED, "slept for 3 s")
    assert scene.coordinator.lease.owner is None and scene.coordinator.lease.epoch == scene.epoch
    assert scene.told(Code.LEASE_CHANGED) == ["the lease is free: slept for 3 s"]
    assert scene.state is State.READ_ONLY


# ------------------------------------------------------------------------------------------------ chassis and lift


@pytest.mark.parametrize("state", [State.IDLE, State.ENABLING, State.ACTIVE, State.HOLDING])
def test_a_cut_ends_the_driving(state):
    """Zeros at once, for whoever would go on with it the reason (BEHAVIOUR, words: cut)."""
    scene = Scene(state)
    chassis = scene.coordinator.body.chassis
    chassis.drive((0.2, 0.0, 0.0), epoch=scene.epoch, expires_ns=scene.now_ns + S, now_ns=scene.now_ns)
    scene.run(10)
    scene.fire(Trigger.STALE)
    assert chassis.code is Code.STATE_STALE
    assert {frame.values for frame in scene.sent(CHASSIS_VELOCITY)} == {(0.0, 0.0, 0.0)}


@pytest.mark.parametrize("state", [State.IDLE, State.ENABLING, State.HOLDING])
def test_a_long_gap_ends_the_driving_and_leaves_the_arms_alone(state):
    """What the robot did meanwhile is not known: a velocity of before the gap must not meet it."""
    scene = Scene(state)
    chassis = scene.coordinator.body.chassis
    chassis.drive((0.2, 0.0, 0.0), epoch=scene.epoch, expires_ns=scene.now_ns + S, now_ns=scene.now_ns)
    scene.run(10)
    scene.fire(Trigger.LONG_GAP)
    assert (chassis.code, chassis.is_driven, scene.state) == (Code.TICK_LATE, False, state)


# ------------------------------------------------------------------------------------------------ spaces


def test_an_arm_is_measured_and_judged_in_the_space_of_its_stream():
    """Joints, or the pose; what was never heard is None."""
    scene = Scene(State.ACTIVE, poses=(R,))
    coordinator = scene.coordinator
    assert (coordinator.measured(L), coordinator.measured(R)) == (MIDDLE[L], PLACE[R])
    assert coordinator.fit_arms(scene.now_ns) == (L, R)
    coordinator.body.choose(L, Space.POSE)
    assert coordinator.measured(L) is None and not coordinator.part_fresh(L, scene.now_ns)
    assert not coordinator.seedable(L, scene.now_ns) and coordinator.seedable(R, scene.now_ns)
    assert coordinator.fit_arms(scene.now_ns) == (R,)
    assert coordinator.lost_arms(scene.now_ns) == {}


def test_the_joints_of_an_arm_that_was_never_heard_are_unknown():
    """No number is made up."""
    assert Scene(State.IDLE, dumb={L}).coordinator.measured(L) is None


def test_spaces_are_chosen_by_the_robots_mode_for_silent_arms_only():
    """A stream that runs is kept: the arm is lost first, and let go."""
    scene = Scene(State.ACTIVE, sides=(L,))
    scene.say_mode(joint_mode={L: False, R: False})
    scene.coordinator.choose_spaces((L, R), scene.now_ns)
    assert [scene.coordinator.body.arms[side].space for side in (L, R)] == [Space.JOINT, Space.POSE]
    assert scene.coordinator.lost_arms(scene.now_ns) == {L: Code.ARM_DISABLED}


def test_without_a_known_mode_nothing_is_chosen_and_nothing_fits():
    """It has not been heard for 3 s."""
    scene = Scene(State.IDLE)
    scene.mode = None
    scene.run(301)
    scene.coordinator.choose_spaces((L, R), scene.now_ns)
    assert scene.coordinator.fit_arms(scene.now_ns) is None
    assert all(arm.space is Space.JOINT for arm in scene.coordinator.body.arms.values())


def test_poses_decide_once_an_enabled_arm_is_said_to_be_in_end_effector_mode():
    """Then they must be decoded in time; before the robot has said its mode, nobody knows."""
    assert not Scene(State.IDLE).coordinator.is_posing
    assert Scene(State.IDLE, poses=(R,)).coordinator.is_posing
    assert not Coordinator(Settings(), Remembered()).is_posing


class Doubting(BodyModel):
    """A model that says what it is told to say."""

    is_against = True

    def contradicts(self, *_: object) -> bool:
        """Whatever is asked."""
        return self.is_against


def test_an_arm_is_seeded_where_samples_pose_and_model_agree():
    """A pose that is not heard, or no model, is no objection; a contradiction is, and so are samples that differ."""
    scene = Scene(poses=(L,))
    scene.coordinator.model = model = Doubting(nominal(), Settings())
    scene.coordinator.choose_spaces((L, R), scene.now_ns)
    assert not scene.coordinator.seedable(L, scene.now_ns) and not scene.coordinator.agreed(L, scene.now_ns)
    assert scene.coordinator.seedable(R, scene.now_ns), "its pose is not heard"
    model.is_against = False
    assert scene.coordinator.seedable(L, scene.now_ns) and scene.coordinator.agreed(L, scene.now_ns)
    scene.push(R, 0.1)
    assert not scene.coordinator.agreed(R, scene.now_ns)
    scene.deafen(L)
    assert not scene.coordinator.agreed(L, scene.now_ns)
