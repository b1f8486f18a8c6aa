"""Correction: what an offset and a displaced frame mean, and that a corrected body is solved like any other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.kinematics.arm import ArmModel
from gateway.kinematics.correction import NOWHERE, ArmCorrection, built_in, corrected
from gateway.kinematics.description import nominal
from gateway.kinematics.placement import Placement, rows_from_rpy
from gateway.kinematics.solving.chain import ArmChain
from gateway.kinematics.solving.inverse import Solution
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side, ValueRefused
from tests.changed import replace
from tests.kinematics.bodies import ARMS, difference, excess, samples
from tests.thoroughness import either

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
    """Whatever pose its joints take inside their limits, at a limit, too: it is found, inside the limits, from home on."""
    arm = ArmModel(corrected(nominal(), side, WHOLE), side)
    assert arm.shape.is_exact
    for number, q in enumerate(samples(side, either(200, 5000), seed=4)):
        ends = (arm.lower_rad, arm.upper_rad)
        taken = tuple(ends[(number >> n) % 2][n] if (number * 7 + n) % 3 == 0 else v for n, v in enumerate(q))
        found = arm.solution(arm.forward(taken), HOME_Q_RAD[side])
        assert isinstance(found, Solution)
        assert max(difference(arm.chain.forward(found.q_rad), arm.chain.forward(taken))) < 1e-8
        assert all(low <= v <= high for low, v, high in zip(arm.lower_rad, found.q_rad, arm.upper_rad, strict=True))
        assert arm.bend(taken).swivel(arm.chain.forward(taken)).at(arm.arm_angle_rad(taken)) == pytest.approx(
            taken, abs=1e-6
        )


@pytest.mark.parametrize("side", Side)
def test_a_pose_that_a_corrected_arm_cannot_take_is_refused_without_a_search(side, monkeypatch):
    """A search takes milliseconds of the control loop; the closed form names the joint that it reports, and its limit."""
    monkeypatch.setattr("gateway.kinematics.arm.found_from", None)
    arm, home = ArmModel(corrected(nominal(), side, WHOLE), side), HOME_Q_RAD[side]
    far = replace(arm.forward(home), p_m=(2.0, 0.0, 0.0))
    assert arm.solution(far, home) is None and arm.inverse(far, home).unit == "m"
    out = tuple(high + 0.3 if n == 6 else q for n, (q, high) in enumerate(zip(home, arm.upper_rad, strict=True)))
    turned = ArmModel(
        corrected(nominal(), side, WHOLE), side, tuple(q - 0.01 for q in home), tuple(q + 0.01 for q in home)
    )
    refusal = turned.inverse(arm.forward(out), home)
    assert turned.solution(arm.forward(out), home) is None and refusal.unit == "rad" and excess(refusal) > 0.0


@pytest.mark.parametrize("side", Side)
def test_what_was_built_in_can_be_told_again(side):
    """Once, or once more: offsets add up; the other arm has nothing."""
    once = corrected(nominal(), side, WHOLE)
    twice = built_in(corrected(once, side, ArmCorrection(offsets_rad=OFFSETS)), side)
    for found, wanted in (
        (built_in(once, side), WHOLE),
        (twice, replace(WHOLE, offsets_rad=tuple(2 * o for o in OFFSETS))),
    ):
        assert found.offsets_rad == pytest.approx(wanted.offsets_rad, abs=1e-12)
        assert max(*difference(found.ee, EE), *difference(found.shoulder, SHOULDER)) < 1e-12
    assert built_in(once, next(one for one in Side if one is not side)).offsets_rad == pytest.approx(
        (0.0,) * 7, abs=1e-12
    )


@pytest.mark.parametrize("offsets", [(0.0,) * 6, (math.nan,) * 7])
def test_offsets_are_seven_finite_numbers(offsets):
    """Nothing else is a correction."""
    with pytest.raises(ValueRefused, match="joint_zero_offsets"):
        ArmCorrection(offsets_rad=offsets)


def test_the_frames_are_placements():
    """Rows of a rotation: what is written to a file can be read as a quaternion."""
    np.testing.assert_allclose(np.linalg.det(np.array(WHOLE.ee.rows)), 1.0, atol=1e-12)
