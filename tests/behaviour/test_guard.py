"""BEHAVIOUR, the guard: what happens when the daemon is dead, in each of its states, and while the guard holds."""

from __future__ import annotations

from itertools import pairwise

import pytest

from gateway.core.guardian import Phase
from gateway.core.messages.events import CommandRequested, GuardSeen, TakenOver
from gateway.core.messages.outputs import FrameKind, Reply
from gateway.errors import Code
from gateway.messages.requests import Acquire, Enable, Estop, MovePose, Release, SetGripper, Stop
from gateway.robot.topics import FSM_ENABLE, STATE_TOPICS, gripper_command, joint_command, pose_command, shoulder_frame
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side
from tests.behaviour.scene import HOME, LEAN
from tests.core.pose_judge import LIMITS as POSE_LIMITS
from tests.core.pose_judge import judge
from tests.guarded import Guarded
from tests.invariants import Monitor
from tests.pair import MS, S

ARMS = tuple(map(joint_command, Side))


def scene() -> tuple[Guarded, Monitor]:
    """A daemon with a guard and a robot that both hear; every tick is judged."""
    pair = Guarded()
    pair.topics = LEAN
    return pair, Monitor(pair)


def in_motion() -> tuple[Guarded, int]:
    """Both arms in the middle of a motion, and the epoch."""
    pair, _ = scene()
    epoch = pair.activate()
    pair.move(epoch, HOME)
    pair.run(0.5)
    return pair, epoch


def in_state(state: str) -> Guarded:
    """A daemon in this state."""
    if state in {"ACTIVE", "HOLDING", "PAUSED", "STOPPING", "STALE", "OFFLINE"}:
        pair, epoch = in_motion()
        if state == "HOLDING":
            pair.kill()
        elif state == "PAUSED":
            pair.robot.inject({"fault": "pause"}, pair.now_ns)
        elif state == "STOPPING":
            pair.granted(Release(epoch=epoch))
        elif state == "STALE":
            pair.freeze()
        elif state == "OFFLINE":
            pair.down()
    else:
        pair, _ = scene()
        pair.run_until(lambda: pair.state == "READ_ONLY")
        pair.run_until(lambda: pair.knows_mode)
        if state != "READ_ONLY":
            epoch = pair.own()
            if state == "ENABLING":
                pair.granted(Enable(epoch=epoch))
                pair.run_until(lambda: bool(pair.sent_on(FSM_ENABLE)))
    pair.run_until(lambda: pair.state == state, 1.0)
    return pair


def beats(pair: Guarded, since_ns: int) -> set[float]:
    """What was said on the heartbeat's topic."""
    return {frame.values[0] for _, frame in pair.sent_on(FSM_ENABLE, since_ns)}


def to_its_end(pair: Guarded) -> None:
    """Until the guard has ended."""
    pair.run_until(lambda: pair.guardian.phase is Phase.DONE, 15.0)


# ------------------------------------------------------------------------------------------- the daemon is dead


@pytest.mark.parametrize("state", ["READ_ONLY", "IDLE"])
def test_a_daemon_that_had_nothing_out_leaves_nothing_to_do(state):
    """No frame of any kind."""
    pair = in_state(state)
    sent = pair.sent
    pair.die()
    pair.run(0.5)
    assert (pair.guardian.phase, pair.sent) == (Phase.DONE, sent)


@pytest.mark.parametrize("state", ["ACTIVE", "HOLDING"])
def test_a_dead_daemons_arms_are_braked_and_held_for_10_s(state):
    """One smooth motion across the change; 1.0 goes on; then 0.0, and the robot pauses."""
    pair = in_state(state)
    died_ns = pair.now_ns
    pair.die()
    pair.run(9.5)
    assert (pair.state, beats(pair, died_ns)) == ("HOLDING", {1.0})
    for topic in ARMS:
        times = [at_ns for at_ns, _ in pair.sent_on(topic, died_ns - 100 * MS)]
        assert max(b - a for a, b in pairwise(times)) < 50 * MS
    kinds = {frame.kind for _, frame in pair.sent_on(ARMS[0], died_ns + 1)}
    assert kinds == {FrameKind.BRAKE, FrameKind.HOLD}
    to_its_end(pair)
    assert 0.0 in beats(pair, died_ns)
    assert pair.robot.fsm.published == 0


@pytest.mark.parametrize("state", ["ENABLING", "PAUSED"])
def test_a_dead_daemon_that_held_nothing_is_followed_by_0_0(state):
    """Nothing moves."""
    pair = in_state(state)
    died_ns = pair.now_ns
    pair.die()
    to_its_end(pair)
    assert beats(pair, died_ns + 1) <= {0.0}
    assert not any(pair.sent_on(topic, died_ns + 1) for topic in ARMS)
    assert pair.robot.fsm.published == 0


def test_a_daemon_that_dies_while_it_stops_is_braked_and_paused():
    """As it would have done itself."""
    pair = in_state("STOPPING")
    died_ns = pair.now_ns
    pair.die()
    assert pair.state == "STOPPING"
    to_its_end(pair)
    assert pair.now_ns - died_ns < 4 * S
    assert FrameKind.BRAKE in {frame.kind for _, frame in pair.sent_on(ARMS[0], died_ns + 1)}
    assert pair.robot.fsm.published == 0


@pytest.mark.parametrize("state", ["STALE", "OFFLINE"])
def test_a_daemon_that_dies_while_the_robot_is_not_heard_is_followed_by_0_0(state):
    """No setpoint leaves; what cannot be delivered is not held either."""
    pair = in_state(state)
    died_ns = pair.now_ns
    pair.die()
    to_its_end(pair)
    assert not any(pair.sent_on(topic, died_ns + 1) for topic in ARMS)
    assert beats(pair, died_ns) == {0.0}


def test_a_last_frame_of_150_ms_ago_is_not_gone_on_with():
    """The robot has stopped the arms by itself; 0.0 follows."""
    pair, _ = in_motion()
    died_ns = pair.now_ns
    pair.on_step = None  # the gap is what this is about
    pair.die(seen_after_ms=150.0)
    assert not pair.guardian.is_holding
    to_its_end(pair)
    assert not any(pair.sent_on(topic, died_ns + 1) for topic in ARMS)


@pytest.mark.parametrize("is_clean", [True, False])
def test_a_daemon_that_ends_as_asked_moves_nothing(is_clean):
    """After a clean end there is nothing on the wire; whether it said goodbye makes no difference."""
    pair, epoch = in_motion()
    pair.granted(Release(epoch=epoch))
    pair.run_until(lambda: pair.state == "READ_ONLY")
    pair.run_until(lambda: pair.shown is not None and pair.shown.is_silent)
    sent = pair.sent
    pair.die(is_clean=is_clean)
    pair.run(0.5)
    assert (pair.guardian.phase, pair.sent) == (Phase.DONE, sent)


def test_ticks_missing_for_80_ms_are_a_freeze_and_the_hold_goes_on():
    """The arms' gap stays below 100 ms."""
    pair, _ = in_motion()
    assert pair.freeze_daemon() <= 81.0
    pair.run(1.0)
    assert pair.state == "HOLDING"
    times = [at_ns for at_ns, _ in pair.sent_on(ARMS[1])]
    assert max(b - a for a, b in pairwise(times)) < 100 * MS


# ------------------------------------------------------------------------------------------- while it holds


@pytest.mark.parametrize(
    "fault", [{"fault": "vr_mode"}, {"fault": "fsm_value", "value": 3}, {"fault": "fsm_value", "value": 9}]
)
def test_a_holding_guard_is_silent_in_vr_mode_and_beside_another_fsm(fault):
    """Neither setpoints nor 1.0 nor 0.0: somebody else drives."""
    pair, _ = in_motion()
    pair.die()
    pair.run(1.0)
    pair.robot.inject(fault, pair.now_ns)
    pair.run(1.2)  # the mode comes once a second
    silent_ns = pair.now_ns
    pair.run(1.0)
    assert not any(pair.sent_on(topic, silent_ns) for topic in (*ARMS, FSM_ENABLE))


def test_a_holding_guard_answers_a_pause_with_0_0():
    """Somebody may have pressed the physical stop: no 1.0 restarts the robot."""
    pair, _ = in_motion()
    pair.die()
    pair.run(1.0)
    pair.robot.inject({"fault": "pause"}, pair.now_ns)
    pair.run(0.2)
    paused_ns = pair.now_ns
    to_its_end(pair)
    assert beats(pair, paused_ns) <= {0.0}


def test_a_holding_guard_does_not_wait_out_a_stall():
    """0.0, and no hold afterwards."""
    pair, _ = in_motion()
    pair.die()
    pair.run(1.0)
    pair.is_deaf = True
    pair.run(0.15)
    deaf_ns = pair.now_ns
    pair.run(0.2)
    pair.is_deaf = False
    to_its_end(pair)
    assert beats(pair, deaf_ns) == {0.0}
    assert not any(pair.sent_on(topic, deaf_ns) for topic in ARMS)


def test_the_last_word_of_a_guard_whose_robot_falls_silent_is_0_0():
    """And of one that finds its daemon dead in a long stall, whether that had its last word or not."""
    for stall_s in (0.0, 0.6, 1.0):
        pair, _ = in_motion()
        if stall_s:
            pair.is_deaf = True
            pair.run(stall_s)
            assert pair.state == "STALE"
        died_ns = pair.now_ns
        pair.die()
        pair.run(0.2)
        pair.is_deaf = True
        to_its_end(pair)
        said = [(at_ns, frame.values[0]) for at_ns, frame in pair.sent_on(FSM_ENABLE, died_ns)]
        zeros_ns = [at_ns for at_ns, value in said if value == 0.0]
        assert [value for _, value in said] == sorted((value for _, value in said), reverse=True)
        assert zeros_ns[-1] - zeros_ns[0] >= 300 * MS


@pytest.mark.parametrize("is_estop", [False, True])
def test_stop_and_estop_work_while_the_daemon_is_dead(is_estop):
    """A stop brakes and keeps the grip; an e-stop pauses the robot at once."""
    pair, _ = in_motion()
    pair.die()
    reply = pair.ask(Estop() if is_estop else Stop(), "person")
    assert reply.refusal is None and reply.facts["stop_undelivered"] is False
    pair.run(0.5)
    assert (pair.state == "HOLDING") is not is_estop
    assert set(pair.engine.latches) == {Code.ESTOP if is_estop else Code.STOPPED_BY_OTHER}
    to_its_end(pair)
    assert pair.robot.fsm.published == 0


# ------------------------------------------------------------------------------------------- afterwards


def test_a_restarted_daemon_takes_the_hold_over_as_unowned_with_the_60_s_anew():
    """No step, no gap; whoever acquires it may go on."""
    pair, _ = in_motion()
    pair.die()
    pair.run(1.0)
    pair.restart_guarded()
    pair.run(0.1)
    lease = pair.see().lease
    assert (pair.state, lease.owned) == ("HOLDING", False)
    assert lease.down_in_ns is not None and lease.down_in_ns > 59 * S
    times = [at_ns for at_ns, _ in pair.sent_on(ARMS[0])]
    assert max(b - a for a, b in pairwise(times)) < 100 * MS
    epoch = pair.own("ann")
    pair.move(epoch, {Side.LEFT: HOME[Side.LEFT]}, "ann")
    pair.run_until(lambda: pair.see().motions[-1].state == "reached")


def test_a_restarted_daemon_enables_nothing_while_the_guard_holds():
    """Two would command the robot."""
    pair, _ = in_motion()
    pair.die()
    new = pair.start_daemon()
    frames = []
    while new.takeover.objection(pair.now_ns):
        pair.step()
        frames += new.tick(pair.now_ns).frames

    def ask(number: int, request: Acquire | Enable) -> Reply:
        new.receive(
            CommandRequested(client_id="ann", request_id=number, request=request, received_ns=pair.now_ns), pair.now_ns
        )
        output = new.tick(pair.now_ns)
        frames.extend(output.frames)
        return output.replies[0]

    epoch = ask(1, Acquire(name="ann", pid=1)).facts["epoch"]
    assert isinstance(epoch, int)
    refusal = ask(2, Enable(epoch=epoch)).refusal
    assert refusal is not None and refusal.code is Code.HELD_BY_GUARD
    assert frames == []


def test_an_estop_between_the_question_for_a_hold_and_its_answer_ends_it():
    """The next daemon latches and sends 0.0; what the guard has given by then does not bring 1.0 back."""
    pair, _ = in_motion()
    pair.die()
    pair.run(1.0)
    new = pair.start_daemon()
    while new.takeover.objection(pair.now_ns):
        pair.step()
        new.tick(pair.now_ns)
    held = pair.guardian.hand_over(pair.now_ns)
    assert held is not None
    pair.engine, pair.listeners, asked_ns = new, [], pair.now_ns + 1
    pair.granted(Estop(), "person")
    pair.receive(TakenOver(held=held, at_ns=pair.now_ns))
    pair.run(3.0)
    assert beats(pair, asked_ns) == {0.0} and not pair.sent_on(ARMS[0], asked_ns)
    assert pair.state == "READ_ONLY" and pair.robot.fsm.published == 0 and Code.ESTOP in pair.engine.latches


def test_a_hold_taken_over_while_a_lost_owner_has_the_lease_ends_after_60_s():
    """He came while the guard held, and vanished: no clock of his ran, for nothing was held by his daemon."""
    pair, _ = in_motion()
    pair.die()
    daemon, new = pair.engine, pair.start_daemon()
    while new.takeover.objection(pair.now_ns):
        pair.step()
        new.tick(pair.now_ns)
    pair.engine, pair.listeners = new, [daemon]
    pair.own("ann")
    pair.kill("ann")
    pair.step()
    held = pair.guardian.hand_over(pair.now_ns)
    assert held is not None
    pair.receive(TakenOver(held=held, at_ns=pair.now_ns))
    pair.run(59.0)
    assert (pair.state, pair.engine.owner_id) == ("HOLDING", None)
    pair.run(2.0)
    assert pair.state == "READ_ONLY" and pair.robot.fsm.published == 0


def test_a_lost_guard_is_told_and_control_goes_on():
    """Another one is started by the daemon; the motion does not notice."""
    pair, _ = in_motion()
    pair.receive(GuardSeen(pid=0, zid="", is_linked=False, at_ns=pair.now_ns, lost="signal 9"))
    pair.run_until(lambda: pair.see().motions[-1].state == "reached")
    assert Code.GUARD_LOST in pair.codes()
    assert pair.state == "ACTIVE"


@pytest.mark.parametrize("is_frozen", [False, True])
def test_an_arm_in_end_effector_mode_is_braked_held_and_handed_over_like_the_other(is_frozen):
    """Position and orientation go on from their last setpoint, inside their limits, across both changes; the grip stays."""
    side, topic = Side.RIGHT, pose_command(Side.RIGHT)
    pair = Guarded(sim=SimSettings(state_period_ns=10 * MS, right_mode="pose"))
    pair.topics = STATE_TOPICS
    epoch = pair.activate()
    pair.run(0.2)
    pair.granted(SetGripper(epoch=epoch, side=side, raw=0.8))
    x_m, y_m, z_m, *quat = pair.sent_on(topic)[-1][1].values
    targets = {side: (x_m, y_m + 0.05, z_m + 0.05, *quat)}
    pair.granted(MovePose(epoch=epoch, targets=targets, frames={side: shoulder_frame(side)}))
    pair.run(0.4)
    died_ns = pair.now_ns
    if is_frozen:
        pair.freeze_daemon()
    else:
        pair.die()
    assert pair.guardian.is_holding, pair.engine.takeover.refused
    pair.run(2.0)
    pair.restart_guarded()
    pair.run(1.0)
    assert pair.state == "HOLDING"
    frames = pair.sent_on(topic)
    judge([frame.values for _, frame in frames], POSE_LIMITS)
    assert max(b - a for (a, _), (b, _) in pairwise(frames)) < 100 * MS
    assert {frame.kind for at_ns, frame in frames if at_ns > died_ns} == {FrameKind.BRAKE, FrameKind.HOLD}
    assert {frame.values for _, frame in pair.sent_on(gripper_command(side), died_ns)} == {(0.8,)}
    assert Code.GATE_VIOLATION not in pair.engine.latches
