"""Correction: what an offset and a displaced frame mean, and that a corrected body is solved like any other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.kinematics.arm import ArmModel
from gateway.kinematics.correction import NOWHERE, ArmCorrection, corrected
from gateway.kinematics.description import nominal
from gateway.kinematics.placement import Placement, rows_from_rpy
from gateway.kinematics.solving.chain import ArmChain
from gateway.kinematics.solving.inverse import Solution
from gateway.values import Side, ValueRefused
from tests.kinematics.bodies import ARMS, difference, samples

OFFSETS = (0.012, -0.02, 0.015, 0.008, -0.011, 0.02, -0.014)
EE = Placement((0.002, -0.001, 0.003), rows_from_rpy((0.01, -0.02, 0.0)))
SHOULDER = Placement((-0.001, 0.002, 0.001), rows_from_rpy((0.005, 0.0, -0.004)))
WHOLE = ArmCorrection(offsets_rad=OFFSETS, ee=EE, shoulder=SHOULDER)


@pytest.mark.parametrize("side", Side)
def test_a_corrected_body_takes_what_the_robot_reports(side):
    """In the order shoulder · chain(q + offsets) · ee; the other arm is what it was."""
    body = corrected(nominal(), side, WHOLE)
    arm, other = ArmChain(body, side), next(one for one in Side if one is not side)
    for q in samples(side, 30):
        told = SHOULDER.after(ARMS[side].chain.forward([a + b for a, b in zip(q, OFFSETS, strict=True)])).after(EE)
        assert max(difference(arm.forward(q), told)) < 1e-7
    assert ArmChain(body, other).lines == ARMS[other].chain.lines


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("side", Side)
def test_each_joints_zero_is_its_own(side, joint):
    """An offset of one joint is a turn of that joint, for origins that stand at quarter turns, too."""
    offsets = tuple(0.3 if index == joint else 0.0 for index in range(7))
    arm = ArmChain(corrected(nominal(), side, ArmCorrection(offsets_rad=offsets)), side)
    for q in samples(side, 5):
        wanted = ARMS[side].chain.forward([a + b for a, b in zip(q, offsets, strict=True)])
        assert max(difference(arm.forward(q), wanted)) < 1e-7


def test_a_body_that_was_corrected_twice_still_knows_what_was_described():
    """The hull is given for that."""
    once = corrected(nominal(), Side.LEFT, WHOLE)
    assert once.described is nominal() is corrected(once, Side.LEFT, WHOLE).described and nominal().described is None


def test_no_correction_changes_nothing():
    """Not even the rounding."""
    none = ArmCorrection(offsets_rad=(0.0,) * 7)
    assert none.ee == none.shoulder == NOWHERE
    assert corrected(nominal(), Side.LEFT, none).joints == nominal().joints


@pytest.mark.parametrize("side", Side)
def test_a_corrected_arm_is_solved_exactly(side):
    """Its axes still meet, but not at right angles at zero: the search from the closed form's answer ends on the pose."""
    arm = ArmModel(corrected(nominal(), side, WHOLE), side)
    for q in samples(side, 10, seed=4):
        inside = tuple(0.9 * a + 0.1 * 0.5 * (b + c) for a, b, c in zip(q, arm.lower_rad, arm.upper_rad, strict=True))
        found = arm.inverse(arm.forward(inside), inside)
        assert isinstance(found, Solution)
        assert max(difference(arm.chain.forward(found.q_rad), arm.chain.forward(inside))) < 1e-8


@pytest.mark.parametrize("offsets", [(0.0,) * 6, (math.nan,) * 7])
def test_offsets_are_seven_finite_numbers(offsets):
    """Nothing else is a correction."""
    with pytest.raises(ValueRefused, match="joint_zero_offsets"):
        ArmCorrection(offsets_rad=offsets)


def test_the_frames_are_placements():
    """Rows of a rotation: what is written to a file can be read as a quaternion."""
    np.testing.assert_allclose(np.linalg.det(np.array(WHOLE.ee.rows)), 1.0, atol=1e-12)
