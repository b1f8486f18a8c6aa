"""Rules of the robot's state machine (§4.7, §4.11.1)."""

from __future__ import annotations

import math

import pytest

from gateway.sim.robot.fsm import StateMachine
from gateway.sim.robot.manual import Fsm, S


def started() -> StateMachine:
    """A machine in SLOW_START since time 0."""
    machine = StateMachine()
    machine.enable(1.0, 0)
    return machine


def ready() -> StateMachine:
    """A machine in READY; its last 1.0 came at time 0."""
    machine = started()
    for _ in range(5):
        machine.check([0.0, 0.0])
    return machine


def test_a_robot_begins_paused():
    """Nothing moves before the first 1.0."""
    assert StateMachine().state is Fsm.PAUSE


def test_one_starts_slowly_and_five_settled_checks_make_it_ready():
    """1.0 leads to SLOW_START; READY needs five consecutive checks at or below 0.08 rad."""
    machine = started()
    assert machine.state is Fsm.SLOW_START
    for _ in range(4):
        assert not machine.check([0.08, 0.0])
    assert machine.check([0.08, 0.0])
    assert machine.state is Fsm.READY


def test_one_unsettled_check_begins_the_count_anew():
    """The five checks must be consecutive."""
    machine = started()
    for deviation in (0.0, 0.0, 0.0, 0.0, 0.081, 0.0, 0.0, 0.0, 0.0):
        assert not machine.check([deviation])
    assert machine.check([0.0])


def test_every_enabled_arm_must_be_settled():
    """One arm away from its target keeps the machine in SLOW_START."""
    machine = started()
    assert not any(machine.check([0.0, 0.5]) for _ in range(20))


def test_without_an_enabled_arm_it_never_becomes_ready():
    """No arm, no readiness."""
    machine = started()
    assert not any(machine.check([]) for _ in range(20))


def test_checks_mean_nothing_outside_slow_start():
    """PAUSE does not become READY by settled joints."""
    machine = StateMachine()
    assert not any(machine.check([0.0]) for _ in range(20))


@pytest.mark.parametrize("make", [started, ready])
def test_zero_pauses_at_once(make):
    """0.0 leads to PAUSE from any running state."""
    machine = make()
    assert machine.enable(0.0, 1)
    assert machine.state is Fsm.PAUSE


@pytest.mark.parametrize("make", [started, ready])
def test_more_than_one_second_without_one_pauses(make):
    """Exactly one second is still in time; the next nanosecond is not."""
    machine = make()
    assert not machine.expire(1 * S)
    assert machine.expire(1 * S + 1)
    assert machine.state is Fsm.PAUSE
    assert machine.deadline_ns is None


def test_each_one_feeds_the_watchdog():
    """The deadline moves with every 1.0."""
    machine = ready()
    machine.enable(1.0, 900_000_000)
    assert not machine.expire(1_900_000_000)
    assert machine.expire(1_900_000_001)


@pytest.mark.parametrize("value", [0.5, 2.0, -1.0, math.nan, math.inf, 0.999])
def test_other_values_neither_feed_nor_pause(value):
    """The manual knows 1.0 and 0.0 only."""
    machine = ready()
    assert not machine.enable(value, 900_000_000)
    assert machine.state is Fsm.READY
    assert machine.expire(1 * S + 1)


def test_error_is_left_neither_by_one_nor_by_zero():
    """Only the end of the fault leads out of ERROR, into PAUSE."""
    machine = ready()
    machine.pin(Fsm.ERROR)
    machine.enable(0.0, 1)
    machine.enable(1.0, 2)
    assert machine.state is Fsm.ERROR
    machine.pin(None)
    assert machine.state is Fsm.PAUSE


def test_a_held_pause_ignores_one():
    """Somebody at the robot keeps it paused; afterwards 1.0 starts it again."""
    machine = StateMachine()
    machine.is_held = True
    machine.enable(1.0, 0)
    assert machine.state is Fsm.PAUSE
    machine.is_held = False
    machine.enable(1.0, 1)
    assert machine.state is Fsm.SLOW_START


def test_an_unknown_value_is_published_and_acts_as_pause():
    """A value outside §4.11.1 can be shown to users."""
    machine = ready()
    machine.pin(9)
    assert (machine.published, machine.state) == (9, Fsm.PAUSE)


def test_a_pinned_state_outlasts_heartbeat_checks_and_silence():
    """A pinned state does not change by itself, and pinning it again changes nothing."""
    machine = StateMachine()
    machine.pin(Fsm.SLOW_START)
    machine.pin(Fsm.SLOW_START)
    assert not any(machine.check([0.0]) for _ in range(20))
    assert not machine.expire(10 * S)
    machine.pause()
    assert machine.published == 1
