"""Robust least squares: exact on exact data, deaf to gross errors, and honest about how sure it is."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.kinematics.identification.parameters import Group, Parameters
from gateway.kinematics.identification.robust import Measured, fitted, residuals
from gateway.kinematics.placement import rows_from_quat
from gateway.kinematics.solving.batch import rotations_of
from gateway.values import Side
from tests.kinematics.bodies import ARMS
from tests.kinematics.identities import EE_M, EE_TURN_RAD, OFFSETS_RAD, measured, postures
from tests.thoroughness import either

GROUPS = frozenset({Group.JOINTS, Group.EE})
TRUTH = np.concatenate([OFFSETS_RAD, EE_M, EE_TURN_RAD[:2]])


def arrays(pairs):
    """Return pairs as the fit takes them."""
    return Measured(
        np.array([pair.q_rad for pair in pairs]),
        np.array([pair.pose.p_m for pair in pairs]),
        np.array([rows_from_quat(pair.pose.quat_xyzw) for pair in pairs]),
    )


def found(side, data):
    """Return values and standard deviations in radians and metres, and the fit."""
    parameters = Parameters(ARMS[side].chain, GROUPS)
    fit = fitted(parameters, data)
    return fit.vector * parameters.scales, np.sqrt(np.diag(fit.covariance)) * parameters.scales, fit


@pytest.mark.parametrize("factor", [1.0, 12.0])
@pytest.mark.parametrize("side", Side)
def test_without_noise_the_offsets_come_back(side, factor):
    """From the witness's geometry, to rounding; offsets of 0.2 rad, too, at which nothing is linear any more."""
    pairs = measured(side, postures(side, 300), offsets=factor * OFFSETS_RAD, noise=0.0)
    values, _, fit = found(side, arrays(pairs))
    wanted = np.concatenate([factor * OFFSETS_RAD, EE_M, EE_TURN_RAD[:2]])
    np.testing.assert_allclose(values, wanted, atol=1e-9)
    parameters = Parameters(ARMS[side].chain, GROUPS)
    assert np.abs(residuals(parameters, fit.vector, arrays(pairs))).max() < 1e-9


@pytest.mark.parametrize("share", [0.1, 0.25])
def test_gross_errors_have_no_say(share):
    """Poses of another time, a stuck pose, a jump: they get no weight, and the answer is that of the others."""
    side = Side.LEFT
    data = arrays(measured(side, postures(side, 1200)))
    rng = np.random.default_rng(8)
    bad = rng.choice(1200, round(1200 * share), replace=False)
    p, rotation = data.p_m.copy(), data.rotation.copy()
    p[bad] += rng.uniform(-0.2, 0.3, (len(bad), 3))
    rotation[bad] = rotations_of(rng.normal(size=(len(bad), 3))) @ rotation[bad]
    values, sigmas, fit = found(side, Measured(data.q_rad, p, rotation))
    assert np.all(np.abs(values - TRUTH) < 5 * sigmas) and np.abs(values - TRUTH).max() < 0.3e-3
    assert np.count_nonzero(fit.weights[bad]) <= 0.02 * len(bad)
    assert np.count_nonzero(fit.weights) > 0.98 * (1200 - len(bad))


def test_the_standard_deviation_is_what_it_says():
    """Over many repetitions of the noise: errors divided by it are about 1 in the mean square, none beyond 6."""
    side, count = Side.RIGHT, either(8, 30)
    q = postures(side, 400)
    pulls = []
    for seed in range(count):
        values, sigmas, _ = found(side, arrays(measured(side, q, seed=seed)))
        pulls.append((values - TRUTH) / sigmas)
    assert 0.5 < np.sqrt(np.mean(np.square(pulls))) < 1.4 and np.abs(pulls).max() < 6.0


def test_errors_that_repeat_do_not_make_it_surer():
    """The same noise ten times in a row is one measurement, not ten: the standard deviation knows it from the blocks."""
    side = Side.LEFT
    q = postures(side, 200)
    once = measured(side, q, seed=3)
    _, alone, _ = found(side, arrays(once))
    _, repeated, _ = found(side, arrays([pair for pair in once for _ in range(10)]))
    assert np.median(repeated / alone) > 0.6


def test_times_that_nobody_knows_cost_little():
    """3 ms of scatter in the times of a moving arm are 3 mrad in a pose; across the motion nothing is lost by them.

    Without the lag among the parameters they cost all directions alike. The sigma stays what it says.
    """
    side, count = Side.LEFT, 1500
    q = postures(side, count)
    dq = np.gradient(q, 0.02, axis=0)
    jitter_s = 3e-3 * np.random.default_rng(4).normal(size=count)
    known, unknown = (arrays(measured(side, q, lag_s=lag_s))._replace(dq_radps=dq) for lag_s in (0.0, jitter_s))
    timed = Parameters(ARMS[side].chain, GROUPS | {Group.LAG})
    best, fit = fitted(timed, known), fitted(timed, unknown)
    _, blind, _ = found(side, unknown)
    sigma = np.sqrt(np.diag(fit.covariance))[:-1] * timed.scales[:-1]
    assert np.median(sigma / np.sqrt(np.diag(best.covariance))[:-1] / timed.scales[:-1]) < 1.6
    assert np.median(blind / sigma) > 2.0
    errors = fit.vector[:-1] * timed.scales[:-1] - TRUTH
    assert np.all(np.abs(errors) < 5 * sigma) and np.abs(errors).max() < 0.2e-3


def test_noise_that_is_not_the_same_in_position_and_angle_is_weighed():
    """Scatter is found apart for both: bad angles do not spoil the lengths."""
    side = Side.LEFT
    data = arrays(measured(side, postures(side, 600), noise=0.0))
    rng = np.random.default_rng(2)
    p = data.p_m + 1e-5 * rng.normal(size=data.p_m.shape)
    rotation = rotations_of(5e-3 * rng.normal(size=data.p_m.shape)) @ data.rotation
    values, sigmas, _ = found(side, Measured(data.q_rad, p, rotation))
    assert np.all(np.abs(values - TRUTH) < 5 * sigmas)
    assert np.abs(values - TRUTH)[7:10].max() < 2e-5
