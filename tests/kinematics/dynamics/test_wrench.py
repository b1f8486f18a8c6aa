"""Forces at the hand from torques of joints: what levers tell, how sure, and what no lever tells."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.kinematics.arm import ArmModel
from gateway.kinematics.description import nominal
from gateway.kinematics.dynamics.wrench import LEAST_LEVER_M, wrench_of
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import Side

PULL = np.array([3.0, -5.0, 8.0, 0.2, -0.1, 0.3])
VARIANCE = np.array([0.04, 0.04, 0.02, 0.02, 0.01, 0.01, 0.01])
ARM = ArmModel(nominal(), Side.LEFT)


def jacobian(q_rad):
    """As the gateway's own kinematics have it."""
    return np.array(ARM.jacobian(tuple(q_rad)))


def test_a_wrench_is_found_again_in_the_torques_that_it_makes():
    """Exactly, where every direction is felt, whatever the weights."""
    levers = jacobian(HOME_Q_RAD[Side.LEFT])
    found = wrench_of(levers, levers.T @ PULL, VARIANCE)
    assert found.values == pytest.approx(PULL, abs=1e-9) and found.unknown.shape == (0, 6)


def test_standard_deviations_are_those_of_noise_in_the_torques():
    """Of 4000 noisy measurements."""
    levers, rng = jacobian(HOME_Q_RAD[Side.LEFT]), np.random.default_rng(1)
    noisy = levers.T @ PULL + rng.normal(0.0, 1.0, (4000, 7)) * np.sqrt(VARIANCE)
    found = np.array([wrench_of(levers, torque, VARIANCE).values for torque in noisy])
    assert found.std(axis=0) == pytest.approx(wrench_of(levers, noisy[0], VARIANCE).sd, rel=0.08)
    assert found.mean(axis=0) == pytest.approx(PULL, abs=4.0 * found.std(axis=0).max() / 60.0)


def stretched():
    """A posture at the elbow's lower limit, where it is straight: a force along the arm turns no joint."""
    return np.array([0.3, 0.9, 0.2, 0.25, 0.1, 0.4, 0.2])


def test_a_stretched_arm_names_the_direction_that_it_does_not_feel():
    """Along the arm from shoulder to hand; its components are no numbers, those across it are."""
    q = stretched()
    levers = jacobian(q)
    shoulder_to_hand = np.array(ARM.forward(tuple(q)).p_m)
    along = shoulder_to_hand / np.linalg.norm(shoulder_to_hand)
    sizes = np.linalg.svd(levers[:3].T, compute_uv=False)
    assert sizes[-1] < LEAST_LEVER_M
    found = wrench_of(levers, levers.T @ PULL, VARIANCE)
    assert len(found.unknown) == 1 and np.linalg.norm(found.unknown[0]) == pytest.approx(1.0)
    assert abs(found.unknown[0][:3] @ along) > 0.9
    lost = np.isnan(found.values)
    assert lost.any() and (lost == np.isinf(found.sd)).all()
    assert (np.abs(along[lost[:3]]) > 0.2).all(), "only components along the arm are lost"


def test_in_every_posture_what_is_told_is_true_within_what_is_said_of_it():
    """Random postures, no noise: felt components are those of the force, up to what hides in directions that are not felt."""
    rng = np.random.default_rng(3)
    low, high = np.array(JOINT_LOWER_RAD[Side.LEFT]), np.array(JOINT_UPPER_RAD[Side.LEFT])
    for _ in range(300):
        levers = jacobian(rng.uniform(low, high))
        found = wrench_of(levers, levers.T @ PULL, VARIANCE)
        told = ~np.isnan(found.values)
        if not len(found.unknown):
            assert told.all() and found.values == pytest.approx(PULL, abs=1e-6)
        assert np.isfinite(found.sd[told]).all() and (found.sd[told] > 0.0).all()


def test_an_arm_without_levers_feels_nothing():
    """Every direction is named, and every component unknown."""
    found = wrench_of(np.zeros((6, 7)), np.ones(7), VARIANCE)
    assert np.isnan(found.values).all() and len(found.unknown) == 6
