"""Robust least squares: the parameters that explain measured poses, with measurements that are plainly wrong left out.

Levenberg-Marquardt on residuals that are divided by their own scatter, position and angle apart, with weights by how far a
measurement is off as a whole: Huber's first, which lets everybody have a say, then Tukey's, which ends that of the worst.
(Huber, Robust Statistics, 1981; Beaton and Tukey, 1974; scatter by the median of absolute residuals.)

When an arm moves, a pose whose time is known to a millisecond or two is off by that along the motion, and in no other
direction. So where the lag is a parameter a residual has another scatter along the velocity of the end effector than across
it: the faster the arm, the less the one direction of six says, and the other five say what they said before.

The covariance is the larger, parameter by parameter, of two: from the scatter alone, and from blocks of measurements that
follow each other in time, whose errors need not be independent (sandwich of clusters).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.kinematics.identification.parameters import LENGTH_M, Group, Parameters
from gateway.kinematics.solving.batch import turns_of

__all__ = ["Fit", "Measured", "fitted", "residuals"]

Array = NDArray[np.float64]

HUBER = 4.0
"""In units of the scatter, for six residuals together: their usual length is 2.4."""
TUKEY = 8.0
"""From here on a measurement has no say."""
HUBER_STEPS = 10
NEARLY = 1e-6
"""A step shorter than this ends the first part [rad, LENGTH_M]."""
MOST_STEPS = 80
CLOSE = 1e-11
"""A step shorter than this ends the search [rad, LENGTH_M]."""
LEAST_SCATTER = 5e-5
"""Measurements are not trusted further than this [rad, LENGTH_M]: many may be exact by chance, as those of an arm at rest."""
BLOCKS = 25
DIRECTIONS = 6
"""Of a residual; where an arm moves, one of them is along the motion."""
SLOW = 1e-12
"""Motion below this has no direction [scatter/s]."""
TO_SIGMA = 1.4826
"""From the median of absolute values to the standard deviation of normal ones."""


class Measured(NamedTuple):
    """Pairs of one arm, in the order of time.

    Attributes:
        q_rad: Reported joint angles, shape (n, 7) [rad].
        p_m: Measured end effector's origin in the shoulder frame, shape (n, 3) [m].
        rotation: Its axes as columns, shape (n, 3, 3).
        dq_radps: Velocities of the joints, shape (n, 7) [rad/s]; None where nobody knows them.
    """

    q_rad: Array
    p_m: Array
    rotation: Array
    dq_radps: Array | None = None

    def at(self, index: NDArray[np.integer[Any]]) -> Measured:
        """Return some of them."""
        dq_radps = None if self.dq_radps is None else self.dq_radps[index]
        return Measured(self.q_rad[index], self.p_m[index], self.rotation[index], dq_radps)


class Fit(NamedTuple):
    """What fits.

    Attributes:
        vector: Parameters, shape (k,).
        covariance: Of them, shape (k, k).
        weights: Of the measurements, 0 to 1, shape (n,).
    """

    vector: Array
    covariance: Array
    weights: Array


class Noise(NamedTuple):
    """How residuals scatter.

    Attributes:
        scatter: Standard deviation across the motion, shape (6,).
        along: Directions of the motion in units of it, shape (n, 6); zero where nothing moves.
        less: What is taken off a residual in that direction, 0 to 1, shape (n,).
    """

    scatter: Array
    along: Array
    less: Array

    def white(self, rows: Array) -> Array:
        """Return residuals, or the columns of a Jacobian, in units of their scatter, shape (n, 6, k) as given."""
        scaled = rows / self.scatter[:, None]
        told = np.einsum("ni,nik->nk", self.along, scaled) * self.less[:, None]
        return np.asarray(scaled - self.along[:, :, None] * told[:, None, :])


def residuals(parameters: Parameters, vector: Array, measured: Measured) -> Array:
    """Return what the corrected arm does not explain, shape (n, 6): position in units of `LENGTH_M`, then angle [rad]."""
    at = parameters.forward(vector, measured.q_rad, measured.dq_radps)
    turn = turns_of(measured.rotation @ at.rotation.transpose(0, 2, 1))
    return np.concatenate([(measured.p_m - at.p_m) / LENGTH_M, turn], axis=1)


def fitted(parameters: Parameters, measured: Measured, begin: Array | None = None) -> Fit:
    """Return the parameters that fit best.

    Args:
        parameters: What is fitted; the measurements can tell all of it apart (`excitation.py`).
        measured: Pairs.
        begin: Where the search begins, shape (k,); None for zero.
    """
    vector = np.zeros(len(parameters.names)) if begin is None else begin
    damping, is_huber = 1e-6, True
    error = residuals(parameters, vector, measured)
    for step_number in range(MOST_STEPS):
        noise, jacobian, white = _seen(parameters, vector, measured, error)
        far = np.linalg.norm(white, axis=1)
        step = _step(jacobian, white, _weights(far, is_huber=is_huber), damping)
        moved = residuals(parameters, vector + step, measured)
        after = np.linalg.norm(noise.white(moved[:, :, None]), axis=(1, 2))
        if _cost(after, is_huber=is_huber) <= _cost(far, is_huber=is_huber):
            vector, error, damping = vector + step, moved, max(0.1 * damping, 1e-12)
        else:
            damping = max(10.0 * damping, 1e-6)
        length = float(np.linalg.norm(step))
        if length < CLOSE and not is_huber:
            break
        is_huber = is_huber and length > NEARLY and step_number < HUBER_STEPS
    _, jacobian, white = _seen(parameters, vector, measured, error)
    weights = _weights(np.linalg.norm(white, axis=1), is_huber=False)
    return Fit(vector, _covariance(jacobian, white, weights), weights)


def _seen(parameters: Parameters, vector: Array, measured: Measured, error: Array) -> tuple[Noise, Array, Array]:
    """Return how residuals scatter, and Jacobian, shape (n, 6, k), and residuals, shape (n, 6), in units of that."""
    jacobian = parameters.jacobian(parameters.forward(vector, measured.q_rad, measured.dq_radps), measured.dq_radps)
    noise = _noise(error, jacobian[:, :, -1] if Group.LAG in parameters.groups else np.zeros_like(error))
    return noise, noise.white(jacobian), noise.white(error[:, :, None])[:, :, 0]


def _noise(error: Array, speed: Array) -> Noise:
    """Return the scatter of residuals across the motion, and how far that of the times adds to it along.

    The uncertainty of the times is that of the faster half of the pairs, where it tells most.

    Args:
        error: Residuals, shape (n, 6).
        speed: How these change with time, shape (n, 6).
    """
    across = error - _part(error, _unit(speed))
    is_moving = bool(np.median(np.linalg.norm(speed, axis=1)) > 0.0)
    lost = DIRECTIONS / (DIRECTIONS - 1.0) if is_moving else 1.0
    scatter = _scatter(across) * lost**0.5
    rates = np.linalg.norm(speed / scatter, axis=1)
    along = _unit(speed / scatter)
    fast = rates >= np.median(rates)
    size = TO_SIGMA * float(np.median(np.abs(np.einsum("ni,ni->n", along, error / scatter)[fast])))
    timing_s = max(size**2 - 1.0, 0.0) ** 0.5 / max(float(np.median(rates[fast])), SLOW)
    return Noise(scatter, along, 1.0 - 1.0 / np.sqrt(1.0 + (timing_s * rates) ** 2))


def _unit(rows: Array) -> Array:
    """Return rows of length 1, shape as given; of those that are hardly there, zeros."""
    lengths = np.linalg.norm(rows, axis=1)
    return np.asarray(np.where(lengths > SLOW, 1.0 / np.maximum(lengths, SLOW), 0.0)[:, None] * rows)


def _part(rows: Array, along: Array) -> Array:
    """Return the part of each row along a direction."""
    return np.asarray(np.einsum("ni,ni->n", rows, along)[:, None] * along)


def _scatter(error: Array) -> Array:
    """Return the standard deviation of six residuals, of position and of angle alike, shape (6,)."""
    position, angle = (TO_SIGMA * float(np.median(np.abs(part))) for part in (error[:, :3], error[:, 3:]))
    return np.array([max(position, LEAST_SCATTER)] * 3 + [max(angle, LEAST_SCATTER)] * 3)


def _weights(far: Array, *, is_huber: bool) -> Array:
    if is_huber:
        return np.minimum(1.0, HUBER / np.maximum(far, 1e-300))
    return np.asarray(np.where(far < TUKEY, (1.0 - (far / TUKEY) ** 2) ** 2, 0.0))


def _cost(far: Array, *, is_huber: bool) -> float:
    if is_huber:
        return float(np.sum(np.where(far < HUBER, 0.5 * far**2, HUBER * (far - 0.5 * HUBER))))
    return float(np.sum(1.0 - (1.0 - np.minimum(far / TUKEY, 1.0) ** 2) ** 3)) * TUKEY**2 / 6.0


def _step(jacobian: Array, error: Array, weights: Array, damping: float) -> Array:
    count = jacobian.shape[2]
    rows, weighted = jacobian.reshape(-1, count), (jacobian * weights[:, None, None]).reshape(-1, count)
    square = weighted.T @ rows
    return np.asarray(np.linalg.solve(square + damping * np.diag(np.diag(square)), weighted.T @ error.ravel()))


def _covariance(jacobian: Array, error: Array, weights: Array) -> Array:
    """Return the covariance of the parameters; residuals and Jacobian in units of the scatter."""
    count = jacobian.shape[2]
    weighted = jacobian * weights[:, None, None]
    plain = np.linalg.inv(weighted.reshape(-1, count).T @ jacobian.reshape(-1, count))
    pulls = np.einsum("nij,ni->nj", weighted, error)
    sums = np.array([block.sum(axis=0) for block in np.array_split(pulls, min(BLOCKS, len(pulls)))])
    clustered = plain @ (sums.T @ sums) @ plain
    grow = np.sqrt(np.maximum(1.0, np.diag(clustered) / np.diag(plain)))
    return np.asarray(plain * np.outer(grow, grow))
