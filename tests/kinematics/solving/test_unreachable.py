"""Refusals: how far a pose is out of reach, and why."""

from __future__ import annotations

import math

import pytest

from gateway.errors import Code
from gateway.kinematics.arm import ArmModel
from gateway.kinematics.description import nominal
from gateway.kinematics.placement import Placement, rows_from_rpy
from gateway.kinematics.solving.inverse import Solution
from gateway.robot.limits import HOME_Q_RAD, MAX_ARM_LEN_M
from gateway.values import Side
from tests.kinematics.bodies import ARMS, excess, samples


@pytest.mark.parametrize("side", list(Side))
def test_the_reach_is_the_manuals(side):
    """Within 3 mm of `max_arm_len` (§4.0.4); the elbow's limit keeps the hand 0.30 m away from the shoulder."""
    near, far = ARMS[side].reach_m()
    assert far == pytest.approx(MAX_ARM_LEN_M, abs=0.003)
    assert near == pytest.approx(0.3027, abs=1e-4)
    lengths = [math.hypot(*ARMS[side].chain.forward(q).p_m) for q in samples(side, 2000)]
    assert near <= min(lengths) and max(lengths) <= far


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize(("factor", "word"), [(1.2, "too far"), (0.3, "too near")])
def test_a_wrist_out_of_reach_is_told_by_how_much(side, factor, word):
    """Moved back by the excess, the wrist is within reach again."""
    arm, home = ARMS[side], ARMS[side].chain.forward(HOME_Q_RAD[side])
    length = math.hypot(*home.p_m)
    bound = arm.reach_m()[factor > 1.0]
    pose = Placement(tuple(c * factor * bound / length for c in home.p_m), home.rows).pose
    found = arm.inverse(pose, HOME_Q_RAD[side])
    assert found.code is Code.OUT_OF_RANGE and found.unit == "m"
    assert excess(found) == pytest.approx(abs(factor - 1.0) * bound, abs=2e-6)
    assert word in found.message and f"{1e3 * excess(found):.1f} mm" in found.message
    assert f"{bound:.4f}" in found.message and found.hint


@pytest.mark.parametrize("side", list(Side))
def test_a_hand_turned_too_far_is_told_which_joint_and_by_how_much(side):
    """Home with the hand turned back: within reach, and a joint is beyond its limit at every arm angle. Less is enough."""
    arm, home = ARMS[side], ARMS[side].chain.forward(HOME_Q_RAD[side])
    turned = home.after(Placement((0.0, 0.0, 0.0), rows_from_rpy((0.0, 0.0, 2.5))))
    found = arm.inverse(turned.pose, HOME_Q_RAD[side])
    assert found.code is Code.OUT_OF_RANGE and found.unit == "rad"
    assert found.field.startswith(f"{side.value[0]}_joint") and found.field in found.message
    # With limits widened by what is said to be missing there is a solution, with less there is none.
    wider = [ArmModel(nominal(), side, *_widened(arm, by)) for by in (excess(found) + 1e-4, excess(found) - 1e-3)]
    assert isinstance(wider[0].inverse(turned.pose, HOME_Q_RAD[side]), Solution)
    assert not isinstance(wider[1].inverse(turned.pose, HOME_Q_RAD[side]), Solution)


def _widened(arm, by: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    return tuple(v - by for v in arm.lower_rad), tuple(v + by for v in arm.upper_rad)
