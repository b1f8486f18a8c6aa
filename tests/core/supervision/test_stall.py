"""The stall: what is held while the robot is not heard, the way back, and the 0.0 that is owed afterwards."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.messages.sightings import ForeignData, Gateway, Means, Writer
from gateway.core.supervision.stall import RESUME_NS, Stall
from gateway.core.supervision.supervisor import State, Trigger
from gateway.errors import Code
from gateway.messages.requests import Estop
from gateway.robot.limits import JOINT_UPPER_RAD
from gateway.robot.topics import FSM_ENABLE, joint_command
from gateway.values import FsmState, Side
from tests.changed import replace
from tests.core.stage import MODE, TICK_NS, R, S, Stage

READY, PAUSE, SLOW_START, ERROR = (
    int(x) for x in (FsmState.READY, FsmState.PAUSE, FsmState.SLOW_START, FsmState.ERROR)
)


class Stalled(Stage):
    """A stage whose stall is stepped, and whose robot can fall silent.

    Args:
        state: Where the silence begins.
        options: As for `Stage`.
    """

    def __init__(self, state: State = State.ACTIVE, **options: object) -> None:
        super().__init__(state, **options)
        self.stall = Stall(self.coordinator, self.phases.starting)
        self.is_deaf = False

    def hear(self) -> None:
        """The robot says what it has to say, unless it is not heard."""
        if not getattr(self, "is_deaf", False):
            super().hear()

    def go_on(self, ticks: int) -> list[Frame]:
        """Let time pass with a step of the stall in every tick, before the streams; return what left."""
        left: list[Frame] = []
        for _ in range(ticks):
            self.now_ns += TICK_NS
            self.hear()
            store = self.coordinator.store
            if self.state not in {State.STALE, State.OFFLINE} and not store.is_fresh(self.now_ns):
                self.coordinator.fire(Trigger.STALE, self.now_ns, "test")
            self.stall.step(self.now_ns)
            frames = [stream.frame(self.now_ns) for stream in self.coordinator.body.streams if stream.running]
            left += [frame for frame in frames if frame is not None]
        return left

    def fall_silent(self, ticks: int) -> list[Frame]:
        """The robot is not heard for so long after it is STALE; return what left in STALE."""
        self.is_deaf = True
        while self.state is not State.STALE:
            self.go_on(1)
        return self.go_on(ticks)

    def come_back(self, ticks: int) -> list[Frame]:
        """The robot is heard again."""
        self.is_deaf = False
        return self.go_on(ticks)


def beats(frames: list[Frame]) -> list[float]:
    """The heartbeats among frames."""
    return [frame.values[0] for frame in frames if frame.topic == FSM_ENABLE]


def setpoints(frames: list[Frame]) -> list[Frame]:
    """The arm frames among frames."""
    return [frame for frame in frames if frame.topic != FSM_ENABLE]


# ------------------------------------------------------------------------------------------------------------- hold


@pytest.mark.parametrize("state", [State.ACTIVE, State.HOLDING, State.PAUSED])
def test_references_at_rest_are_repeated_for_0_8_s_and_no_longer(state: State) -> None:
    """Constant frames, no 1.0; then silence."""
    stage = Stalled(state)
    kept = stage.fall_silent(80)
    assert {frame.kind for frame in setpoints(kept)} == {FrameKind.HOLD} and len(setpoints(kept)) == 160
    assert 1.0 not in beats(kept)
    assert setpoints(stage.go_on(50)) == [] and not stage.coordinator.stale_hold


@pytest.mark.parametrize("says", ["VR", "no arm", "FSM 3", "ERROR"])
def test_a_slow_topic_that_still_speaks_ends_the_hold(says: str) -> None:
    """VR mode, no arm in joint mode, FSM 3-6 and ERROR would end HOLDING, and end this as well."""
    stage = Stalled(State.HOLDING)
    stage.fall_silent(10)
    stage.dumb = set(Side)
    stage.is_deaf = False
    changes = {"VR": {"api": False}, "no arm": {"joint_mode": dict.fromkeys(Side, False)}}.get(says)
    if changes:
        stage.fsm = None
        stage.say_mode(**changes)
    else:
        stage.mode, stage.fsm = None, 3 if says == "FSM 3" else ERROR
    assert setpoints(stage.go_on(5)) == [] and stage.state is State.STALE
    assert (Code.FSM_ERROR in stage.coordinator.supervisor.latches) is (says == "ERROR")


def test_an_error_is_latched_only_after_our_own_1_0() -> None:
    """Nothing of ours ran: a condition, not a latch."""
    stage = Stalled(State.IDLE)
    stage.fall_silent(3)
    stage.dumb, stage.is_deaf, stage.fsm = set(Side), False, ERROR
    stage.go_on(5)
    assert not stage.coordinator.supervisor.latches


# ---------------------------------------------------------------------------------------------------------- the way back


def test_a_short_stall_ends_in_holding_with_1_0_at_once() -> None:
    """1.0 as soon as the FSM says READY, HOLDING as soon as the arms can be seeded, the streams never silent."""
    stage = Stalled(State.ACTIVE)
    stage.fall_silent(20)
    first = stage.come_back(2)
    assert beats(first) == [1.0] and stage.state is State.STALE and stage.coordinator.resuming
    kept = stage.come_back(40)
    assert stage.state is State.HOLDING and {frame.kind for frame in setpoints(kept)} == {FrameKind.HOLD}
    assert len(setpoints(kept)) == 80 and stage.told(Code.STATE_CHANGED)[-1].endswith("resumes explicitly")


def test_streams_that_fell_silent_start_again_where_the_arms_are() -> None:
    """The stall lasted just under 0.8 s, so the hold was over before the arms could be seeded."""
    stage = Stalled(State.ACTIVE)
    stage.fall_silent(75)
    frames = setpoints(stage.come_back(50))
    assert stage.state is State.HOLDING and FrameKind.ECHO in {frame.kind for frame in frames}


@pytest.mark.parametrize(("lasts", "is_noticed"), [(53, False), (75, True)])
def test_a_hold_whose_time_ended_goes_on_as_it_was_unless_the_robot_may_have_noticed(
    lasts: int, *, is_noticed: bool
) -> None:
    """Under torque the arms must not jump to where they sag; after 100 ms without setpoints the grip is gone anyway."""
    stage = Stalled(State.HOLDING)
    held = {frame.topic: frame.values for frame in setpoints(stage.fall_silent(lasts))}
    stage.q_rad = {side: tuple(q + 0.002 for q in stage.q_rad[side]) for side in Side}
    frames = setpoints(stage.come_back(60))
    first = {frame.topic: frame.values for frame in reversed(frames) if frame.kind is FrameKind.ECHO}
    assert stage.state is State.HOLDING
    for topic in map(joint_command, Side):
        assert (first[topic] == held[topic]) is not is_noticed


def test_an_arm_that_left_its_limits_meanwhile_is_not_started() -> None:
    """Nothing starts, everything goes to the base."""
    stage = Stalled(State.ACTIVE)
    stage.fall_silent(75)
    first, *others = JOINT_UPPER_RAD[R]
    stage.q_rad[R] = (first + 0.2, *others)
    stage.coordinator.store.reset()  # so that no guard doubts the new posture
    stage.come_back(1)
    stage.coordinator.can_resume = True
    stage.come_back(60)
    assert stage.state is State.IDLE and not stage.coordinator.body.running_arms


@pytest.mark.parametrize(("lasts", "resumes"), [(70, True), (82, False)])
def test_a_stall_is_short_when_it_lasts_less_than_0_8_s(lasts: int, resumes: bool) -> None:
    """Counted from STALE on, to the first fresh state."""
    stage = Stalled(State.HOLDING)
    stage.fall_silent(lasts)
    stage.come_back(45)
    assert (stage.state is State.HOLDING) is resumes and (stage.state is State.IDLE) is not resumes


@pytest.mark.parametrize("state", [State.IDLE, State.PAUSED, State.STOPPING, State.ENABLING])
def test_only_active_and_holding_are_resumed(state: State) -> None:
    """From every other state the way back is the base."""
    stage = Stalled(state)
    stage.fall_silent(10)
    assert 1.0 not in beats(stage.come_back(3)) and stage.state is State.IDLE


@pytest.mark.parametrize("value", [PAUSE, SLOW_START])
def test_a_robot_that_is_not_ready_any_more_is_not_resumed(value: int) -> None:
    """The new FSM sample decides."""
    stage = Stalled(State.HOLDING)
    stage.fall_silent(10)
    stage.fsm = value
    assert 1.0 not in beats(stage.come_back(3)) and stage.state is State.IDLE


def test_without_a_new_fsm_sample_the_stall_is_not_known_to_be_over() -> None:
    """The old READY does not count; when no sample comes the stall is no longer short."""
    stage = Stalled(State.HOLDING)
    stage.fall_silent(10)
    stage.fsm = None
    assert beats(stage.come_back(20)) == [] and stage.state is State.STALE
    stage.come_back(60)
    assert stage.state is State.IDLE


def test_what_arrives_out_of_a_backlog_is_not_believed() -> None:
    """While no arm's samples are timely READY may be old."""
    stage = Stalled(State.HOLDING)
    stage.fall_silent(10)
    stage.is_deaf = False
    stage.hear()
    stage.coordinator.store.disturb(stage.now_ns + 10 * S)  # nothing is timely from here on
    assert beats(stage.go_on(5)) == [] and stage.state is State.STALE


def test_a_second_stall_ends_1_0_and_the_first_goes_on() -> None:
    """Stale again while seeding: 1.0 ceases, the hold goes on for the rest of the 0.8 s, and it may resume again."""
    stage = Stalled(State.HOLDING)
    stage.fall_silent(10)
    stage.come_back(5)
    stage.is_deaf = True
    again = stage.go_on(25)
    assert not stage.coordinator.resuming and 1.0 not in beats(again[-20:]) and stage.coordinator.stale_hold
    stage.come_back(40)
    assert stage.state is State.HOLDING


def test_an_fsm_that_dies_while_seeding_is_answered_with_0_0() -> None:
    """Our 1.0 is out and nobody can say what it does."""
    stage = Stalled(State.HOLDING)
    stage.fall_silent(10)
    stage.come_back(2)
    stage.dumb, stage.fsm = {R}, None  # the right arm is not heard: seeding takes for ever
    frames = stage.come_back(55)
    assert stage.state is State.IDLE and beats(frames)[-1] == 0.0


def test_an_fsm_that_leaves_ready_while_seeding_is_answered_with_0_0() -> None:
    """Our own 1.0 may have restarted a robot that was paused meanwhile."""
    stage = Stalled(State.HOLDING)
    stage.fall_silent(10)
    stage.come_back(2)
    stage.fsm = SLOW_START
    frames = stage.come_back(3)
    assert stage.state is State.IDLE and 0.0 in beats(frames) and setpoints(frames) == []


def test_arms_that_cannot_be_seeded_are_given_up() -> None:
    """An arm that stays silent: 1.0 does not go on for ever."""
    stage = Stalled(State.HOLDING)
    stage.fall_silent(10)
    stage.dumb = {R}
    stage.come_back(RESUME_NS // TICK_NS - 2)
    assert stage.state is State.STALE
    stage.come_back(10)
    assert stage.state is State.IDLE


@pytest.mark.parametrize("mode_is_known", [True, False])
def test_arms_that_were_disabled_meanwhile_do_not_come_back(mode_is_known: bool) -> None:
    """The others do; while the mode is unknown all of them are seeded."""
    stage = Stalled(State.ACTIVE)
    stage.coordinator.body.arms[R].brake()
    stage.fall_silent(75)
    if mode_is_known:
        stage.mode = replace(MODE, arm_enabled={Side.LEFT: True, R: False})
    else:
        stage.mode = None
        stage.coordinator.store.reset()  # what was known of the mode is too old
    stage.come_back(1)
    stage.coordinator.can_resume = True
    stage.come_back(60)
    assert [side for side in Side if stage.coordinator.body.arms[side].running] == (
        [Side.LEFT] if mode_is_known else list(Side)
    )


# ---------------------------------------------------------------------------------------------------------- the last word


@pytest.mark.parametrize("state", [State.ACTIVE, State.HOLDING])
def test_a_stall_that_outlives_its_time_ends_with_0_0_for_0_3_s(state: State) -> None:
    """Not before it may resume no more; and what is owed stays owed."""
    stage = Stalled(state)
    assert beats(stage.fall_silent(80)) == []
    assert beats(stage.go_on(31)) == [0.0] * 30
    assert beats(stage.go_on(200)) == [] and stage.state is State.STALE and stage.coordinator.body.heartbeat.is_owed


@pytest.mark.parametrize("state", [State.IDLE, State.READ_ONLY])
def test_who_sent_no_1_0_has_no_last_word(state: State) -> None:
    """Nothing of ours is on the way."""
    assert beats(Stalled(state).fall_silent(150)) == []


def test_a_1_0_that_was_answered_by_a_pause_needs_no_last_word() -> None:
    """The FSM's own topic may still be heard."""
    stage = Stalled(State.HOLDING)
    stage.fall_silent(30)
    stage.coordinator.body.heartbeat.fsm_zero_seen(stage.now_ns)
    assert beats(stage.go_on(100)) == []


@pytest.mark.parametrize("says", ["VR", "FSM 3", "nothing of its mode"])
def test_there_is_no_last_word_to_a_robot_that_may_be_somebody_elses(says: str) -> None:
    """A 0.0 would pause the VR operator."""
    stage = Stalled(State.HOLDING)
    stage.fall_silent(10)
    if says == "nothing of its mode":
        stage.coordinator.store.reset()
    else:
        stage.dumb, stage.is_deaf, stage.fsm = set(Side), False, 3 if says == "FSM 3" else None
        stage.mode = None
        if says == "VR":
            stage.say_mode(api=False)
    assert beats(stage.go_on(150)) == []


@pytest.mark.parametrize("is_vr", [False, True])
def test_a_robot_that_is_heard_again_ends_the_last_word_at_once(is_vr: bool) -> None:
    """What it is owed is known when it has said what it does."""
    stage = Stalled(State.HOLDING)
    assert 0.0 in beats(stage.fall_silent(90))
    stage.mode = replace(MODE, api=False) if is_vr else None
    assert beats(stage.come_back(40)) == [] and stage.coordinator.body.heartbeat.is_owed
    stage.mode = replace(MODE, api=not is_vr)
    assert (0.0 in beats(stage.go_on(3))) is not is_vr


def test_a_way_back_that_is_interrupted_late_ends_with_the_last_word() -> None:
    """Its own 1.0 was out a moment before."""
    stage = Stalled(State.HOLDING)
    stage.fall_silent(65)
    assert 1.0 in beats(stage.come_back(8))
    assert beats(stage.fall_silent(60))[-30:] == [0.0] * 30


# ---------------------------------------------------------------------------------------------------------- what is owed


def owing(fsm: int = READY) -> Stalled:
    """A stage in IDLE after a long stall, whose 1.0 was out."""
    stage = Stalled(State.ACTIVE)
    stage.fall_silent(90)
    stage.fsm = fsm
    stage.mode = None
    stage.come_back(5)
    assert stage.state is State.IDLE and stage.coordinator.body.heartbeat.is_owed
    return stage


def test_after_a_loss_0_0_waits_for_a_new_mode_sample() -> None:
    """It might be somebody else's robot by now."""
    stage = owing()
    assert beats(stage.go_on(50)) == []
    stage.mode = MODE
    assert beats(stage.go_on(1)) == [0.0]


def test_after_a_loss_0_0_waits_for_a_new_fsm_sample() -> None:
    """Both must have been heard since."""
    stage = Stalled(State.ACTIVE)
    stage.fall_silent(90)
    stage.fsm = None
    stage.come_back(20)
    assert stage.state is State.IDLE
    stage.fsm = READY
    assert beats(stage.go_on(1)) == [0.0]


@pytest.mark.parametrize("fsm", [PAUSE, ERROR, 3, 7])
def test_0_0_is_sent_only_to_a_robot_that_is_started(fsm: int) -> None:
    """FSM 1-2: else it is not owed to anybody any more, or somebody else's."""
    stage = owing(fsm)
    stage.mode = MODE
    assert beats(stage.go_on(50)) == []


def test_what_is_owed_is_forgotten_when_the_robot_was_seen_to_pause() -> None:
    """An FSM 0 settles it, whoever made it."""
    stage = owing()
    stage.coordinator.body.heartbeat.fsm_zero_seen(stage.now_ns)
    stage.mode = MODE
    assert beats(stage.go_on(50)) == []


def test_what_is_owed_is_paid_after_vr_mode() -> None:
    """API mode again: 0.0 if FSM is 1-2."""
    stage = Stalled(State.ACTIVE)
    stage.say_mode(api=False)
    stage.coordinator.fire(Trigger.VR_MODE, stage.now_ns, "test")
    assert beats(stage.go_on(20)) == []
    stage.mode = MODE
    assert beats(stage.go_on(1)) == [0.0]


@pytest.mark.parametrize(("is_estop", "goes_on"), [(False, False), (True, True)])
@pytest.mark.parametrize("theirs", ["VR", "playback"])
def test_a_repetition_of_0_0_ends_when_somebody_else_drives_but_for_an_estop(
    theirs: str, is_estop: bool, goes_on: bool
) -> None:
    """A 0.0 would pause the VR operator."""
    stage = Stalled(State.IDLE)
    stage.coordinator.body.heartbeat.zeros(stage.now_ns, is_estop=is_estop)
    if theirs == "VR":
        stage.say_mode(api=False)
    else:
        stage.fsm = 5
    assert bool(beats(stage.go_on(20))) is goes_on


# ------------------------------------------------------------------------------------------------------------- e-stop


def estopped(fsm: int) -> Stalled:
    """A stage without transport in which an e-stop was asked for; its 0.0 are over."""
    stage = Stalled(State.OFFLINE)
    stage.coordinator.fire(Trigger.ESTOP, stage.now_ns, str(Estop()))
    stage.is_deaf = True
    stage.go_on(210)
    stage.is_deaf, stage.fsm = False, fsm
    stage.coordinator.transport_up = True
    stage.coordinator.go(State.IDLE, stage.now_ns, "test")
    return stage


@pytest.mark.parametrize(("fsm", "is_sent"), [(READY, True), (SLOW_START, True), (PAUSE, False), (3, False)])
def test_an_estop_that_may_not_have_been_heard_is_sent_again_when_fsm_is_1_or_2(fsm: int, is_sent: bool) -> None:
    """Whatever the mode: it is not waited for."""
    stage = estopped(fsm)
    stage.mode = None
    assert (0.0 in beats(stage.go_on(3))) is is_sent
    assert stage.coordinator.is_estop_unheard is (fsm != PAUSE)


def test_an_estop_is_sent_again_once_for_each_loss() -> None:
    """Not for ever: what did not help is told, and the robot's own stop is at hand."""
    stage = estopped(READY)
    assert 0.0 in beats(stage.go_on(230))
    assert beats(stage.go_on(100)) == []
    stage.fall_silent(5)
    assert 0.0 in beats(stage.come_back(10))


def test_an_estop_waits_for_an_fsm_sample_that_came_since() -> None:
    """What was heard before the loss says nothing."""
    stage = estopped(READY)
    stage.fsm = None
    assert beats(stage.go_on(20)) == []


def test_an_estop_that_was_cleared_is_not_sent_again() -> None:
    """`recover` ends it."""
    stage = estopped(READY)
    stage.coordinator.is_estop_unheard = False
    assert beats(stage.go_on(20)) == []


def test_an_estop_that_is_sent_again_is_one_and_goes_on_beside_somebody_who_drives() -> None:
    """A common 0.0 would end there."""
    stage = estopped(READY)
    assert 0.0 in beats(stage.go_on(3)) and stage.coordinator.body.heartbeat.is_estop
    stage.say_mode(api=False)
    assert 0.0 in beats(stage.go_on(20))


def test_an_estop_that_an_earlier_daemon_latched_is_sent_again() -> None:
    """It may have ended before the robot heard it: a new daemon knows nothing but the latch."""
    stage = Stalled(State.IDLE, latches={Code.ESTOP: "by hand"})
    stage.fsm = READY
    assert 0.0 in beats(stage.go_on(3))
    calm = Stalled(State.IDLE)
    calm.fsm = READY
    assert beats(calm.go_on(3)) == []


# ------------------------------------------------------------------------------------------------------------- others


def send(stage: Stalled) -> None:
    """Somebody else sends setpoints now."""
    stage.coordinator.others.see_data(ForeignData(topic=joint_command(R), zid="b", at_ns=stage.now_ns))


def arm_another(stage: Stalled, *, is_armed: bool = True) -> None:
    """Another gateway commands the robot, or no more."""
    stage.coordinator.others.see_gateways([Gateway(zid="b", is_armed=is_armed)], stage.now_ns)


@pytest.mark.parametrize("who", [send, arm_another])
def test_somebody_else_ends_the_hold_and_the_way_back(who: Callable[[Stalled], None]) -> None:
    """Foreign data or another gateway: no frame more, no resume."""
    stage = Stalled()
    stage.fall_silent(10)
    who(stage)
    assert stage.go_on(1) == [] and not stage.coordinator.stale_hold and not stage.coordinator.can_resume
    assert 1.0 not in beats(stage.come_back(100)) and stage.state is State.IDLE


def test_who_only_announces_commands_ends_no_hold() -> None:
    """As in HOLDING: the grip is kept."""
    stage = Stalled()
    stage.fall_silent(10)
    stage.coordinator.others.see_writers([Writer(topic=FSM_ENABLE, zid="c", means=Means.TOKEN)], stage.now_ns)
    assert setpoints(stage.go_on(10)) and stage.coordinator.stale_hold


def test_a_1_0_of_the_way_back_ends_with_another_gateway() -> None:
    """Still STALE, seeding: it falls silent at once."""
    stage = Stalled()
    stage.fall_silent(20)
    stage.come_back(10)
    assert stage.coordinator.resuming
    arm_another(stage)
    assert beats(stage.go_on(10)) == []


def test_what_is_owed_is_paid_once_beside_foreign_data() -> None:
    """Never a repetition into somebody else's motion."""
    stage = owing()
    send(stage)
    stage.say_mode()
    assert beats(stage.go_on(20)) == [0.0]


def test_what_is_owed_waits_until_the_other_gateway_is_done() -> None:
    """Its robot is not ours to pause; then new samples must say that it is started."""
    stage = owing()
    arm_another(stage)
    stage.say_mode()
    assert beats(stage.go_on(20)) == []
    arm_another(stage, is_armed=False)
    stage.say_mode()
    assert 0.0 in beats(stage.go_on(20))
