"""Identification: joint zeros and end effector of one robot's arm, from pairs of joint angles and end-effector poses.

An answer is given only where the pairs carry it: enough postures, excitation that tells every parameter apart, scatter small
enough for the accuracy promised, measurements that the correction explains, and a fit that holds on measurements it has not
seen. Otherwise there is a reason, with a figure and what to do.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from gateway.kinematics.arm import ArmModel
from gateway.kinematics.correction import ArmCorrection
from gateway.kinematics.identification.excitation import LEAST_GAIN, Excitation, distinct, excitation_of
from gateway.kinematics.identification.pairing import Pair
from gateway.kinematics.identification.parameters import LENGTH_M, Group, Parameters
from gateway.kinematics.identification.robust import Fit, Measured, fitted, residuals
from gateway.kinematics.placement import rows_from_quat

__all__ = ["ACCURACY_M", "ACCURACY_RAD", "Estimate", "Identification", "Misfit", "Unidentified", "Why", "identify"]

Array = NDArray[np.float64]

ACCURACY_RAD = 0.2e-3
"""Promised of every angle: three standard deviations are below it."""
ACCURACY_M = 0.2e-3
"""Promised of every length likewise."""
LEAST_POSTURES = 50
"""Different ones; fewer leave nothing to check the fit on."""
FINE_RAD = 0.002
"""Pairs nearer than this to the one before in all joints are left out: ten times the noise of a joint, so that an arm that
stands still does not count for more and more, and one that creeps does."""
MOST_PAIRS = 4000
"""More are thinned out evenly: they change nothing and take time."""
LEAST_SHARE = 0.7
"""Of the pairs that must have a say: else it is not a few that are wrong."""
MOST_M, MOST_RAD = 2e-3, 7e-3
"""Typical residual that may be left: beyond, it is not zeros and mounts that are wrong (or the other arm's poses)."""
LAG_RADPS = 0.02
"""From this speed on, in the mean square, the times of joints and poses matter, and their lag is fitted along."""
BESIDE = 2
"""A velocity is taken from the pairs so many places before and after ..."""
GAP_S = 0.2
"""... if they are not further apart than this [s]."""
FOLDS = 5
MOST_GROWTH = 1.5
"""How much larger the typical residual may be on pairs that were left out than on those that were fitted."""


class Why(str, Enum):
    """Why nothing is identified."""

    FEW = "too few postures"
    BLURRED = "parameters cannot be told apart"
    NOISY = "scatter too large"
    UNEXPLAINED = "not explained by zeros and mounts"
    OVERFITTED = "does not hold on pairs left out"


class Misfit(Struct, frozen=True, kw_only=True):
    """Typical residual: the median over pairs.

    Attributes:
        position_m: Distance between measured and computed position [m].
        angle_rad: Angle between measured and computed orientation [rad].
    """

    position_m: float
    angle_rad: float


class Estimate(Struct, frozen=True, kw_only=True):
    """One parameter.

    Attributes:
        name: Which.
        value: Its value, in the unit.
        sigma: Standard deviation of it.
        unit: `rad` or `m`.
    """

    name: str
    value: float
    sigma: float
    unit: str


class Identification(Struct, frozen=True, kw_only=True):
    """What was found.

    Attributes:
        correction: Of the arm.
        estimates: The same, number by number.
        covariance: Of the estimates, in their units, shape (k, k).
        before: Residual of the description as it is.
        after: Residual of the corrected one.
        validated: Residual on pairs that took no part in the fit, over all folds.
        postures: How many different ones there were.
        share: Of them that had a say.
        lag_s: By how much later than their stamps the poses were [s]; 0 where nothing moved, or nobody knows the times.
        excitation: What they could tell.
    """

    correction: ArmCorrection
    estimates: tuple[Estimate, ...]
    covariance: tuple[tuple[float, ...], ...]
    before: Misfit
    after: Misfit
    validated: Misfit
    postures: int
    share: float
    lag_s: float
    excitation: Excitation


class Unidentified(Struct, frozen=True, kw_only=True):
    """Why nothing was.

    Attributes:
        why: Kind of reason.
        message: The reason, with figure and bound.
        hint: What to do.
        postures: How many different ones there were.
        before: Residual of the description as it is; None without pairs.
        excitation: What they could tell; None without pairs.
        missing: NOISY: times as many pairs of the same motion would do; None for other reasons.
    """

    why: Why
    message: str
    hint: str
    postures: int
    before: Misfit | None = None
    excitation: Excitation | None = None
    missing: float | None = None


def identify(
    arm: ArmModel, pairs: Sequence[Pair], groups: frozenset[Group] = frozenset({Group.JOINTS, Group.EE})
) -> Identification | Unidentified:
    """Return the correction of an arm that explains pairs, or why there is none.

    Args:
        arm: As described; its limits bound the advice how to move.
        pairs: Of this arm, in the order of time.
        groups: What is fitted; at least one.
    """
    measured = _measured(pairs)
    shown_rad = measured.q_rad[distinct(measured.q_rad)]
    postures = len(shown_rad)
    if postures < LEAST_POSTURES:
        return Unidentified(
            why=Why.FEW,
            message=f"{postures} different postures in {len(pairs)} pairs; at least {LEAST_POSTURES} are needed",
            hint="move all joints of the arm slowly, through as much of their range as there is room for",
            postures=postures,
        )
    measured, is_moving = _timed(measured.at(distinct(measured.q_rad, FINE_RAD)))
    count = len(measured.q_rad)
    if count > MOST_PAIRS:
        measured = measured.at(np.linspace(0, count - 1, MOST_PAIRS).astype(np.intp))
    parameters = Parameters(arm.chain, groups | {Group.LAG} if is_moving else groups)
    before = _misfit(residuals(parameters, np.zeros(len(parameters.names)), measured))
    excitation = excitation_of(
        Parameters(arm.chain, groups), shown_rad, np.array(arm.lower_rad), np.array(arm.upper_rad)
    )

    def no(why: Why, message: str, hint: str, missing: float | None = None) -> Unidentified:
        return Unidentified(
            why=why,
            message=message,
            hint=hint,
            postures=postures,
            before=before,
            excitation=excitation,
            missing=missing,
        )

    if not excitation.is_enough:
        blurred = "; ".join(" with ".join(names) for names in excitation.blurred)
        return no(
            Why.BLURRED,
            f"cannot be told apart: {blurred} (gain {excitation.gain:.2g}, at least {LEAST_GAIN:g} is needed)",
            _moves(excitation),
        )
    fit = fitted(parameters, measured)
    error = residuals(parameters, fit.vector, measured)
    share, after = float(np.mean(fit.weights > 0.0)), _misfit(error)
    if share < LEAST_SHARE or after.position_m > MOST_M or after.angle_rad > MOST_RAD:
        return no(
            Why.UNEXPLAINED,
            f"{_told(after)} are left (up to {1e3 * MOST_M:g} mm and {1e3 * MOST_RAD:g} mrad), and {share:.0%} of the pairs "
            f"have a say (at least {LEAST_SHARE:.0%})",
            "are these the poses of this arm, at the same time as its joints? Then other numbers of the body differ",
        )
    estimates = _estimates(parameters, fit)
    lag_s = float(fit.vector[-1]) if is_moving else 0.0
    worst = max(estimates, key=lambda row: row.sigma / _accuracy(row))
    missing = (3.0 * worst.sigma / _accuracy(worst)) ** 2
    if missing > 1.0:
        return no(
            Why.NOISY,
            f"{worst.name} is known to ±{3e3 * worst.sigma:.2g} {'mm' if worst.unit == 'm' else 'mrad'} (3 sigma), "
            f"{1e3 * _accuracy(worst):g} is promised",
            f"take more pairs, some {missing:.1f} times as many of such motion, or move through more of the range",
            missing,
        )
    validated = _validated(parameters, measured, fit.vector)
    if _growth(validated, after) > MOST_GROWTH:
        return no(
            Why.OVERFITTED,
            f"{_told(validated)} on pairs left out, {_told(after)} on those fitted",
            "repeat the same motion several times, so that every part of it is seen more than once",
        )
    units = parameters.scales
    covariance = (fit.covariance * np.outer(units, units))[: len(estimates), : len(estimates)]
    return Identification(
        correction=parameters.correction(fit.vector),
        estimates=estimates,
        covariance=tuple(tuple(row) for row in covariance.tolist()),
        before=before,
        after=after,
        validated=validated,
        postures=postures,
        share=share,
        lag_s=lag_s,
        excitation=excitation,
    )


def _measured(pairs: Sequence[Pair]) -> Measured:
    q_rad = np.array([pair.q_rad for pair in pairs]).reshape(-1, 7)
    return Measured(
        q_rad,
        np.array([pair.pose.p_m for pair in pairs]).reshape(-1, 3),
        np.array([rows_from_quat(pair.pose.quat_xyzw) for pair in pairs]).reshape(-1, 3, 3),
        _velocities(q_rad, np.array([pair.stamp_ns for pair in pairs], dtype=np.int64)),
    )


def _velocities(q_rad: Array, stamps_ns: NDArray[np.int64]) -> Array | None:
    """Return the velocities of the joints, from the pairs around each; NaN beside a gap. None without stamps."""
    if len(stamps_ns) < 2 * BESIDE + 1 or np.any(np.diff(stamps_ns) <= 0):
        return None
    found = np.full_like(q_rad, np.nan)
    between_s = 1e-9 * (stamps_ns[2 * BESIDE :] - stamps_ns[: -2 * BESIDE])[:, None]
    slopes = (q_rad[2 * BESIDE :] - q_rad[: -2 * BESIDE]) / between_s
    found[BESIDE:-BESIDE] = np.where(between_s < GAP_S, slopes, np.nan)
    return found


def _timed(measured: Measured) -> tuple[Measured, bool]:
    """Return the pairs that can be used, and whether their times matter.

    Where they do, what has no velocity is left out: a lag that is not known of shifts it by as much as the promise and more.
    """
    if measured.dq_radps is None:
        return measured, False
    known = np.isfinite(measured.dq_radps).all(axis=1)
    if not known.any() or float(np.sqrt(np.mean(measured.dq_radps[known] ** 2))) <= LAG_RADPS:
        return measured._replace(dq_radps=None), False
    return measured.at(np.flatnonzero(known)), True


def _misfit(error: Array) -> Misfit:
    return Misfit(
        position_m=LENGTH_M * float(np.median(np.linalg.norm(error[:, :3], axis=1))),
        angle_rad=float(np.median(np.linalg.norm(error[:, 3:], axis=1))),
    )


def _told(misfit: Misfit) -> str:
    return f"{1e3 * misfit.position_m:.2g} mm and {1e3 * misfit.angle_rad:.2g} mrad"


def _accuracy(estimate: Estimate) -> float:
    return ACCURACY_M if estimate.unit == "m" else ACCURACY_RAD


def _estimates(parameters: Parameters, fit: Fit) -> tuple[Estimate, ...]:
    values, sigmas = fit.vector * parameters.scales, np.sqrt(np.diag(fit.covariance)) * parameters.scales
    return tuple(
        Estimate(name=name, value=value, sigma=sigma, unit=unit)
        for name, value, sigma, unit in zip(
            parameters.names, values.tolist(), sigmas.tolist(), parameters.units, strict=True
        )
        if unit != "s"
    )


def _validated(parameters: Parameters, measured: Measured, begin: Array) -> Misfit:
    """Return the residual on stretches of time, each left out of the fit that is asked about it."""
    everything = np.arange(len(measured.q_rad))
    errors = []
    for fold in np.array_split(everything, FOLDS):
        fit = fitted(parameters, measured.at(np.setdiff1d(everything, fold)), begin)
        errors.append(residuals(parameters, fit.vector, measured.at(fold)))
    return _misfit(np.concatenate(errors))


def _growth(validated: Misfit, after: Misfit) -> float:
    """Return the factor by which a residual grew; what is far below the accuracy does not count."""
    return max(
        validated.position_m / max(after.position_m, 0.1 * ACCURACY_M),
        validated.angle_rad / max(after.angle_rad, 0.1 * ACCURACY_RAD),
    )


def _moves(excitation: Excitation) -> str:
    if not excitation.advice:
        return "fit fewer parameters: no joint that moves more would tell these apart"
    swings = ", ".join(
        f"joint {row.joint} from {row.lower_rad:+.2f} to {row.upper_rad:+.2f} rad" for row in excitation.advice
    )
    return f"move, beside what has moved and slowly: {swings}"
