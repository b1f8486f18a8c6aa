"""Dexterity: how well an end effector can move from where it is, in every direction; how near the arm is to losing one.

Metres and radians are made alike by a length: a turn of 1 rad/s counts as much as `LENGTH_M` per second.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.values import Vector

__all__ = ["LENGTH_M", "Dexterity", "dexterity"]

LENGTH_M = 0.3
"""About half an arm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Dexterity:
    """How an arm stands.

    Attributes:
        manipulability: Yoshikawa's: the square root of det(J Jᵀ), the volume of all velocities that joint velocities of
            length 1 rad/s give [m³/rad³]; 0 in a singularity.
        least: Smallest singular value: velocity in the worst direction for joint velocities of length 1 rad/s, lengths in
            units of `LENGTH_M`. 0 in a singularity: the measure of how near one is.
        greatest: Largest singular value.
        worst: The worst direction in the shoulder frame, unit vector, shape (6,): translation in units of `LENGTH_M`,
            then rotation. Its sign means nothing.
    """

    manipulability: float
    least: float
    greatest: float
    worst: Vector

    @property
    def condition(self) -> float:
        """How much harder the worst direction is than the best; infinite in a singularity."""
        return self.greatest / self.least if self.least > 0.0 else float("inf")


def dexterity(jacobian: NDArray[np.float64]) -> Dexterity:
    """Return how an arm stands.

    Args:
        jacobian: Of the end effector in the shoulder frame, shape (6, 7): [m/rad], then [rad/rad].
    """
    scaled = jacobian.copy()
    scaled[:3] /= LENGTH_M
    directions, values, _ = np.linalg.svd(scaled, full_matrices=False)
    return Dexterity(
        manipulability=float(np.prod(values)) * LENGTH_M**3,
        least=float(values[-1]),
        greatest=float(values[0]),
        worst=tuple(directions[:, -1].tolist()),
    )
