"""Exciting motions stay inside limits and clear of the body, rest at their ends, and tell joints' numbers apart."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.kinematics.dynamics.excitation import DT_S, excite

LOWER, UPPER = -np.arange(1.0, 8.0) / 4.0, np.arange(1.0, 8.0) / 3.0
V_RADPS, A_RADPS2 = 0.8, 2.0


def loads(q_rad, dq_radps, ddq_radps2):
    """Weights that depend on where the arm is."""
    return 3.0 * np.cos(q_rad) + 0.1 * ddq_radps2


def test_a_motion_stays_inside_its_limits_and_rests_at_both_ends():
    """Positions, speeds; and it moves every joint by a good part of its range or as fast as it may."""
    found = excite(LOWER, UPPER, V_RADPS, A_RADPS2, loads, lambda q: True)
    q, dq = found.q_rad, np.gradient(found.q_rad, DT_S, axis=0)
    assert (q > LOWER).all() and (q < UPPER).all() and np.abs(dq).max() <= V_RADPS
    assert np.abs(dq[[0, -1]]).max() < 1e-3 and q[0] == pytest.approx(q[-1])
    ddq = np.gradient(dq, DT_S, axis=0)
    wide, fast = np.ptp(q, axis=0) > 0.3 * (UPPER - LOWER), np.abs(dq).max(axis=0) > 0.7 * V_RADPS
    hard = np.abs(ddq).max(axis=0) > 0.7 * A_RADPS2
    assert (wide | fast | hard).all() and np.abs(ddq).max() <= A_RADPS2 and found.condition < 10.0


def test_the_same_seed_draws_the_same_motion():
    """Whoever swings an arm may look at it before."""
    first, again = (excite(LOWER, UPPER, V_RADPS, A_RADPS2, loads, lambda q: True) for _ in range(2))
    assert (first.q_rad == again.q_rad).all() and first.condition == again.condition


def test_what_comes_too_near_is_not_taken():
    """The motion is less wide where it must be, and none where nothing is clear."""
    found = excite(LOWER, UPPER, V_RADPS, A_RADPS2, loads, lambda q: q[0] < 0.15)
    assert found.q_rad[::10, 0].max() < 0.15
    assert excite(LOWER, UPPER, V_RADPS, A_RADPS2, loads, lambda q: False) is None
