"""Excitation: what measured postures can tell of an arm's parameters, what they cannot, and how to move so that they can.

The gain of a direction in the space of parameters is how far the end effector's pose moves, in the mean over the postures,
for a step of length 1 in it, radians and `LENGTH_M` alike. A direction with hardly any gain is one along which the
parameters trade off against each other: a fit would make them up from noise. The gain knows no noise and does not grow
with the number of samples, so that many samples of an arm that stands still prove nothing.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from gateway.kinematics.identification.parameters import Parameters
from gateway.values import ARM_DOF

__all__ = ["LEAST_GAIN", "Advice", "Excitation", "distinct", "excitation_of"]

Array = NDArray[np.float64]

LEAST_GAIN = 0.05
"""Below this parameters cannot be told apart (ours: the whole range of all joints gives 0.28, a fifth of it 0.055)."""

STEP_RAD = 0.01
"""Postures nearer than this in all joints count once."""

SHARE = 0.25
"""Of a direction of length 1: from here on a parameter is named as one of those that trade off."""

SWING_RAD = 1.0
"""How far a joint is imagined to move about where it has been, either way, for the advice."""
ENOUGH = 1.5
"""Advice is given until the least gain would be above the bound by this factor."""


class Advice(Struct, frozen=True, kw_only=True):
    """A joint to be moved.

    Attributes:
        joint: 1 to 7.
        lower_rad: From here ...
        upper_rad: ... to there, while the others move too.
        gain: Least gain that is then to be expected, with the joints of the advice before it.
    """

    joint: int
    lower_rad: float
    upper_rad: float
    gain: float


class Excitation(Struct, frozen=True, kw_only=True):
    """What postures can tell.

    Attributes:
        singular_values: Gains of all directions, largest first, shape (k,).
        blurred: For each direction below `LEAST_GAIN`: names of the parameters that trade off, the largest share first.
        moved_rad: Lowest and highest angle of each joint, shape (7, 2) [rad].
        advice: Joints to move so that everything can be told, in order; empty where it can be, or where none helps.
    """

    singular_values: tuple[float, ...]
    blurred: tuple[tuple[str, ...], ...]
    moved_rad: tuple[tuple[float, float], ...]
    advice: tuple[Advice, ...]

    @property
    def gain(self) -> float:
        """The least one."""
        return self.singular_values[-1]

    @property
    def is_enough(self) -> bool:
        """Whether all parameters can be told apart."""
        return self.gain >= LEAST_GAIN


def distinct(q_rad: Array, step_rad: float = STEP_RAD) -> NDArray[np.intp]:
    """Return the indices of postures that differ from the one kept before, shape (m,).

    Args:
        q_rad: In the order of time, shape (n, 7) [rad].
        step_rad: By so much at least, in one joint [rad].
    """
    kept = [0] if len(q_rad) else []
    for index in range(1, len(q_rad)):
        if np.abs(q_rad[index] - q_rad[kept[-1]]).max() >= step_rad:
            kept.append(index)
    return np.array(kept, dtype=np.intp)


def excitation_of(parameters: Parameters, q_rad: Array, lower_rad: Array, upper_rad: Array) -> Excitation:
    """Return what postures can tell of parameters.

    Args:
        parameters: Those that are to be fitted.
        q_rad: Postures, shape (n, 7) [rad], n at least 1.
        lower_rad: Lowest joint angles, shape (7,) [rad]: advice keeps inside.
        upper_rad: Highest joint angles, shape (7,) [rad].
    """
    about = _information(parameters, q_rad)
    values, directions = np.linalg.eigh(about)
    gains = np.sqrt(np.maximum(values, 0.0))
    blurred = tuple(
        _names(parameters, directions[:, index]) for index in range(len(gains)) if gains[index] < LEAST_GAIN
    )
    low, high = q_rad.min(axis=0), q_rad.max(axis=0)
    return Excitation(
        singular_values=tuple(gains[::-1].tolist()),
        blurred=blurred,
        moved_rad=tuple((a, b) for a, b in zip(low.tolist(), high.tolist(), strict=True)),
        advice=_advice(parameters, q_rad, lower_rad, upper_rad) if blurred else (),
    )


def _information(parameters: Parameters, q_rad: Array) -> Array:
    """Return JᵀJ in the mean over postures, shape (k, k)."""
    jacobian = parameters.jacobian(parameters.forward(np.zeros(len(parameters.names)), q_rad))
    rows = jacobian.reshape(-1, jacobian.shape[2])
    return np.asarray(rows.T @ rows / len(q_rad))


def _names(parameters: Parameters, direction: Array) -> tuple[str, ...]:
    order = np.argsort(-np.abs(direction))
    return tuple(parameters.names[index] for index in order if abs(direction[index]) >= SHARE)


def _gains(parameters: Parameters, q_rad: Array) -> Array:
    """Return the gains of all directions, the least first, shape (k,)."""
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(_information(parameters, q_rad)), 0.0)))


def _advice(parameters: Parameters, q_rad: Array, lower_rad: Array, upper_rad: Array) -> tuple[Advice, ...]:
    """Return the joints that help, the one that helps most first: each is imagined to swing beside those before it.

    A swing of one joint at a time leaves others blurred, so they swing together: by numbers that repeat no pattern.
    """
    base = q_rad[np.linspace(0, len(q_rad) - 1, min(len(q_rad), 60)).astype(np.intp)]
    base = base[np.arange(120) % len(base)]
    middle = np.median(q_rad, axis=0)
    low = np.maximum(np.minimum(middle - SWING_RAD, upper_rad - 2.0 * SWING_RAD), lower_rad)
    high = np.minimum(low + 2.0 * SWING_RAD, upper_rad)
    swings = low + _spread(len(base)) * (high - low)
    found: list[Advice] = []
    left = list(range(ARM_DOF))
    wanted = ENOUGH * LEAST_GAIN
    while left and (not found or found[-1].gain < wanted):
        tried = {}
        for joint in left:
            moved = base.copy()
            moved[:, joint] = swings[:, joint]
            tried[joint] = _gains(parameters, moved)
        # The least gain alone says nothing while several are nil: what counts is how much of all that is missing comes.
        best = max(tried, key=lambda joint: float(np.minimum(tried[joint], wanted).sum()))
        base[:, best] = swings[:, best]
        left.remove(best)
        gain = float(tried[best][0])
        found.append(Advice(joint=best + 1, lower_rad=float(low[best]), upper_rad=float(high[best]), gain=gain))
    return tuple(found) if found[-1].gain >= LEAST_GAIN else ()


def _spread(count: int) -> Array:
    """Return points that fill the unit cube evenly, shape (count, 7): multiples of roots of primes, whole parts dropped."""
    return np.asarray(np.outer(np.arange(1, count + 1), np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0])) % 1.0)
