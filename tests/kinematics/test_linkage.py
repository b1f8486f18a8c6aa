"""Tests of one finger's linkage: the loop closes, the Jacobian is what finite differences say, and it ends where it jams."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.kinematics.description import nominal
from gateway.kinematics.gripper import Gripper
from gateway.kinematics.linkage import Branch
from gateway.values import ValueRefused
from tests.changed import replace
from tests.thoroughness import either

FINGERS = Gripper.of(nominal()).fingers
BOTH = pytest.mark.parametrize("finger", FINGERS, ids=["first", "second"])


def turn(angle):
    """Return R_z of an angle in the plane."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def chain(finger, at, end):
    """Return the manual's chain {b} -> {0} -> {1} -> {2'} to a point of the crank, as matrices (§4.4.2)."""
    pin = finger._rotor_pin
    pin = np.array([pin.real, pin.imag])
    bar = np.add(finger.pivot_m, finger.short_arm_m) - pin
    arm = np.subtract(end, finger.short_arm_m)
    return turn(-at.q_rad) @ (pin + turn(at.phi_rad) @ (bar + turn(at.theta_rad) @ arm))


@BOTH
def test_the_loop_closes_at_every_motor_angle(finger):
    """g(q, φ, θ) = 0: the chain over rotor, coupler and crank ends at the crank's pivot, which does not move (§4.4.2)."""
    for q in np.linspace(-0.05, 1.3, 80):
        at = finger.close(q)
        np.testing.assert_allclose(chain(finger, at, (0, 0)), finger.pivot_m, atol=1e-15)
        np.testing.assert_allclose(chain(finger, at, finger.long_arm_m), at.finger_m, atol=1e-15)


@BOTH
def test_everything_is_parallel_when_closed(finger):
    """At q = 0, φ = θ = 0, and the finger's pin is where the description has it; the rotor's pin has both its lengths."""
    at = finger.close(0.0)
    assert (at.phi_rad, at.theta_rad, at.crank_rad) == pytest.approx((0.0, 0.0, 0.0), abs=1e-15)
    np.testing.assert_allclose(at.finger_m, np.add(finger.pivot_m, finger.long_arm_m), atol=1e-15)
    crank_pin, pin = complex(*np.add(finger.pivot_m, finger.short_arm_m)), finger._rotor_pin
    assert abs(pin) == pytest.approx(finger.rotor_radius_m) and abs(crank_pin - pin) == pytest.approx(finger.coupler_m)
    assert (pin / crank_pin).imag < 0.0, "clockwise of the crank's pin: turning clockwise, the rotor pulls"


@BOTH
def test_the_jacobian_is_that_of_finite_differences(finger):
    """J = ∂F/∂q − ∂F/∂α (∂g/∂α)⁻¹ ∂g/∂q, against central differences of the closed linkage, over the whole stroke."""
    step = 1e-6
    for q in np.random.default_rng(1).uniform(-0.05, 1.25, either(300, 10_000)):
        difference = (finger.close(q + step).finger_m - finger.close(q - step).finger_m) / (2 * step)
        np.testing.assert_allclose(finger.close(q).jacobian_m, difference, atol=1e-8)


@BOTH
def test_the_jacobian_is_the_manuals_formula_number_by_number(finger):
    """With ∂F and ∂g by differences of the manual's open chain, solved as a 2 × 2 system."""
    step = 1e-6
    for q in (0.0, 0.3, 0.7, 1.1):
        at = finger.close(q)

        def partial(end, name, at=at):
            up, down = (replace(at, **{name: getattr(at, name) + sign * step}) for sign in (1, -1))
            return (chain(finger, up, end) - chain(finger, down, end)) / (2 * step)

        names = ("phi_rad", "theta_rad")
        f_a = np.stack([partial(finger.long_arm_m, name) for name in names], -1)
        g_a = np.stack([partial((0, 0), name) for name in names], -1)
        expected = partial(finger.long_arm_m, "q_rad") - f_a @ np.linalg.solve(g_a, partial((0, 0), "q_rad"))
        np.testing.assert_allclose(at.jacobian_m, expected, atol=1e-9)


@BOTH
def test_angles_run_without_a_jump(finger):
    """Small steps of the motor are small steps of φ, θ and crank: the assembly never flips."""
    angles = np.array([[a.phi_rad, a.theta_rad, a.crank_rad] for a in map(finger.close, np.linspace(0, 1.3, 1301))])
    assert np.abs(np.diff(angles, axis=0)).max() < 0.005


def test_a_linkage_that_is_stretched_out_is_refused():
    """Beyond its range the first finger's parts do not reach, and just before they would jam: the message has the angle.

    The second finger's rotor could go round; the first one ends the gripper's stroke.
    """
    first, second = FINGERS
    angles = np.linspace(1.2, 3.0, 1801)
    ends = next(q for q in angles if not can_be(first, q))
    assert 1.3 < ends < 1.4
    with pytest.raises(ValueRefused, match=f"{ends + 0.1:.3f} rad: it is stretched out"):
        first.close(ends + 0.1)
    assert np.linalg.norm(first.close(ends - 0.001).jacobian_m) > 0.1, (
        "the finger runs away from the motor before it jams"
    )
    assert all(can_be(second, q) for q in angles)


def can_be(finger, q_rad):
    """Return whether a finger can be at a motor angle."""
    try:
        finger.close(q_rad)
    except ValueRefused:
        return False
    return True


def test_lengths_that_do_not_reach_are_refused():
    """Too short, too long, none at all."""
    finger = FINGERS[0]
    for change in ({"coupler_m": 0.01}, {"coupler_m": 0.1}, {"rotor_radius_m": 0.001}):
        with pytest.raises(ValueRefused, match="do not reach"):
            replace(finger, **change)
    for change in ({"coupler_m": 0.0}, {"rotor_radius_m": -0.01}, {"coupler_m": math.nan}):
        with pytest.raises(ValueRefused, match=r"above 0|do not reach"):
            replace(finger, **change)


def test_a_parallelogram_turns_as_its_rotor():
    """A case that is known without computing: equal arms, equal bars; crank and rotor turn alike, the pin on a circle."""
    square = Branch(
        pivot_m=(0.05, 0.0), short_arm_m=(0.0, -0.02), long_arm_m=(0.0, 0.04), rotor_radius_m=0.02, coupler_m=0.05
    )
    at = square.close(0.3)
    assert at.crank_rad == pytest.approx(-0.3) and at.phi_rad == pytest.approx(0.3)
    np.testing.assert_allclose(at.finger_m, (0.05 + 0.04 * math.sin(0.3), 0.04 * math.cos(0.3)), atol=1e-12)
    np.testing.assert_allclose(at.jacobian_m, (0.04 * math.cos(0.3), -0.04 * math.sin(0.3)), atol=1e-12)
