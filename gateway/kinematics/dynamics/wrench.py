"""From torques of joints to the force and the moment at the hand, with what cannot be known of them. Pure.

Torques are r = J'F. F is found by least squares, each joint weighted by how sure it is, among the directions in which a force
on the hand moves a joint at all: where the levers vanish (a stretched elbow, axes in a line), motors feel nothing of it, and
the direction is named instead of a number that is made of noise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["HAND_M", "LEAST_LEVER_M", "Wrench", "wrench_of"]

Array = NDArray[np.float64]

HAND_M = 0.1
"""A moment counts as a force at this lever, so that both can be compared [m]: about the length of a hand."""
LEAST_LEVER_M = 0.02
"""With shorter levers than this a direction of force is not felt [m]: 50 N would be 1 N·m, what friction hides."""
SHARE = 0.05
"""A component is unknown when more than this part of it (of its square) lies in directions that are not felt."""

_SCALE = np.array([1.0, 1.0, 1.0, HAND_M, HAND_M, HAND_M])


class Wrench(NamedTuple):
    """Force and moment that the surroundings put on the hand.

    Attributes:
        values: Force x, y, z [N], moment x, y, z [N·m], shape (6,); NaN where it cannot be known.
        sd: Their standard deviations, shape (6,); infinite where it cannot be known.
        unknown: Directions that are not felt, unit vectors of force [N] and moment [N·m], shape (n, 6).
    """

    values: Array
    sd: Array
    unknown: Array


def wrench_of(jacobian: Array, torque_nm: Array, variance_nm2: Array) -> Wrench:
    """Return what pulls at the hand.

    Args:
        jacobian: Of the point where it acts, linear rows first, shape (6, 7).
        torque_nm: External torques of the joints, shape (7,) [N·m].
        variance_nm2: Their variances, all positive, shape (7,) [N²·m²].
    """
    levers = jacobian.T * _SCALE  # torque per newton, [m]
    weighted = levers.T / variance_nm2
    if np.linalg.eigvalsh(levers.T @ levers)[0] >= LEAST_LEVER_M**2:  # most postures: all is felt, and less to work out
        spread = np.linalg.inv(weighted @ levers)
        values = spread @ (weighted @ torque_nm) * _SCALE
        return Wrench(values, np.sqrt(spread.diagonal()) * _SCALE, np.empty((0, 6)))
    _, sizes, directions = np.linalg.svd(levers, full_matrices=False)
    is_felt = sizes >= LEAST_LEVER_M
    felt, unfelt = directions[is_felt], directions[~is_felt]
    spread = felt.T @ np.linalg.inv(felt @ weighted @ levers @ felt.T) @ felt
    values, sd = spread @ (weighted @ torque_nm) * _SCALE, np.sqrt(spread.diagonal()) * _SCALE
    is_lost = np.square(unfelt).sum(axis=0) > SHARE
    unfelt = unfelt * _SCALE
    return Wrench(
        np.where(is_lost, np.nan, values),
        np.where(is_lost, np.inf, sd),
        unfelt / np.linalg.norm(unfelt, axis=1, keepdims=True),
    )
