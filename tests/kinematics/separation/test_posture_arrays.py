"""The body in arrays: against the same in plain floats."""

from __future__ import annotations

import random

import numpy as np
import pytest

from gateway.kinematics.collision import CollisionModel
from gateway.kinematics.separation.posture_arrays import JOINTS, Parts
from gateway.values import Side
from tests.kinematics.guarded_arms import OWN, calibrated, model, random_joints, really


def test_lines_of_parts_and_joints_are_those_of_the_posture():
    """Several postures at once: begins, ways to the ends, squares of the lengths; axes and their moments about the origin."""
    rng, parts = random.Random(8), Parts(model())
    q_rads = [random_joints(rng) for _ in range(20)]
    arrays = parts.stand(q_rads)
    assert arrays.pieces.shape == (20, 2, 5, parts.count) and arrays.lines.shape == (20, 6, JOINTS)
    assert (arrays.pieces[:, :, 3:] == arrays.pieces[:, :, :2]).all()
    for n, q_rad in enumerate(q_rads):
        posture = model().posture(q_rad)
        segments = np.array(posture.segments)
        assert arrays.pieces[n, :, :3].reshape(6, -1).T == pytest.approx(segments[:, :6], abs=1e-12)
        assert parts.square_m2 == pytest.approx(segments[:, 6], abs=1e-12)
        lines = np.array([posture.lines[side] for side in Side]).reshape(JOINTS, 6)
        assert arrays.lines[n, :3].T == pytest.approx(lines[:, 3:], abs=1e-12)
        assert arrays.lines[n, 3:].T == pytest.approx(np.cross(lines[:, :3], lines[:, 3:]), abs=1e-12)


def test_the_lines_of_a_calibrated_body_are_those_of_its_real_joints():
    """Parts as well as axes; how far a part reaches does not depend on where its joints' zeros are."""
    rng, own, plain = random.Random(9), Parts(CollisionModel(calibrated(OWN))), Parts(model())
    q_rads = [random_joints(rng) for _ in range(20)]
    arrays, real = own.stand(q_rads), plain.stand([really(q_rad) for q_rad in q_rads])
    assert arrays.pieces == pytest.approx(real.pieces, abs=1e-9) and arrays.lines == pytest.approx(real.lines, abs=1e-9)
    assert own.reach_m == pytest.approx(plain.reach_m, abs=1e-9)


def test_pairs_of_two_moving_parts_come_first():
    """Those whose second part nothing moves have no row for it."""
    parts = Parts(model())
    moves = parts.second < parts.moving
    assert moves.any() and not moves.all() and (np.diff(moves.astype(int)) <= 0).all()
    assert (parts.first < parts.moving).all() and len(moves) == len(model().pairs)
