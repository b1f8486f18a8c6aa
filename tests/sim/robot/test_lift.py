"""Rules of the simulated lift (§4.6)."""

from __future__ import annotations

import math

import pytest

from gateway.sim.robot.journal import Journal
from gateway.sim.robot.lift import LOWEST_M, SimLift
from gateway.sim.robot.manual import LIFT_MOTOR_RADPS, MS, S


def lift(*, is_configured: bool = True) -> SimLift:
    """A lift at 0.30 m below the top."""
    return SimLift(Journal(), 0, is_configured=is_configured)


def drive(sim: SimLift, data, begin_ns: int, duration_ns: int, until_ns: int | None = None) -> int:
    """Send a command at 20 Hz for a time, then live on until a time; return where time stands."""
    now_ns = begin_ns
    while now_ns < begin_ns + duration_ns:
        sim.command(data, now_ns)
        now_ns += 50 * MS
        sim.expire(now_ns)
        sim.move_to(now_ns)
    end_ns = until_ns or now_ns
    while now_ns < end_ns:
        now_ns += 5 * MS
        sim.expire(now_ns)
        sim.move_to(now_ns)
    return now_ns


def test_positive_input_raises_with_negative_motor_speed():
    """Motor speed is -input x 150 rad/s; raising lowers the distance from the top."""
    sim = lift()
    drive(sim, [0.3, 1.0], 0, 600 * MS)
    assert sim.motor_radps == pytest.approx(-0.3 * LIFT_MOTOR_RADPS)
    assert sim.lowered_m < 0.30
    down = lift()
    drive(down, [-0.3, 1.0], 0, 600 * MS)
    assert down.motor_radps == pytest.approx(0.3 * LIFT_MOTOR_RADPS)
    assert down.lowered_m - 0.30 == pytest.approx(0.30 - sim.lowered_m)


def test_zero_with_enable_stops_and_keeps_the_servo():
    """[0, 1] brakes to a stop with the servo on."""
    sim = lift()
    now_ns = drive(sim, [0.3, 1.0], 0, 500 * MS)
    drive(sim, [0.0, 1.0], now_ns, 1 * S)
    assert (sim.motor_radps, sim.is_powered) == (0.0, True)


@pytest.mark.parametrize("data", [[0.0, 0.0], [0.3, 0.5], [0.3, 0.0]])
def test_disabling_stops_first_and_then_cuts_the_servo(data):
    """Enable at or below 0.5: speed to zero under power, then the servo goes off."""
    sim = lift()
    now_ns = drive(sim, [1.0, 1.0], 0, 600 * MS)
    sim.command(data, now_ns)
    sim.move_to(now_ns + 20 * MS)
    assert sim.is_powered
    assert sim.motor_radps != 0.0
    sim.move_to(now_ns + 2 * S)
    assert (sim.motor_radps, sim.is_powered) == (0.0, False)


def test_more_than_three_seconds_of_silence_stop_and_disable():
    """Exactly three seconds are in time."""
    sim = lift()
    sim.command([-0.1, 1.0], 0)
    sim.move_to(3 * S)
    sim.expire(3 * S)
    assert sim.motor_radps == pytest.approx(0.1 * LIFT_MOTOR_RADPS)
    sim.expire(3 * S + 1)
    sim.move_to(4 * S)
    assert (sim.motor_radps, sim.is_powered) == (0.0, False)


def test_a_disabled_lift_that_falls_silent_trips_nothing():
    """After [0, 0] silence is normal."""
    sim = lift()
    sim.command([0.0, 0.0], 0)
    sim.expire(10 * S)
    assert "LIFT_WATCHDOG" not in sim._journal.codes()


@pytest.mark.parametrize(("velocity", "end_m"), [(1.0, 0.0), (-1.0, LOWEST_M)])
def test_soft_limits_slow_down_and_hold(velocity, end_m):
    """Near a limit the speed falls; the limit is never passed."""
    sim = lift()
    fastest = 0.0
    for step in range(600):
        sim.command([velocity, 1.0], step * 5 * MS)
        sim.move_to((step + 1) * 5 * MS)
        assert 0.0 <= sim.lowered_m <= LOWEST_M
        fastest = max(fastest, abs(sim.motor_radps))
    assert fastest > 0.9 * LIFT_MOTOR_RADPS
    assert sim.lowered_m == pytest.approx(end_m, abs=2e-3)
    assert abs(sim.motor_radps) < 0.1 * LIFT_MOTOR_RADPS


def test_fsm_error_stops_it():
    """In ERROR the lift stops under control and stays."""
    sim = lift()
    now_ns = drive(sim, [0.3, 1.0], 0, 500 * MS)
    sim.has_error = True
    drive(sim, [0.3, 1.0], now_ns, 500 * MS)
    assert (sim.motor_radps, sim.is_powered) == (0.0, True)


@pytest.mark.parametrize("data", [[], [0.3], [math.nan, 1.0], [0.3, math.inf]])
def test_two_finite_values_are_needed(data):
    """Anything less is refused."""
    sim = lift()
    assert not sim.command(data, 0)
    assert not sim.is_powered


def test_inputs_beyond_one_are_cut():
    """The input range is [-1, 1]."""
    sim = lift()
    drive(sim, [-5.0, 1.0], 0, 700 * MS)
    assert sim.motor_radps <= LIFT_MOTOR_RADPS


def test_a_lift_that_is_not_configured_takes_nothing():
    """Without the switch in the configuration commands do not reach the servo (§4.6)."""
    sim = lift(is_configured=False)
    assert not sim.command([0.3, 1.0], 0)
    sim.move_to(1 * S)
    assert sim.lowered_m == 0.30


def test_motion_does_not_depend_on_the_step():
    """The lift's own grid makes one long step and many odd ones the same."""
    ends = []
    for step_ns in (5 * S, 13 * MS, 1 * MS):
        sim = lift()
        sim.command([0.4, 1.0], 0)
        for now_ns in range(step_ns, 2 * S, step_ns):
            sim.move_to(now_ns)
        sim.move_to(2 * S)
        ends.append((sim.lowered_m, sim.motor_radps))
    assert ends[0] == ends[1] == ends[2]
