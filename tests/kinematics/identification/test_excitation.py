"""Excitation: what cannot be told apart is named, no number of samples hides it, and the advice helps whoever follows it."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.kinematics.identification.excitation import LEAST_GAIN, distinct, excitation_of
from gateway.kinematics.identification.parameters import Group, Parameters
from gateway.values import Side
from tests.kinematics.bodies import ARMS
from tests.kinematics.identities import postures

USUAL = frozenset({Group.JOINTS, Group.EE})
WHOLE = frozenset({Group.JOINTS, Group.EE, Group.SHOULDER})


def known(side, q, groups=USUAL):
    """Return what postures tell."""
    arm = ARMS[side]
    return excitation_of(Parameters(arm.chain, groups), q, np.array(arm.lower_rad), np.array(arm.upper_rad))


@pytest.mark.parametrize("groups", [USUAL, WHOLE])
@pytest.mark.parametrize("side", Side)
def test_all_joints_through_most_of_their_range_are_enough(side, groups):
    """Nothing is blurred, nothing advised, one gain for each parameter, the largest first."""
    found = known(side, postures(side, 400), groups)
    assert found.is_enough and found.gain > 2 * LEAST_GAIN and not found.blurred and not found.advice
    assert len(found.singular_values) == (17 if groups == WHOLE else 12)
    assert list(found.singular_values) == sorted(found.singular_values, reverse=True)
    assert all(high - low > 1.0 for low, high in found.moved_rad)


@pytest.mark.parametrize(
    ("joint", "groups", "names"),
    [
        (7, USUAL, {"joint 6 zero", "ee turn about x", "ee turn about y"}),
        (1, WHOLE, {"joint 2 zero", "shoulder turn about x", "shoulder turn about z"}),
    ],
)
@pytest.mark.parametrize("side", Side)
def test_a_joint_that_stands_still_blurs_its_neighbours(side, joint, groups, names):
    """With joint 7 still a turn of the hand is one of joint 6; with joint 1 still one of the shoulder is one of joint 2."""
    q = postures(side, 400)
    q[:, joint - 1] = 0.1
    found = known(side, q, groups)
    assert not found.is_enough and found.gain < 1e-6
    assert len(found.blurred) == 1 and set(found.blurred[0]) <= names and len(found.blurred[0]) >= 2
    assert found.advice[0].joint == joint


@pytest.mark.parametrize("moving", [(), (1,), (4,), (7,), (2, 4, 6), (1, 2, 3)])
@pytest.mark.parametrize("side", Side)
def test_the_advice_helps(side, moving):
    """Whoever moves the joints that are named, where they are named, has enough."""
    q = np.tile(postures(side, 400)[:1], (400, 1))
    for joint in moving:
        q[:, joint - 1] = postures(side, 400)[:, joint - 1]
    found = known(side, q)
    assert not found.is_enough and found.advice
    rng = np.random.default_rng(5)
    for row in found.advice:
        arm = ARMS[side]
        assert arm.lower_rad[row.joint - 1] <= row.lower_rad < row.upper_rad <= arm.upper_rad[row.joint - 1]
        q[:, row.joint - 1] = rng.uniform(row.lower_rad, row.upper_rad, 400)
    assert known(side, q).is_enough


def test_many_samples_are_no_excitation():
    """A tremble of a milliradian stays one, however often it is seen."""
    still = np.tile(postures(Side.LEFT, 10)[:1], (5000, 1))
    trembling = still + 1e-3 * np.random.default_rng(0).normal(size=still.shape)
    few, many = known(Side.LEFT, trembling[:100]), known(Side.LEFT, trembling)
    assert many.gain == pytest.approx(few.gain, rel=0.3) and many.gain < 0.1 * LEAST_GAIN


def test_a_posture_counts_once():
    """Only what differs by 10 mrad in some joint from the one before; the first always."""
    q = np.zeros((6, 7))
    q[2:, 3], q[4:, 6] = 0.009, 0.02
    assert distinct(q).tolist() == [0, 4]
    assert distinct(np.zeros((0, 7))).tolist() == []


def test_a_larger_range_tells_more():
    """The gain grows with the share of the range that is moved through."""
    gains = [known(Side.RIGHT, postures(Side.RIGHT, 300, share=share)).gain for share in (0.1, 0.3, 0.6, 0.9)]
    assert gains == sorted(gains) and gains[0] < LEAST_GAIN < gains[-1]
