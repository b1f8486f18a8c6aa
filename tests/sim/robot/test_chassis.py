"""Rules of the simulated chassis (§4.5)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.sim.robot.chassis import WHEEL_RADIUS_M, SimChassis, ramp, wheel_matrix
from gateway.sim.robot.journal import Journal
from gateway.sim.robot.manual import MS, S


def chassis() -> SimChassis:
    """An enabled chassis."""
    return SimChassis(Journal(), is_enabled=True)


def test_speeds_up_at_0_3_and_slows_down_at_0_6():
    """The ramps of the manual, for each component."""
    sim = chassis()
    sim.command([0.3, -0.3, 0.15], 0)
    sim.move(500 * MS)
    assert sim.velocity == pytest.approx([0.15, -0.15, 0.15])
    sim.move(1 * S)
    assert sim.velocity == pytest.approx([0.3, -0.3, 0.15])
    sim.command([0.0, 0.0, 0.0], 1)
    sim.move(250 * MS)
    assert sim.velocity == pytest.approx([0.15, -0.15, 0.0])
    sim.move(250 * MS)
    assert sim.velocity == [0.0, 0.0, 0.0]


def test_turning_round_goes_through_zero():
    """A reversal slows down at 0.6 and speeds up at 0.3."""
    assert ramp(0.3, -0.3, 0.5)[0] == pytest.approx(0.0)
    assert ramp(0.3, -0.3, 1.0)[0] == pytest.approx(-0.15)


@given(v=st.floats(-1, 1), target=st.floats(-1, 1), duration_s=st.floats(0, 5), share=st.floats(0, 1))
def test_ramp_does_not_depend_on_the_step(v, target, duration_s, share):
    """Two parts of a ramp give speed and way of the whole."""
    whole = ramp(v, target, duration_s)
    first = ramp(v, target, duration_s * share)
    second = ramp(first[0], target, duration_s - duration_s * share)
    assert second[0] == pytest.approx(whole[0], abs=1e-9)
    assert first[1] + second[1] == pytest.approx(whole[1], abs=1e-9)


@given(v=st.floats(-1, 1), target=st.floats(-1, 1))
def test_ramp_arrives(v, target):
    """In the end the target is met exactly, and no way is made when there is none to make."""
    assert ramp(v, target, 20.0)[0] == target
    assert ramp(v, target, 0.0) == (v, 0.0)


def test_the_last_target_stays_for_one_second():
    """Silence: the target is kept for a second, then zero (§4.5)."""
    sim = chassis()
    sim.command([0.2, 0.0, 0.0], 0)
    sim.move(1 * S)
    sim.expire(1 * S)
    assert sim.target[0] == 0.2
    sim.expire(1 * S + 1)
    assert sim.target == [0.0, 0.0, 0.0]
    sim.move(1 * S)
    assert sim.velocity == [0.0, 0.0, 0.0]


def test_zeros_that_end_in_silence_trip_nothing():
    """A stream of zeros may simply stop; the watchdog has nothing to stop."""
    sim = chassis()
    sim.command([0.0, 0.0, 0.0], 0)
    sim.expire(2 * S)
    assert sim.deadline_ns is None
    assert "CHASSIS_WATCHDOG" not in sim._journal.codes()


@pytest.mark.parametrize("data", [[], [0.1], [0.1, 0.0], [0.1, 0.0, 0.0, 0.0]])
def test_a_wrong_length_ends_the_node(data):
    """The manual's warning comes true: the node stops and takes nothing until it is restarted."""
    sim = chassis()
    sim.command([0.2, 0.0, 0.0], 0)
    sim.move(1 * S)
    assert not sim.command(data, 1)
    assert sim.is_dead
    assert not sim.command([0.1, 0.0, 0.0], 2)
    sim.move(1 * S)
    assert sim.velocity == [0.0, 0.0, 0.0]
    sim.restart()
    assert sim.command([0.1, 0.0, 0.0], 3)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_value_that_is_not_finite_spoils_the_speed_state(value):
    """The wheels' speeds are invalid from then on."""
    sim = chassis()
    assert not sim.command([0.1, value, 0.0], 0)
    assert sim.is_spoiled
    assert np.all(np.isnan(sim.wheels()[1]))


def test_wheels_carry_the_body_as_omni_wheels_do():
    """Driving ahead turns the two front wheels against each other and leaves the rear one; turning turns all alike."""
    ahead = wheel_matrix() @ [1.0, 0.0, 0.0]
    assert ahead[2] == pytest.approx(0.0, abs=1e-9)
    assert ahead[0] == pytest.approx(-ahead[1])
    assert abs(ahead[0]) == pytest.approx(math.sin(math.radians(60)) / WHEEL_RADIUS_M, rel=1e-6)
    turning = wheel_matrix() @ [0.0, 0.0, 1.0]
    assert np.all(np.sign(turning) == np.sign(turning[0]))
    assert np.abs(turning[:2]) == pytest.approx(math.hypot(0.14484, 0.25087) / WHEEL_RADIUS_M, rel=1e-4)


def test_wheel_speeds_determine_the_body_velocity():
    """Three wheels, three components: the map can be inverted."""
    assert abs(np.linalg.det(wheel_matrix())) > 1.0


def test_wheel_angles_add_up_the_way():
    """The wheel angle is the way over the wheel's radius along its rolling direction."""
    sim = chassis()
    sim.command([0.0, 0.2, 0.0], 0)
    sim.move(2 * S)
    angles, speeds = sim.wheels()
    assert angles[2] == pytest.approx(-sim.travel[1] / WHEEL_RADIUS_M, rel=1e-6) or angles[2] == pytest.approx(
        sim.travel[1] / WHEEL_RADIUS_M, rel=1e-6
    )
    assert speeds == pytest.approx(wheel_matrix() @ [0.0, 0.2, 0.0])
