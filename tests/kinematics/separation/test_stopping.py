"""How far a stop goes, against the brakes that the motions really use."""

from __future__ import annotations

import random

import pytest

from gateway.core.motion.joints.braking import advance, duration, ramp
from gateway.kinematics.separation.stopping import STAYS, stop_extent, way_extent
from tests.thoroughness import either


def test_a_stop_goes_as_far_as_the_brakes_of_a_motion():
    """Random velocities and accelerations, limits of the whole range, against the brake's own course in small steps."""
    rng, turned = random.Random(1), 0
    for _ in range(either(300, 3000)):
        a_max, j_max = rng.uniform(0.1, 15.0), rng.uniform(1.0, 300.0)
        v, a = rng.uniform(-3.0, 3.0) * rng.random(), rng.uniform(-a_max, a_max)
        course = ramp(v, a, 0.0, a_max, j_max)
        time_s = duration(course)
        row = [advance(0.0, v, a, course, time_s * n / 400)[0] for n in range(401)]
        low, high = stop_extent(v, a, a_max, j_max)
        size = max(high, -low)
        assert low == pytest.approx(min(row), abs=1e-4 * size + 1e-12) and low <= min(row) + 1e-12
        assert high == pytest.approx(max(row), abs=1e-4 * size + 1e-12) and high >= max(row) - 1e-12
        turned += low < 0.0 < high
    assert turned, "none turned round on its way"


def test_at_rest_it_stays():
    """No velocity, no acceleration: nothing."""
    assert stop_extent(0.0, 0.0, 3.0, 20.0) is STAYS


def test_a_joint_that_accelerates_back_turns_round():
    """Forth at 0.01 rad/s but accelerating back hard: it goes a little forth, then back, and stands there."""
    low, high = stop_extent(0.01, -2.0, 3.0, 20.0)
    assert 0.0 < high < 0.001 and low < -0.01


def test_a_way_reaches_over_all_its_positions_and_the_stop():
    """From 1.0 through 1.2 and 1.1, with a stop of 0.05 back and 0.02 forth; never less than where it began."""
    assert way_extent(1.0, (1.2, 1.1), (-0.05, 0.02)) == pytest.approx((0.0, 0.2))
    assert way_extent(1.0, (1.2,), (0.0, 0.3)) == pytest.approx((0.0, 0.5))
    assert way_extent(1.0, (0.9,), (-0.3, 0.0)) == pytest.approx((-0.4, 0.0))
