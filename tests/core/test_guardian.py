"""The guard's mind: what it takes for a freeze, when it acts, how long, and how it hands over."""

from __future__ import annotations

from itertools import pairwise

import pytest

from gateway.core.guardian import HANDED_NS, Guardian, Phase
from gateway.core.messages.events import Suspended
from gateway.core.messages.held import Held
from gateway.core.messages.outputs import FrameKind
from gateway.core.supervision.supervisor import State
from gateway.messages.requests import Enable, Estop
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import CURRENT_MODE, FSM_ENABLE, FSM_STATE, arm_state, joint_command
from gateway.settings.settings import Settings
from gateway.values import Side
from tests.guarded import Guarded
from tests.invariants import Monitor
from tests.pair import MS, START_NS, S

LEAN = (*map(arm_state, Side), FSM_STATE, CURRENT_MODE)
ARMED = Held(at_ns=START_NS, state="HOLDING", beat="one")


def moving(seconds: float = 0.5) -> Guarded:
    """Both arms in motion, so long after its begin."""
    pair = Guarded()
    pair.topics = LEAN
    Monitor(pair)
    epoch = pair.activate()
    pair.move(epoch, HOME_Q_RAD)
    pair.run(seconds)
    return pair


# ------------------------------------------------------------------------------------------------ watching


@pytest.mark.parametrize(
    ("held", "is_clean"), [(None, False), (Held(at_ns=START_NS, state="IDLE"), False), (ARMED, True)]
)
def test_a_daemon_that_ended_by_itself_or_had_nothing_out_has_no_successor(held, is_clean):
    """A normal end, and a crash at the start, move nothing."""
    guard = Guardian(Settings())
    guard.daemon_ended(held, START_NS, is_clean=is_clean)
    assert guard.phase is Phase.DONE
    assert guard.left_ns(START_NS) == 0
    guard.end(START_NS)
    assert guard.tick(START_NS + 10 * MS).frames == ()


# ------------------------------------------------------------------------------------------------ acting


def test_it_brakes_and_holds_for_10_s_then_everything_goes_down():
    """The robot is left in PAUSE, and the guard ends."""
    pair = moving()
    begun_ns = pair.now_ns
    pair.die()
    assert pair.guardian.is_holding
    assert pair.guardian.left_ns(pair.now_ns) == 10 * S
    pair.run(9.9)
    assert (pair.state, pair.robot.fsm.published) == ("HOLDING", 2)
    assert {frame.kind for _, frame in pair.sent_on(joint_command(Side.LEFT), pair.now_ns - S)} == {FrameKind.HOLD}
    pair.run_until(lambda: pair.guardian.phase is Phase.DONE, 4.0)
    assert pair.now_ns - begun_ns < 14 * S
    assert pair.robot.fsm.published == 0


def test_a_frozen_daemon_is_found_out_within_80_ms():
    """And held for like a dead one."""
    pair = moving()
    assert pair.freeze_daemon() <= 81.0
    assert pair.guardian.is_holding
    pair.run(2.0)
    assert pair.state == "HOLDING"


def test_a_daemon_that_was_only_owing_gets_its_0_0_paid():
    """ENABLING is not held: the echo ends, 0.0 leaves, and that is all."""
    pair = Guarded()
    pair.topics = LEAN
    Monitor(pair)
    pair.run_until(lambda: pair.state == "READ_ONLY")
    pair.run_until(lambda: pair.knows_mode)
    epoch = pair.own()
    pair.granted(Enable(epoch=epoch))
    pair.run_until(lambda: bool(pair.sent_on(FSM_ENABLE)))
    pair.die()
    assert not pair.guardian.is_holding
    died_ns = pair.now_ns
    pair.run_until(lambda: pair.guardian.phase is Phase.DONE, 4.0)
    assert pair.sent_on(joint_command(Side.LEFT), died_ns) == []
    assert {frame.values for _, frame in pair.sent_on(FSM_ENABLE, died_ns)} == {(0.0,)}


def test_a_guard_that_is_asked_to_end_brakes_and_pauses_the_robot():
    """As a daemon does at SIGTERM; asked twice it does it once."""
    pair = moving()
    pair.die()
    pair.run(0.1)
    for _ in range(2):
        pair.guardian.end(pair.now_ns)
    assert not pair.guardian.is_holding
    pair.run_until(lambda: pair.guardian.phase is Phase.DONE, 5.0)
    assert pair.robot.fsm.published == 0


# ------------------------------------------------------------------------------------------------ too late


def without_gaps(pair: Guarded) -> Guarded:
    """Nobody judges the gap: it is what the test is about."""
    pair.on_step = None
    return pair


def test_a_daemon_that_has_been_dead_for_a_second_leaves_nothing_to_do():
    """The robot has paused by itself: who commands it now is somebody else, and no 0.0 or zeros of ours pause him."""
    pair = without_gaps(moving())
    before = pair.sent
    pair.die(seen_after_ms=1000.0)
    assert "own watchdogs have ended it" in pair.engine.tick(pair.now_ns).notices[-1].message
    pair.run_until(lambda: pair.guardian.phase is Phase.DONE, 4.0)
    assert pair.sent == before


def test_a_daemon_that_has_been_dead_for_less_is_ended_with_0_0():
    """Not yet a second: the robot still waits for its heartbeat."""
    pair = without_gaps(moving())
    died_ns = pair.now_ns
    pair.die(seen_after_ms=900.0)
    pair.run_until(lambda: pair.guardian.phase is Phase.DONE, 4.0)
    assert {frame.values for _, frame in pair.sent_on(FSM_ENABLE, died_ns + 1)} == {(0.0,)}


def test_an_e_stop_is_passed_on_however_late():
    """A person wanted the robot to stand still; the next daemon would say it again as well."""
    pair = without_gaps(moving())
    pair.ask(Estop(), "person")
    stopped_ns = pair.now_ns
    assert pair.shown is not None and pair.shown.is_estop
    pair.die(seen_after_ms=1500.0)
    pair.run_until(lambda: pair.guardian.phase is Phase.DONE, 4.0)
    assert pair.sent_on(FSM_ENABLE, stopped_ns + S)


@pytest.mark.parametrize("is_asleep", [False, True], ids=["stopped", "asleep"])
def test_a_guard_that_stood_still_for_a_second_sends_nothing_any_more(is_asleep):
    """Stopped and continued, or the host slept: neither 1.0 nor 0.0 nor a setpoint meets the robot's next commander."""
    pair = without_gaps(moving())
    pair.die()
    pair.run(1.0)
    before = pair.sent
    if is_asleep:
        pair.guardian.receive(Suspended(slept_ns=S, at_ns=pair.now_ns), pair.now_ns)
    else:
        pair.now_ns += S
    pair.step()
    assert (pair.guardian.phase, pair.sent) == (Phase.DONE, before)
    assert "stood still" in pair.guardian.given_up


def test_a_guard_that_stood_still_for_a_moment_goes_on():
    """Less than what ends a hold by itself is an ordinary late tick."""
    pair = without_gaps(moving())
    pair.die()
    pair.run(1.0)
    pair.now_ns += 60 * MS
    pair.run(0.5)
    assert (pair.guardian.is_holding, pair.guardian.given_up) == (True, "")


def test_a_daemon_that_died_before_the_host_slept_leaves_nothing_to_do():
    """The monotonic clock stood still with it: its last setpoint only looks young."""
    pair = without_gaps(moving())
    before = pair.sent
    pair.guardian.receive(Suspended(slept_ns=60 * S, at_ns=pair.now_ns), pair.now_ns)
    pair.die()
    pair.run_until(lambda: pair.guardian.phase is Phase.DONE, 4.0)
    assert pair.sent == before


# ------------------------------------------------------------------------------------------------ handing over


def test_a_restarted_daemon_takes_the_hold_over_without_a_step():
    """The monitor judges every setpoint across both changes; the gap is one tick."""
    pair = moving()
    pair.die()
    pair.run(0.1)
    pair.restart_guarded()
    assert (pair.state, pair.engine.owner_id) == ("HOLDING", None)
    pair.run(3.0)
    times = [at_ns for at_ns, _ in pair.sent_on(joint_command(Side.RIGHT), START_NS)]
    assert max(b - a for a, b in pairwise(times)) < 100 * MS
    down_in_ns = pair.see().lease.down_in_ns
    assert down_in_ns is not None and 55 * S < down_in_ns < 60 * S


def test_only_a_hold_is_handed_over():
    """A guard that watches, or brings everything down, keeps what it has."""
    pair = moving()
    assert pair.guardian.hand_over(pair.now_ns) is None
    pair.guardian.handed_on()
    pair.guardian.take_back(pair.now_ns)
    assert pair.guardian.phase is Phase.WATCHING
    pair.die()
    pair.guardian.end(pair.now_ns)
    assert pair.guardian.hand_over(pair.now_ns) is None


def test_a_hold_that_comes_back_at_once_goes_on():
    """The daemon died, or refused, before it sent anything."""
    pair = moving()
    pair.die()
    pair.run(0.1)
    assert pair.guardian.hand_over(pair.now_ns) is not None
    before = pair.sent
    pair.run(0.05)
    assert pair.sent == before, "a guard that has handed over sent something"
    pair.guardian.take_back(pair.now_ns)
    pair.run(1.0)
    assert (pair.state, pair.guardian.is_holding) == ("HOLDING", True)


def test_a_hold_that_comes_back_too_late_goes_down():
    """The robot has stopped the arms meanwhile: no old setpoint must meet them."""
    pair = moving()
    pair.die()
    pair.run(0.1)
    pair.guardian.hand_over(pair.now_ns)
    pair.on_step = None  # the gap is what this is about
    pair.run(0.16)
    back_ns = pair.now_ns
    pair.guardian.take_back(pair.now_ns)
    pair.run_until(lambda: pair.guardian.phase is Phase.DONE, 4.0)
    assert pair.sent_on(joint_command(Side.LEFT), back_ns) == []
    assert pair.guardian.engine.state is State.READ_ONLY


def test_a_hold_whose_new_daemon_hangs_goes_down():
    """It asked for the hold and then froze: nobody would command the robot else, and nobody would say so."""
    pair = without_gaps(moving())
    pair.die()
    pair.run(0.1)
    pair.guardian.hand_over(pair.now_ns)
    handed_ns = pair.now_ns
    pair.run(HANDED_NS / S - 0.01)
    assert pair.sent_on(FSM_ENABLE, handed_ns + 1) == []
    pair.run_until(lambda: pair.guardian.phase is Phase.DONE, 4.0)
    assert {frame.values for _, frame in pair.sent_on(FSM_ENABLE, handed_ns + 1)} == {(0.0,)}
    assert pair.sent_on(joint_command(Side.LEFT), handed_ns + 1) == []
    assert pair.robot.fsm.published == 0
