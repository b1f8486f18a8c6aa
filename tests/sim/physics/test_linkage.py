"""The gripper's linkage as points, against the gateway's own closure: found in another way, from the same numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.kinematics.description import nominal
from gateway.kinematics.gripper import Gripper
from gateway.sim.physics.linkage import OPEN_RAD, hand_angles, hand_pins


def test_the_pins_are_where_the_gateway_has_them():
    """Rotor radius and both couplers; the second's is found by the same wish: open alike at 1 rad."""
    hand = hand_pins()
    theirs = Gripper.of(nominal())
    for finger, branch in zip(hand.fingers, theirs.fingers, strict=True):
        assert math.dist(finger.rotor_pin_m, hand.rotor_m) == pytest.approx(branch.rotor_radius_m, abs=1e-9)
        assert math.dist(finger.rotor_pin_m, finger.crank_pin_m) == pytest.approx(branch.coupler_m, abs=1e-5)
        assert np.subtract(finger.pivot_m, hand.rotor_m) == pytest.approx(branch.pivot_m, abs=1e-12)


def test_both_fingers_are_open_alike_at_one_radian():
    """As the description has it: the second crank turns by minus the first."""
    (first, _), (second, _) = hand_angles(OPEN_RAD)
    assert first == pytest.approx(-second, abs=1e-9)
    assert first == pytest.approx(0.98, abs=0.01)


@pytest.mark.parametrize("motor_rad", [0.0, 0.2, 0.5, 0.8, 1.0])
def test_the_cranks_turn_as_the_gateway_s_closure_says(motor_rad):
    """Found by following the circles here, by one closed step there."""
    theirs = Gripper.of(nominal()).close(motor_rad)
    for (crank_rad, _), closure in zip(hand_angles(motor_rad), theirs, strict=True):
        assert crank_rad == pytest.approx(closure.crank_rad, abs=2e-3)


@pytest.mark.parametrize("motor_rad", [0.0, 0.3, 0.7, 1.0])
def test_coupler_and_rotor_meet(motor_rad):
    """From the crank's side the coupler ends where the rotor has its pin."""
    hand = hand_pins()
    for finger, (crank_rad, coupler_rad) in zip(hand.fingers, hand_angles(motor_rad), strict=True):
        pivot, crank_pin, rotor_pin = (
            complex(*point) for point in (finger.pivot_m, finger.crank_pin_m, finger.rotor_pin_m)
        )
        end = pivot + (crank_pin - pivot) * np.exp(1j * crank_rad)
        end += (rotor_pin - crank_pin) * np.exp(1j * (crank_rad + coupler_rad))
        rotor = complex(*hand.rotor_m)
        assert abs(end - (rotor + (rotor_pin - rotor) * np.exp(-1j * motor_rad))) < 1e-12


def test_a_motor_angle_beyond_the_linkage_is_refused():
    """Two lengths that do not reach each other, in millimetres."""
    with pytest.raises(ValueError, match=r"mm and .* mm do not join points .* mm apart"):
        hand_angles(3.0)
