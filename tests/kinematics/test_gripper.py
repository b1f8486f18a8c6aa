"""Tests of the gripper: its stroke, its lever, forces by virtual work, doubts by random trials."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.kinematics.description import nominal
from gateway.kinematics.gripper import OTHER_COUPLER_M, Gripper, Length, Torque, feed_forward, measured
from gateway.robot.limits import GRIPPER_TORQUE_NM
from gateway.values import ValueRefused
from tests.changed import replace
from tests.thoroughness import either

GRIPPER = Gripper.of(nominal())
STROKE = np.linspace(0.0, 1.0, 21)


def test_both_fingers_open_as_the_description_says():
    """The crank's range 0..−0.98 for a motor angle 0..1, the other finger the same mirrored (mimic −1), to 0.02 rad."""
    for q in STROKE:
        first, second = GRIPPER.close(q)
        assert first.crank_rad == pytest.approx(0.98 * q, abs=0.025)
        assert second.crank_rad == pytest.approx(-first.crank_rad, abs=0.025)
    first, second = GRIPPER.close(1.0)
    assert first.crank_rad == pytest.approx(0.98, abs=0.006)
    assert second.crank_rad == pytest.approx(-first.crank_rad, abs=5e-4), "how the second coupler was chosen"


def test_a_uniform_second_bar_would_jam_inside_the_stroke():
    """Twice its centre of mass for a coupler stretches the linkage out before 1 rad: so that cannot be its length."""
    com_x, com_y, _ = nominal().gripper["left"]["other_coupler"]["com_m"]
    uniform = 2.0 * math.hypot(com_x, com_y)
    assert abs(uniform - OTHER_COUPLER_M) < 0.0013, "near it all the same"
    second = GRIPPER.fingers[1]
    pin = complex(*second.pivot_m) + complex(*second.short_arm_m) + 2.0 * complex(com_x, -com_y)
    with pytest.raises(ValueRefused, match="stretched out"):
        replace(second, rotor_radius_m=abs(pin), coupler_m=uniform).close(0.97)


def test_lengths_that_nobody_published_say_so():
    """Each of the three tells how it was found, and how far it may be off; one that was measured takes its place."""
    for length in (GRIPPER.rotor_radius, *GRIPPER.couplers):
        assert length.basis.startswith("not published: ") and length.sigma_m > 0.0
    assert GRIPPER.rotor_radius.value_m == pytest.approx(0.015, abs=2e-5)
    own = Length(value_m=0.0148, sigma_m=1e-5, basis="measured")
    other = Gripper.of(nominal(), own, GRIPPER.couplers)
    assert other.rotor_radius is own and other.fingers[0].rotor_radius_m == 0.0148
    assert abs(other.opening_m(0.5) - GRIPPER.opening_m(0.5)) > 1e-4
    with pytest.raises(ValueRefused, match="do not reach"):
        Gripper.of(nominal(), replace(own, value_m=0.2))


def test_fingers_open_from_nothing_and_stay_on_their_sides():
    """0 closed, growing with the motor, some 87 mm at 1 rad; the first finger at positive y moves up, the second down."""
    openings = [GRIPPER.opening_m(q) for q in STROKE]
    assert openings[0] == 0.0 and (np.diff(openings) > 0.0).all()
    assert openings[-1] == pytest.approx(0.087, abs=0.001)
    first, second = GRIPPER.close(0.5)
    assert first.jacobian_m[1] > 0.0 > second.jacobian_m[1]
    assert first.finger_m[1] > 0.0 > second.finger_m[1]


def test_the_lever_is_the_opening_by_finite_differences():
    """J_lᵀ n_l + J_rᵀ n_r is how fast the fingers part."""
    step = 1e-6
    for q in STROKE:
        difference = (GRIPPER.opening_m(q + step) - GRIPPER.opening_m(q - step)) / (2 * step)
        assert GRIPPER.opening_per_rad_m(q) == pytest.approx(difference, abs=1e-8)


def test_forces_do_the_work_of_the_motor():
    """Virtual work over a closing stroke: ∫ τ dq is what the fingers' pressure does along their way (§4.4.2)."""
    q = np.linspace(1.0, 0.1, either(200, 2000))
    torque = measured(-0.8)
    forces = np.array([GRIPPER.force(angle, torque).force_n for angle in q])
    openings = np.array([GRIPPER.opening_m(angle) for angle in q])
    assert (forces > 0.0).all(), "a closing torque is negative (§4.4), the grip it makes is counted positive"
    work_of_motor = -0.8 * (q[-1] - q[0])
    work_of_fingers = np.sum(0.5 * (forces[1:] + forces[:-1]) * -np.diff(openings))
    assert work_of_fingers == pytest.approx(work_of_motor, rel=1e-4)


def test_the_force_is_the_manuals_quotient():
    """λ = τ / (J_lᵀ n_l + J_rᵀ n_r), and an opening torque pushes outwards."""
    first, second = GRIPPER.close(0.6)
    lever = first.jacobian_m @ (0, 1) + second.jacobian_m @ (0, -1)
    for tau in (-1.6, -0.18, 2.0):
        found = GRIPPER.force(0.6, measured(tau))
        assert found.force_n == pytest.approx(-tau / lever)
        assert found.opening_m == GRIPPER.opening_m(0.6) and found.basis == "measured"


@pytest.mark.parametrize(("raw", "tau_nm"), GRIPPER_TORQUE_NM)
def test_the_table_gives_the_torque_and_a_wide_doubt(raw, tau_nm):
    """Feed-forward only (§4.4): its doubt is wider than a measurement's, and never nothing, not even at no torque."""
    guess = feed_forward(raw)
    assert guess.value_nm == tau_nm and guess.basis == "feed_forward"
    assert guess.sigma_nm >= measured(tau_nm).sigma_nm > 0.05
    force = GRIPPER.force(0.4, guess)
    assert force.sigma_n > 0.5 and force.basis == "feed_forward"


@pytest.mark.parametrize("q_rad", [0.1, 0.5, 0.95])
def test_the_doubt_is_that_of_random_trials(q_rad):
    """Torque, angle and the three lengths drawn at random: the spread of the force is the estimate's, within a tenth."""
    rng = np.random.default_rng(3)
    torque, angle_sigma = Torque(value_nm=-1.0, sigma_nm=0.05, basis="measured"), 0.01
    estimate = GRIPPER.force(q_rad, torque, angle_sigma)
    lengths = (GRIPPER.rotor_radius, *GRIPPER.couplers)
    trials = []
    for _ in range(either(1500, 6000)):
        radius, first, second = (replace(x, value_m=x.value_m + 0.5 * rng.normal() * x.sigma_m) for x in lengths)
        tried = Gripper.of(nominal(), radius, (first, second))
        trials.append(
            -(-1.0 + 0.5 * rng.normal() * 0.05) / tried.opening_per_rad_m(q_rad + 0.5 * rng.normal() * angle_sigma)
        )
    assert 2.0 * np.std(trials) == pytest.approx(estimate.sigma_n, rel=0.1)
    assert np.mean(trials) == pytest.approx(estimate.force_n, rel=0.01)


def test_the_doubt_names_its_parts():
    """Five sources, independent: their squares sum to the whole; with a good torque the lengths are most of it."""
    found = GRIPPER.force(0.0, Torque(value_nm=-1.6, sigma_nm=0.001, basis="measured"), 0.0)
    assert set(found.parts_n) == {"torque", "angle", "rotor radius", "first coupler", "second coupler"}
    assert math.hypot(*found.parts_n.values()) == pytest.approx(found.sigma_n)
    assert max(found.parts_n, key=found.parts_n.get) == "rotor radius" and found.parts_n["angle"] == 0.0


@pytest.mark.parametrize("raw", [-0.01, 1.01, math.nan, math.inf])
def test_an_input_that_the_gripper_does_not_take_is_refused(raw):
    """0 to 1 (§4.4)."""
    with pytest.raises(ValueRefused, match=r"\[0, 1\]"):
        feed_forward(raw)


def test_what_is_not_finite_or_out_of_reach_is_refused():
    """A torque that is NaN; a motor angle at which the linkage cannot be."""
    with pytest.raises(ValueRefused, match="effort"):
        measured(math.nan)
    for ask in (GRIPPER.opening_m, GRIPPER.opening_per_rad_m, lambda q: GRIPPER.force(q, measured(-1.0))):
        with pytest.raises(ValueRefused, match="stretched out"):
            ask(2.0)
