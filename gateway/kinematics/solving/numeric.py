"""Numeric: inverse kinematics by damped least squares, for any chain: the witness of the closed form, and its stand-in.

Levenberg's step with a damping that shrinks with the error. A joint at its limit that would have to go further is left out
of the step, so that limits are kept throughout. Finds one solution near its seed, or says how near it came.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.kinematics.placement import Placement, turn_rad
from gateway.kinematics.solving.chain import ArmChain
from gateway.values import Vector

__all__ = ["Found", "found_from"]

Array = NDArray[np.float64]

LENGTH_M = 0.3
"""About half an arm: what makes a metre and a radian count alike."""
CLOSE = 1e-12
"""Error that is rounding [m, rad]."""
MOST_STEPS = 100
PATIENCE = 12
"""Steps in which the square of the error does not even halve: there is nothing this way."""
LONGEST_RAD = 0.3
"""Of one step, each joint."""


class Found(NamedTuple):
    """Where a search ended.

    Attributes:
        q_rad: Joint angles inside the limits, shape (7,) [rad].
        error_m: Distance from the pose asked for [m].
        error_rad: Angle from it [rad].
    """

    q_rad: Vector
    error_m: float
    error_rad: float


def found_from(
    chain: ArmChain,
    target: Placement,
    seed_rad: Sequence[float],
    lower_rad: Sequence[float],
    upper_rad: Sequence[float],
) -> Found:
    """Return the nearest that a search from a seed comes to a pose.

    Args:
        chain: The arm.
        target: End effector in the shoulder frame.
        seed_rad: Where it begins, shape (7,) [rad]; put inside the limits first.
        lower_rad: Lowest joint angles, shape (7,) [rad].
        upper_rad: Highest joint angles, shape (7,) [rad].
    """
    low, high = np.array(lower_rad), np.array(upper_rad)
    q = np.clip(np.array(seed_rad), low, high)
    best = Found((), math.inf, math.inf)
    mark, marked = math.inf, 0
    for step in range(MOST_STEPS):
        error, found = _error(chain, target, q)
        size = float(error @ error)
        if size < (best.error_m / LENGTH_M) ** 2 + best.error_rad**2:
            best = found
        if size < CLOSE * CLOSE:
            break
        if size < 0.5 * mark:
            mark, marked = size, step
        elif step - marked >= PATIENCE:
            break
        q = np.clip(q + _step(chain.jacobian(q.tolist()), error, q, low, high), low, high)
    return best


def _error(chain: ArmChain, target: Placement, q: Array) -> tuple[Array, Found]:
    """Return the error, shape (6,), metres divided by the length, and what it amounts to."""
    joints = tuple(q.tolist())
    at = chain.forward(joints)
    way = [a - b for a, b in zip(target.p_m, at.p_m, strict=True)]
    turn = turn_rad(at.rows, target.rows)
    return np.array([*(w / LENGTH_M for w in way), *turn]), Found(joints, math.hypot(*way), math.hypot(*turn))


def _step(jacobian: Array, error: Array, q: Array, low: Array, high: Array) -> Array:
    """Return one damped step that no joint at its limit takes outward."""
    rows = jacobian.copy()
    rows[:3] /= LENGTH_M
    damping = 1e-2 * min(float(error @ error), 1.0) + 1e-14
    free = np.ones(len(q), dtype=bool)
    while True:
        active = rows[:, free]
        step = np.zeros(len(q))
        step[free] = active.T @ np.linalg.solve(active @ active.T + damping * np.eye(6), error)
        outward = free & (((q <= low) & (step < 0.0)) | ((q >= high) & (step > 0.0)))
        if not outward.any():
            return step * min(1.0, LONGEST_RAD / max(float(np.abs(step).max()), 1e-300))
        free &= ~outward
        if not free.any():
            return np.zeros(len(q))
