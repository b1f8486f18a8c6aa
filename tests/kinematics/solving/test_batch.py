"""Batch: the same arm as the chain, for many configurations at once; turns and matrices are each other's inverse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.kinematics.solving.batch import ArmBatch, rotations_of, turns_of
from gateway.kinematics.solving.chain import ArmChain
from gateway.values import Side
from tests.kinematics.bodies import ARMS, nudged, samples


@pytest.mark.parametrize("side", Side)
@pytest.mark.parametrize("is_skew", [False, True])
def test_many_configurations_are_those_of_the_chain(side, is_skew):
    """Poses and Jacobians, for our numbers and for a body whose axes are askew."""
    chain = ArmChain(nudged(side, 3, rpy_rad=(0.02, -0.03, 0.01)), side) if is_skew else ARMS[side].chain
    q = list(samples(side, 50))
    many = ArmBatch(chain).forward(np.array(q))
    for index, joints in enumerate(q):
        one = chain.forward(joints)
        np.testing.assert_allclose(many.p_m[index], one.p_m, atol=1e-14)
        np.testing.assert_allclose(many.rotation[index], one.rows, atol=1e-14)
        lever = np.cross(many.axes[index], many.p_m[index] - many.points_m[index])
        np.testing.assert_allclose(np.hstack([lever, many.axes[index]]).T, chain.jacobian(joints), atol=1e-13)


@pytest.mark.parametrize("side", Side)
def test_the_outer_axes_stand_still_in_their_frames(side):
    """Joint 1's in the shoulder frame, joint 7's in the end effector's, whatever the posture."""
    batch = ArmBatch(ARMS[side].chain)
    many = batch.forward(np.array(list(samples(side, 20))))
    np.testing.assert_allclose(many.axes[:, 0], np.tile(batch.first_axis, (20, 1)), atol=1e-14)
    seen = np.einsum("nji,nj->ni", many.rotation, many.axes[:, 6])
    np.testing.assert_allclose(seen, np.tile(batch.last_axis, (20, 1)), atol=1e-14)


def test_turns_and_matrices_are_inverse():
    """From no turn at all to nearly half a turn, in all directions."""
    rng = np.random.default_rng(3)
    axes = rng.normal(size=(60, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    angles = np.concatenate([[0.0, 1e-15, 1e-10, 1e-6], rng.uniform(0.0, math.pi - 1e-3, 56)])
    turns = angles[:, None] * axes
    matrices = rotations_of(turns)
    np.testing.assert_allclose(matrices @ matrices.transpose(0, 2, 1), np.tile(np.eye(3), (60, 1, 1)), atol=1e-14)
    np.testing.assert_allclose(turns_of(matrices), turns, atol=1e-11)


def test_half_a_turn_keeps_its_size():
    """Its axis is lost in the rounding; that it is far off is not."""
    half = rotations_of(np.array([[0.0, math.pi, 0.0], [math.pi - 1e-9, 0.0, 0.0]]))
    np.testing.assert_allclose(np.linalg.norm(turns_of(half), axis=1), math.pi, atol=1e-6)
