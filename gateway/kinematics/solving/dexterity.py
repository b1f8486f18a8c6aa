"""Dexterity: how well an end effector can move, in every direction; how near it is to losing one; how its joints have to go.

Metres and radians are made alike by a length: a turn of 1 rad/s counts as much as `LENGTH_M` per second.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from gateway.values import Vector

__all__ = ["LENGTH_M", "Dexterity", "dexterity", "joint_speeds"]

LENGTH_M = 0.3
"""About half an arm."""

FLOOR = 0.04
"""Singular values below this count as this: so the speed of joints is bounded by that of the end effector, and does not fall
again on the way into a singularity as damped least squares do (ours: 6 % of all postures of an arm have a smaller one)."""
UNITS = np.array([1.0 / LENGTH_M] * 3 + [1.0] * 3)
"""What makes metres and radians alike."""
UNIT_ROWS = UNITS[:, None]


class Dexterity(Struct, frozen=True, kw_only=True):
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


def joint_speeds(jacobian: NDArray[np.float64], rates: Vector) -> Vector:
    """Return the velocities of the joints that give a velocity of the end effector: the shortest, bounded near singularities.

    Another choice of the elbow's motion is possible, and asks for more in the mean over the joints.

    Args:
        jacobian: Of the end effector in the shoulder frame, shape (6, 7): [m/rad], then [rad/rad].
        rates: Its velocity [m/s], then angular velocity [rad/s], shape (6,), in the shoulder frame.

    Returns:
        Shape (7,) [rad/s]; not all 0 where the end effector moves.
    """
    directions, values, joints = np.linalg.svd(jacobian * UNIT_ROWS, full_matrices=False)
    wanted = (np.array(rates) * UNITS) @ directions
    return tuple((wanted / np.maximum(values, FLOOR) @ joints).tolist())
