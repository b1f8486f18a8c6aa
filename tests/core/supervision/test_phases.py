"""The phases: stopping step by step, stops that nobody hears, where the gateway rests, and the end of the daemon."""

from __future__ import annotations

import pytest

from gateway.core.messages.events import ExitRequested, GuardSeen, PartEnded
from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.supervision.phases import BRAKE_NS, EXIT_BRAKE_NS, EXIT_NS, EXIT_SETTLE_NS, TELL_NS
from gateway.core.supervision.supervisor import State, Trigger
from gateway.errors import Code
from gateway.messages.requests import Stop
from gateway.robot.topics import CHASSIS_VELOCITY, FSM_ENABLE, LIFT_COMMAND
from gateway.values import FsmState
from tests.core.stage import GOAL, MS, TICK_NS, L, Stage

PAUSE, READY = int(FsmState.PAUSE), int(FsmState.READY)


def go_on(stage: Stage, ticks: int) -> list[Frame]:
    """Let time pass with a step of the phases in every tick, before the streams; return what left."""
    left: list[Frame] = []
    for _ in range(ticks):
        stage.now_ns += TICK_NS
        stage.hear()
        if stage.fsm == PAUSE:
            stage.coordinator.body.heartbeat.fsm_zero_seen(stage.now_ns)
        stage.phases.step(stage.now_ns)
        frames = [stream.frame(stage.now_ns) for stream in stage.coordinator.body.streams if stream.running]
        left += [frame for frame in frames if frame is not None]
    return left


def beats(frames: list[Frame]) -> list[float]:
    """The heartbeats among frames."""
    return [frame.values[0] for frame in frames if frame.topic == FSM_ENABLE]


def moving(stage: Stage) -> Stage:
    """Put the left arm in motion."""
    stage.coordinator.body.arms[L].follow_target(GOAL[L], 1.0, stage.epoch)
    stage.run(20)
    return stage


def ending(stage: Stage) -> Stage:
    """Ask the daemon to end."""
    stage.phases.end(ExitRequested(at_ns=stage.now_ns), stage.now_ns)
    return stage


def ticks_until_done(stage: Stage) -> int:
    """Let time pass until everything was sent; return how many ticks that took."""
    for tick in range(600):
        if stage.phases.is_done(stage.now_ns):
            return tick
        go_on(stage, 1)
    raise AssertionError("never done")


# ----------------------------------------------------------------------------------------------------------- stopping


def test_stopping_brakes_under_1_0_and_sends_0_0_at_rest() -> None:
    """Not before: the robot would stop the arms at once."""
    stage = moving(Stage(State.ACTIVE))
    stage.coordinator.fire(Trigger.DISABLE, stage.now_ns)
    while not stage.coordinator.body.is_at_rest:
        left = go_on(stage, 1)
        assert set(beats(left)) <= {1.0} and FrameKind.MOTION not in {frame.kind for frame in left}
    assert beats(go_on(stage, 2))[-1] == 0.0 and stage.state is State.STOPPING


def test_stopping_ends_at_the_base_when_0_0_was_not_heard() -> None:
    """After 2 s, with a word about it: STOP_NOT_EFFECTIVE, once, with what the FSM says."""
    stage = Stage(State.ACTIVE)
    stage.coordinator.fire(Trigger.DISABLE, stage.now_ns)
    go_on(stage, 199)
    assert stage.state is State.STOPPING and not stage.told(Code.STOP_NOT_EFFECTIVE)
    go_on(stage, 20)
    assert stage.state is State.IDLE
    (message,) = stage.told(Code.STOP_NOT_EFFECTIVE)
    assert "READY" in message and "physical emergency stop" in message


@pytest.mark.parametrize(("fsm", "says"), [(None, "unknown"), (17, "17")])
def test_a_stop_that_nobody_hears_is_told_with_what_is_known(fsm: int | None, says: str) -> None:
    """Also of an FSM that is silent, or says what nobody knows."""
    stage = Stage(State.HOLDING)
    stage.fsm = fsm
    stage.run(60)
    stage.coordinator.fire(Trigger.ESTOP, stage.now_ns)
    go_on(stage, 230)
    (message,) = stage.told(Code.STOP_NOT_EFFECTIVE)
    assert f"its FSM is {says}" in message


def test_every_stop_that_nobody_hears_is_told() -> None:
    """One word for each, not for each tick."""
    stage = Stage(State.HOLDING)
    for number in (1, 2):
        stage.coordinator.fire(Trigger.ESTOP, stage.now_ns)
        go_on(stage, 230)
        assert len(stage.told(Code.STOP_NOT_EFFECTIVE)) == number


# --------------------------------------------------------------------------------------------------------------- rest


def test_the_base_follows_what_the_robot_and_the_lease_are() -> None:
    """OFFLINE, READ_ONLY and IDLE need no event: they are looked at."""
    stage = Stage(State.IDLE)
    go_on(stage, 1)
    assert stage.state is State.IDLE
    stage.coordinator.lease.clear(stage.now_ns)
    go_on(stage, 1)
    assert stage.state is State.READ_ONLY
    stage.coordinator.transport_up = False
    go_on(stage, 1)
    assert stage.state is State.OFFLINE
    stage.coordinator.transport_up = True
    go_on(stage, 1)
    assert stage.state is State.READ_ONLY


def test_an_enabling_takes_its_steps() -> None:
    """The phases step it: 1.0 follows the echoes."""
    stage = Stage(State.ENABLING)
    assert 1.0 in beats(go_on(stage, 6))


# ------------------------------------------------------------------------------------------------------------- the end


def test_nobody_is_done_who_was_not_asked_to_end() -> None:
    """However quiet it is."""
    stage = Stage(State.IDLE)
    assert not stage.phases.is_done(stage.now_ns + 100 * EXIT_NS)


def test_a_quiet_daemon_ends_when_its_frames_have_left() -> None:
    """50 ms for what was handed over for sending."""
    stage = ending(Stage(State.IDLE))
    assert ticks_until_done(stage) == EXIT_SETTLE_NS // TICK_NS and stage.coordinator.is_exiting


def test_a_second_wish_to_end_changes_nothing() -> None:
    """The first one counts: the end does not move away."""
    stage = ending(Stage(State.HOLDING))
    for _ in range(3):
        go_on(stage, 100)
        ending(stage)
    assert 300 + ticks_until_done(stage) <= EXIT_NS // TICK_NS + 1


def test_the_end_waits_for_brake_and_0_0() -> None:
    """ACTIVE: brake, 0.0 until FSM 0, then done."""
    stage = ending(moving(Stage(State.ACTIVE)))
    while stage.state is State.STOPPING:
        assert not stage.phases.is_done(stage.now_ns)
        if beats(go_on(stage, 1)) == [0.0]:
            stage.fsm = PAUSE
            stage.coordinator.fire(Trigger.FSM_PAUSE, stage.now_ns, "0.0 was heard")
    assert stage.state is State.IDLE and ticks_until_done(stage) <= 25


def test_the_end_comes_in_time_when_0_0_is_not_heard() -> None:
    """At the latest 4.5 s after it was asked for."""
    stage = ending(Stage(State.HOLDING))
    assert ticks_until_done(stage) * TICK_NS <= EXIT_NS + TICK_NS


def test_arms_that_brake_for_too_long_brake_on_under_0_0() -> None:
    """0.0 needs 2 s when it is not heard: it must begin in time."""
    stage = moving(Stage(State.ACTIVE))
    ending(stage)
    asked_ns = stage.now_ns
    first_ns = None
    for _ in range(300):
        stage.coordinator.body.arms[L].follow_target(GOAL[L], 0.05, stage.epoch)  # as if the brakes were slow
        if 0.0 in beats(go_on(stage, 1)):
            first_ns = stage.now_ns
            break
    assert first_ns is not None and EXIT_BRAKE_NS < first_ns - asked_ns <= EXIT_BRAKE_NS + 2 * TICK_NS


@pytest.mark.parametrize("model", ["standard", "lift"])
def test_the_end_waits_for_the_stop_frames_of_chassis_and_lift(model: str) -> None:
    """A second of zeros; the lift's [0,0] after its [0,1]."""
    stage = Stage(State.IDLE, model=model)
    stage.coordinator.fire(Trigger.OWNER_STOP, stage.now_ns, str(Stop()))
    ending(stage)
    left = []
    while not stage.phases.is_done(stage.now_ns):
        left += go_on(stage, 1)
    topics = {frame.topic for frame in left}
    assert topics == ({CHASSIS_VELOCITY, LIFT_COMMAND} if model == "lift" else {CHASSIS_VELOCITY})
    if model == "lift":
        assert [frame.values for frame in left if frame.topic == LIFT_COMMAND][-1] == (0.0, 0.0)


def test_an_estop_while_the_end_settles_puts_it_off() -> None:
    """Stops work to the last: what they send is waited for."""
    stage = ending(Stage(State.IDLE))
    go_on(stage, 3)
    stage.phases.is_done(stage.now_ns)
    stage.coordinator.fire(Trigger.ESTOP, stage.now_ns)
    assert not stage.phases.is_done(stage.now_ns)
    stage.fsm = PAUSE
    assert ticks_until_done(stage) * TICK_NS >= 1000 * MS


def test_the_reference_of_a_paused_robot_goes_where_its_arm_goes() -> None:
    """In every state with setpoints, on every tick."""
    for state in (State.PAUSED, State.ENABLING):
        stage = Stage(state)
        stage.fsm = PAUSE
        go_on(stage, 1)
        stage.push(L, 0.05)
        go_on(stage, 1)
        assert stage.coordinator.body.arms[L].values == stage.q_rad[L]
    stage = Stage(State.PAUSED)
    stage.push(L, 0.05)
    go_on(stage, 1)
    assert stage.coordinator.body.arms[L].values != stage.q_rad[L], "this one says READY"


@pytest.mark.parametrize("is_heard", [True, False])
def test_a_motion_that_has_become_a_hold_gives_way_to_an_arm_that_was_heard_all_the_time(is_heard: bool) -> None:
    """Once: the reference walks to where the arm is."""
    stage = Stage(State.ACTIVE)
    stage.push(L, 0.5)
    stage.run(20)
    stage.coordinator.fire(Trigger.CLIENT_LOST, stage.now_ns)
    if not is_heard:
        stage.now_ns += 200 * MS
        stage.phases.step(stage.now_ns)
    left = go_on(stage, 300)
    assert bool(stage.told(Code.WALK)) is is_heard is (FrameKind.WALK in {frame.kind for frame in left})
    assert not stage.coordinator.body.gives_way


# ------------------------------------------------------------------------------------------------------ a part ended


def broken(stage: Stage, *, is_guarded: bool = True) -> Stage:
    """Lose a thread of the daemon, with a guard that has been linked for long or without one."""
    if is_guarded:
        stage.coordinator.guard.see(GuardSeen(pid=41, zid="c4", is_linked=True, at_ns=0))
    lost = PartEnded(message="the thread x ended", trace="Traceback", at_ns=stage.now_ns)
    stage.phases.end(lost, stage.now_ns)
    assert stage.phases.is_broken and stage.coordinator.is_exiting
    return stage


def test_a_part_that_ends_is_told_latched_and_answered_as_a_stop() -> None:
    """With its trace, where it has one."""
    stage = broken(moving(Stage(State.ACTIVE)))
    assert stage.state is State.HOLDING
    assert stage.coordinator.supervisor.latches == {Code.GATEWAY_BROKEN: "the thread x ended"}
    (notice,) = [notice for notice in stage.coordinator.notices if notice.code is Code.GATEWAY_BROKEN]
    assert dict(notice.facts) == {"trace": "Traceback"}
    stage.phases.end(PartEnded(message="another", at_ns=stage.now_ns), stage.now_ns)
    assert dict(stage.coordinator.notices[-1].facts) == {}


def test_a_hold_is_left_to_the_guard_at_rest() -> None:
    """Not before, and never with 0.0; who looks has been told by then."""
    stage = broken(moving(Stage(State.ACTIVE)))
    began_ns = stage.now_ns
    while not stage.phases.is_done(stage.now_ns):
        assert set(beats(go_on(stage, 1))) <= {1.0}
    assert stage.coordinator.body.is_at_rest and stage.state is State.HOLDING
    assert stage.now_ns - began_ns >= TELL_NS


def test_what_no_guard_could_hold_ends_in_order() -> None:
    """Without a guard, and where nothing is held."""
    for stage in (broken(Stage(State.HOLDING), is_guarded=False), broken(Stage(State.IDLE))):
        left = []
        while not stage.phases.is_done(stage.now_ns):
            left += go_on(stage, 1)
        assert stage.state is State.IDLE and set(beats(left)[-1:]) <= {0.0}
    assert not Stage(State.IDLE).phases.is_broken


def test_a_hold_that_a_short_stall_interrupts_is_waited_for() -> None:
    """For as long as it may go on; then the end comes in order."""
    stage = broken(Stage(State.HOLDING))
    stage.coordinator.fire(Trigger.STALE, stage.now_ns)
    for wait_ns, is_waiting in ((TELL_NS, True), (BRAKE_NS, False)):
        stage.now_ns += wait_ns
        stage.phases.step(stage.now_ns)
        assert not stage.phases.is_done(stage.now_ns)
        assert stage.coordinator.can_resume == is_waiting
    assert ticks_until_done(stage) > 0


@pytest.mark.parametrize("how", ["guarded", "unguarded"])
def test_what_still_moves_when_its_time_is_over_is_left_or_ends(how: str) -> None:
    """A brake that does not end is the guard's to go on with; nobody waits for ever."""
    stage = broken(moving(Stage(State.ACTIVE)), is_guarded=how == "guarded")
    stage.now_ns += BRAKE_NS + TICK_NS
    stage.hear()
    assert stage.coordinator.state is State.HOLDING and not stage.coordinator.body.is_at_rest
    stage.phases.step(stage.now_ns)
    assert stage.phases.is_done(stage.now_ns) is (how == "guarded")


def test_a_hold_at_rest_is_kept_until_who_looks_has_been_told() -> None:
    """So long, and no longer."""
    stage = broken(Stage(State.HOLDING))
    assert stage.coordinator.body.is_at_rest
    for wait_ns, is_left in ((TELL_NS - 1, False), (1, True)):
        stage.now_ns += wait_ns
        stage.phases.step(stage.now_ns)
        assert stage.phases.is_done(stage.now_ns) is is_left
