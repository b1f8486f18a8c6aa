"""Speeds of joints for a motion of the end effector: the shortest that give it, bounded in singularities."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from gateway.kinematics.solving.dexterity import FLOOR, LENGTH_M, dexterity, joint_speeds
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import Side
from tests.kinematics.bodies import ARMS

UNITS = np.array([LENGTH_M] * 3 + [1.0] * 3)
SINGULAR = (0.9, 0.0, 0.0, -0.6, -0.7, 0.5, -0.2)
"""Inside the limits: with joints 2 and 3 of the right arm at zero the hand cannot go straight out to the side."""
STRAIGHT_RAD = -0.2175
"""Joint 4 of the right arm where elbow and wrist are in line with the shoulder."""


@pytest.mark.parametrize("side", Side)
def test_away_from_singularities_they_are_the_shortest_that_do_it(side):
    """The motion asked for, by the pseudo-inverse of numpy, to rounding."""
    rng, told = np.random.default_rng(1), 0
    low, high = np.array(JOINT_LOWER_RAD[side]), np.array(JOINT_UPPER_RAD[side])
    for _ in range(200):
        jacobian = ARMS[side].jacobian((low + rng.random(7) * (high - low)).tolist())
        rates = tuple(rng.normal(size=6).tolist())
        if dexterity(jacobian).least > FLOOR:
            told += 1
            dq = joint_speeds(jacobian, rates)
            assert jacobian @ dq == pytest.approx(rates, abs=1e-9)
            assert dq == pytest.approx(np.linalg.pinv(jacobian) @ rates, abs=1e-9)
    assert told > 150


def test_in_a_singularity_they_are_bounded_and_not_nil():
    """Along the direction that is lost: as if its singular value were the floor; in the others as ever."""
    jacobian = ARMS[Side.RIGHT].jacobian(SINGULAR)
    worst = np.array(dexterity(jacobian).worst) * UNITS
    assert np.linalg.norm(joint_speeds(jacobian, tuple(worst))) == pytest.approx(1.0 / FLOOR)
    rng = np.random.default_rng(2)
    for _ in range(50):
        rates = rng.normal(size=6)
        assert np.linalg.norm(joint_speeds(jacobian, tuple(rates))) <= np.linalg.norm(rates / UNITS) / FLOOR + 1e-9


def test_they_grow_steadily_on_the_way_into_a_singularity():
    """A straight elbow, drawn in along the arm: never less than a little further away, as damping would have it."""
    home = HOME_Q_RAD[Side.RIGHT]
    speeds = []
    for bend in np.linspace(-1.2, STRAIGHT_RAD - 1e-6, 60):
        q = (0.3, -1.0, 0.2, float(bend), *home[4:])
        jacobian = ARMS[Side.RIGHT].jacobian(q)
        p = np.array(ARMS[Side.RIGHT].forward(q).p_m)
        inward = (*(-0.1 * p / np.linalg.norm(p)).tolist(), 0.0, 0.0, 0.0)
        speeds.append(float(np.linalg.norm(joint_speeds(jacobian, inward))))
    assert all(b > 0.98 * a for a, b in pairwise(speeds)) and speeds[-1] > 3.0 * speeds[0]
