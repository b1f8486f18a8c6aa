"""What drives do beside the rigid body."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.kinematics.description import nominal
from gateway.kinematics.dynamics.parameters import DriveParameters, nominal_parameters
from gateway.values import Side, ValueRefused

ONES = (1.0,) * 7


def test_friction_is_coulombs_with_a_smooth_sign_and_viscous():
    """Odd in the velocity, zero at rest, Coulomb's and viscous once it moves."""
    drives = DriveParameters(coulomb_nm=(0.4,) * 7, viscous_nmsprad=(0.1,) * 7)
    fast = drives.friction_nm(np.full(7, 1.0))
    assert fast == pytest.approx(0.5) and drives.friction_nm(np.full(7, -1.0)) == pytest.approx(-fast)
    assert drives.friction_nm(np.zeros(7)) == pytest.approx(0.0)


def test_a_joint_that_stands_is_held_by_nobody_knows_what():
    """Its Coulomb friction is unknown at rest, and known once it moves."""
    drives = DriveParameters(coulomb_nm=(0.4,) * 7, friction_sd_nm=(0.1,) * 7)
    assert drives.unknown_friction_nm(np.zeros(7)) == pytest.approx(np.hypot(0.1, 0.4))
    assert drives.unknown_friction_nm(np.full(7, -1.0)) == pytest.approx(0.1)


def test_what_nobody_published_is_not_made_up():
    """No friction, but a standard deviation of it that grows with the motor; scale one."""
    drives = nominal_parameters(nominal(), Side.LEFT)
    assert drives.source == "nominal" and drives.scale == ONES and not any(drives.coulomb_nm)
    assert drives.friction_sd_nm == pytest.approx((0.8, 0.8, 0.4, 0.4, 0.12, 0.1, 0.12))


@pytest.mark.parametrize(
    "wrong",
    [
        {"scale": (0.0, *ONES[1:])},
        {"coulomb_nm": (-0.1, *ONES[1:])},
        {"viscous_nmsprad": (-0.1, *ONES[1:])},
        {"unsure_part": 1.0},
        {"unsure_part": float("nan")},
    ],
)
def test_numbers_that_no_drive_has_are_refused(wrong):
    """A scale of nothing, friction that drives."""
    with pytest.raises(ValueError):
        DriveParameters(**wrong)


@pytest.mark.parametrize("wrong", [(1.0,) * 6, (float("nan"), *ONES[1:])])
def test_wrong_shapes_are_refused(wrong):
    """Seven finite numbers each."""
    with pytest.raises(ValueRefused):
        DriveParameters(friction_sd_nm=wrong)
