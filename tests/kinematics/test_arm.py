"""An arm of any numbers: closed form, closed form as a beginning, or search alone; and the search as witness of the first."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from gateway.kinematics.arm import ArmModel, NotClosed
from gateway.kinematics.description import nominal
from gateway.kinematics.solving.inverse import Solution
from gateway.kinematics.solving.numeric import found_from
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side, ValueRefused
from tests.kinematics.bodies import ARMS, difference, nudged, samples
from tests.thoroughness import either


@pytest.mark.parametrize("side", list(Side))
def test_the_search_is_a_witness_of_the_closed_form(side):
    """Begun beside a configuration, damped least squares finds a solution; the closed form's is no further off."""
    arm, rng = ARMS[side], random.Random(2)
    agreed = 0
    count = either(40, 300)
    for q in samples(side, count, seed=8):
        target = arm.chain.forward(q)
        seed = [
            min(max(v + rng.uniform(-0.2, 0.2), low), high)
            for v, low, high in zip(q, arm.lower_rad, arm.upper_rad, strict=True)
        ]
        witness = found_from(arm.chain, target, seed, arm.lower_rad, arm.upper_rad)
        found = arm.inverse(target.pose, seed)
        assert isinstance(found, Solution)
        if witness.error_m < 1e-9 and witness.error_rad < 1e-9:
            agreed += 1
            assert max(difference(arm.chain.forward(witness.q_rad), target)) < 2e-9
            assert math.dist(found.q_rad, seed) <= 1.001 * math.dist(witness.q_rad, seed) + 1e-4
    assert agreed > 0.95 * count


@pytest.mark.parametrize("side", list(Side))
def test_the_search_keeps_the_limits_and_says_how_near_it_came(side):
    """A pose out of reach: it ends inside the limits, and the error it tells is the error there is."""
    arm = ARMS[side]
    home = arm.chain.forward(HOME_Q_RAD[side])
    target = home._replace(p_m=tuple(1.5 * c for c in home.p_m))
    found = found_from(arm.chain, target, HOME_Q_RAD[side], arm.lower_rad, arm.upper_rad)
    assert all(low <= q <= high for low, q, high in zip(arm.lower_rad, found.q_rad, arm.upper_rad, strict=True))
    error_m, error_rad = difference(arm.chain.forward(found.q_rad), target)
    assert (found.error_m, found.error_rad) == pytest.approx((error_m, error_rad), abs=1e-12)
    assert error_m > 0.1


@pytest.mark.parametrize("side", list(Side))
def test_an_arm_whose_axes_miss_is_solved_from_the_closed_form_on(side):
    """Axes that miss by some millimetres: solved to the same accuracy, no other than its own numbers."""
    body = nudged(side, 5, xyz_m=(0.002, 0.001, -0.003), rpy_rad=(0.004, -0.003, 0.002))
    arm = ArmModel(body, side)
    assert arm.shape.is_near and not arm.shape.is_exact
    rng, solved = random.Random(4), 0
    count = either(30, 200)
    for q in samples(side, count, seed=9):
        inner = [0.9 * (v - m) + m for v, m in zip(q, _middle(arm), strict=True)]
        target = arm.chain.forward(inner)
        found = arm.inverse(target.pose, [v + rng.uniform(-0.1, 0.1) for v in inner])
        if isinstance(found, Solution):
            solved += 1
            assert max(difference(arm.chain.forward(found.q_rad), target)) < 2e-9
    assert solved == count


def _middle(arm: ArmModel) -> list[float]:
    return [0.5 * (low + high) for low, high in zip(arm.lower_rad, arm.upper_rad, strict=True)]


def test_an_arm_of_another_kind_is_searched_and_asked_for_no_closed_form():
    """Without meeting axes there are no branches and no arm angle to tell, and the text names what does not meet."""
    arm = ArmModel(nudged(Side.LEFT, 2, rpy_rad=(1.0, 0.0, 0.0)), Side.LEFT)
    target = arm.chain.forward(HOME_Q_RAD[Side.LEFT])
    found = arm.inverse(target.pose, [v + 0.05 for v in HOME_Q_RAD[Side.LEFT]])
    assert isinstance(found, Solution)
    assert max(difference(arm.chain.forward(found.q_rad), target)) < 2e-9
    for ask in (lambda: arm.branches(target.pose, 0.0), lambda: arm.sectors(target.pose), arm.reach_m):
        with pytest.raises(NotClosed, match=r"joint \d leans"):
            ask()
    with pytest.raises(NotClosed):
        arm.arm_angle_rad(HOME_Q_RAD[Side.LEFT])


def test_a_search_that_ends_short_is_refused_with_what_is_left():
    """No proof that there is no solution, so it says how far off the best end was."""
    arm = ArmModel(nudged(Side.LEFT, 2, rpy_rad=(1.0, 0.0, 0.0)), Side.LEFT)
    target = arm.chain.forward(HOME_Q_RAD[Side.LEFT])._replace(p_m=(0.9, 0.0, 0.0))
    found = arm.inverse(target.pose, HOME_Q_RAD[Side.LEFT])
    assert not isinstance(found, Solution)
    assert float(found.value) > 0.3 and "search ended" in found.message and "axes do not meet" in found.hint


@pytest.mark.parametrize("side", list(Side))
def test_narrower_limits_are_kept(side):
    """With the description's own ranges, narrower on joints 1 and 2, every solution is inside them."""
    joints = nominal().arm(side)
    arm = ArmModel(nominal(), side, tuple(j.lower for j in joints), tuple(j.upper for j in joints))
    for q in samples(side, 200, seed=10):
        inner = tuple(min(max(v, j.lower), j.upper) for v, j in zip(q, joints, strict=True))
        found = arm.inverse(arm.forward(inner), HOME_Q_RAD[side])
        assert isinstance(found, Solution)
        assert all(j.lower <= v <= j.upper for v, j in zip(found.q_rad, joints, strict=True))


@pytest.mark.parametrize(
    ("lower", "upper", "said"),
    [
        ((0.0,) * 6, (1.0,) * 7, "lower_rad has 6 values"),
        ((0.0,) * 7, (1.0,) * 6 + (math.inf,), r"upper_rad\[6\] is inf"),
        ((0.0,) * 6 + (1.0,), (1.0,) * 7, r"joint 7 has the range \[1, 1\] rad"),
    ],
)
def test_limits_that_are_none_are_refused(lower, upper, said):
    """A range needs seven lowest angles below seven highest ones."""
    with pytest.raises(ValueRefused, match=said):
        ArmModel(nominal(), Side.LEFT, lower, upper)


@pytest.mark.parametrize("side", list(Side))
def test_dexterity_is_the_smallest_singular_value_and_falls_to_zero_in_a_singularity(side):
    """With the elbow straight no joint moves the hand along the line to the shoulder: the worst direction is that one."""
    arm = ARMS[side]
    elbow = math.atan2(0.03, 0.274) + math.atan2(0.03, 0.2755)
    q = list(HOME_Q_RAD[side])
    seen = []
    for bend in (0.5, 0.1, 0.01, 0.0):
        q[3] = math.copysign(elbow + bend, q[3])
        seen.append(arm.dexterity(q))
    assert [d.least for d in seen] == sorted((d.least for d in seen), reverse=True)
    assert seen[-1].least < 1e-9 and seen[-1].manipulability < 1e-9 and seen[-1].condition > 1e9
    line = np.array(arm.chain.forward(q).p_m)
    assert abs(np.dot(seen[-1].worst[:3], line / np.linalg.norm(line))) == pytest.approx(1.0, abs=1e-6)
    home = arm.dexterity(HOME_Q_RAD[side])
    jacobian = arm.jacobian(HOME_Q_RAD[side])
    assert home.manipulability == pytest.approx(math.sqrt(np.linalg.det(jacobian @ jacobian.T)), rel=1e-9)
    assert 0.1 < home.least < home.greatest
