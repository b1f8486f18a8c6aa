"""Parameters: their Jacobian is the derivative, their correction is what they compute, and none is there twice."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.kinematics.correction import corrected
from gateway.kinematics.description import nominal
from gateway.kinematics.identification.parameters import LENGTH_M, Group, Parameters
from gateway.kinematics.solving.batch import turns_of
from gateway.kinematics.solving.chain import ArmChain
from gateway.values import Side
from tests.kinematics.bodies import ARMS, nudged, samples

CHOICES = [
    frozenset({Group.JOINTS}),
    frozenset({Group.JOINTS, Group.EE}),
    frozenset({Group.JOINTS, Group.EE, Group.SHOULDER}),
    frozenset({Group.EE}),
]
WHOLE = frozenset({Group.JOINTS, Group.EE, Group.SHOULDER})


@pytest.mark.parametrize("groups", CHOICES)
@pytest.mark.parametrize("side", Side)
def test_the_jacobian_is_the_derivative(side, groups):
    """By central differences at zero, for every parameter."""
    parameters = Parameters(ARMS[side].chain, groups)
    q = np.array(list(samples(side, 20)))
    zero, step = np.zeros(len(parameters.names)), 1e-6
    found = parameters.jacobian(parameters.forward(zero, q))
    assert found.shape == (20, 6, len(parameters.names)) == (20, 6, len(parameters.units))
    for index in range(len(parameters.names)):
        nudge = np.eye(len(parameters.names))[index] * step
        after, before = parameters.forward(zero + nudge, q), parameters.forward(zero - nudge, q)
        way = (after.p_m - before.p_m) / (2 * step * LENGTH_M)
        turn = turns_of(after.rotation @ before.rotation.transpose(0, 2, 1)) / (2 * step)
        np.testing.assert_allclose(found[:, :, index], np.hstack([way, turn]), atol=1e-8)


@pytest.mark.parametrize("side", Side)
def test_a_vector_and_its_correction_are_the_same_arm(side):
    """What the fit computes is what the corrected description computes."""
    parameters = Parameters(ARMS[side].chain, WHOLE)
    vector = 0.02 * np.random.default_rng(1).normal(size=len(parameters.names))
    q = np.array(list(samples(side, 20)))
    many = parameters.forward(vector, q)
    arm = ArmChain(corrected(nominal(), side, parameters.correction(vector)), side)
    for index, joints in enumerate(q.tolist()):
        one = arm.forward(joints)
        np.testing.assert_allclose(many.p_m[index], one.p_m, atol=1e-7)
        np.testing.assert_allclose(many.rotation[index], one.rows, atol=1e-7)


def test_the_lag_moves_the_arm_by_its_velocity():
    """Its column is the derivative, too; without velocities it is nil."""
    parameters = Parameters(ARMS[Side.LEFT].chain, frozenset({Group.JOINTS, Group.LAG}))
    q = np.array(list(samples(Side.LEFT, 20)))
    dq = np.random.default_rng(2).normal(size=q.shape)
    zero, late = np.zeros(8), np.eye(8)[7] * 1e-6
    after, before = parameters.forward(zero + late, q, dq), parameters.forward(zero - late, q, dq)
    column = parameters.jacobian(parameters.forward(zero, q, dq), dq)[:, :, 7]
    np.testing.assert_allclose(column[:, :3], (after.p_m - before.p_m) / (2e-6 * LENGTH_M), atol=1e-7)
    turn = turns_of(after.rotation @ before.rotation.transpose(0, 2, 1)) / 2e-6
    np.testing.assert_allclose(column[:, 3:], turn, atol=1e-7)
    assert not parameters.jacobian(parameters.forward(zero, q))[:, :, 7].any() and parameters.units[7] == "s"


def test_lengths_are_in_metres_outside():
    """An element of 1 of the vector is 0.3 m of the end effector; the names say which."""
    parameters = Parameters(ARMS[Side.LEFT].chain, frozenset({Group.EE}))
    assert parameters.names == ("ee x", "ee y", "ee z", "ee turn about x", "ee turn about y")
    assert parameters.units == ("m", "m", "m", "rad", "rad")
    assert parameters.correction(np.array([0.01, 0, 0, 0, 0])).ee.p_m == pytest.approx((0.003, 0.0, 0.0))


@pytest.mark.parametrize("body", [None, nudged(Side.LEFT, 7, rpy_rad=(0.2, 0.3, 0.0))])
def test_turns_about_the_outer_joints_belong_to_the_joints(body):
    """Nobody could tell them apart: the end effector has none about joint 7's axis, the shoulder none about joint 1's."""
    chain = ARMS[Side.LEFT].chain if body is None else ArmChain(body, Side.LEFT)
    parameters = Parameters(chain, WHOLE)
    for index, unit in enumerate(parameters.units):
        if unit == "rad" and index >= 7:
            vector = 0.1 * np.eye(len(parameters.units))[index]
            correction = parameters.correction(vector)
            is_ee = parameters.names[index].startswith("ee")
            axis = parameters.batch.last_axis if is_ee else parameters.batch.first_axis
            turn = turns_of(np.array((correction.ee if is_ee else correction.shoulder).rows))
            assert abs(turn @ axis) < 1e-12 and np.linalg.norm(turn) == pytest.approx(0.1)
