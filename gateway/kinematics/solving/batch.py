"""Batch: forward kinematics of one arm for many configurations at once, in arrays.

`ArmChain` is quicker for one configuration; a fit asks for thousands, and for the axes of all joints in each.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.kinematics.solving.chain import ArmChain
from gateway.values import ARM_DOF

__all__ = ["ArmBatch", "Many", "rotations_of", "turns_of"]

Array = NDArray[np.float64]


class Many(NamedTuple):
    """An arm in n configurations, everything in the shoulder frame.

    Attributes:
        p_m: End effector's origin, shape (n, 3) [m].
        rotation: Its axes as columns, shape (n, 3, 3).
        points_m: A point on each joint's axis, shape (n, 7, 3) [m].
        axes: Direction of each joint's axis, unit vectors, shape (n, 7, 3).
    """

    p_m: Array
    rotation: Array
    points_m: Array
    axes: Array


class ArmBatch:
    """The chain of an arm as arrays."""

    def __init__(self, chain: ArmChain) -> None:
        self._points = np.array([point for point, _ in chain.lines])
        self._axes = np.array([axis for _, axis in chain.lines])
        self._zero_m, self._zero = np.array(chain.zero.p_m), np.array(chain.zero.rows)

    @property
    def first_axis(self) -> Array:
        """Direction of joint 1's axis in the shoulder frame, shape (3,)."""
        return np.asarray(self._axes[0])

    @property
    def last_axis(self) -> Array:
        """Direction of joint 7's axis in the end effector's frame, shape (3,)."""
        return np.asarray(self._zero.T @ self._axes[-1])

    def forward(self, q_rad: Array) -> Many:
        """Return the arm in many configurations.

        Args:
            q_rad: Joint angles, shape (n, 7) [rad], order of §4.0.3; not judged by limits.
        """
        count = len(q_rad)
        p = np.zeros((count, 3))
        rotation = np.broadcast_to(np.eye(3), (count, 3, 3))
        points, axes = np.empty((count, ARM_DOF, 3)), np.empty((count, ARM_DOF, 3))
        for joint in range(ARM_DOF):
            point, axis = self._points[joint], self._axes[joint]
            points[:, joint] = p + rotation @ point
            axes[:, joint] = rotation @ axis
            rotation = rotation @ rotations_of(q_rad[:, joint, None] * axis)
            p = points[:, joint] - rotation @ point
        return Many(p + rotation @ self._zero_m, rotation @ self._zero, points, axes)


def rotations_of(turns_rad: Array) -> Array:
    """Return the rotation matrices of rotation vectors, shape (..., 3) [rad] to (..., 3, 3) (Rodrigues)."""
    angle = np.linalg.norm(turns_rad, axis=-1)
    x, y, z = np.moveaxis(turns_rad, -1, 0)
    cross = np.zeros((*turns_rad.shape, 3))
    cross[..., 0, 1], cross[..., 0, 2], cross[..., 1, 2] = -z, y, -x
    cross[..., 1, 0], cross[..., 2, 0], cross[..., 2, 1] = z, -y, x
    first = np.sinc(angle / np.pi)[..., None, None]
    second = (0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2)[..., None, None]
    return np.asarray(np.eye(3) + first * cross + second * (cross @ cross))


def turns_of(rotation: Array) -> Array:
    """Return the rotation vectors of matrices, shape (..., 3, 3) to (..., 3) [rad], on the shorter way."""
    skew = 0.5 * np.stack(
        [
            rotation[..., 2, 1] - rotation[..., 1, 2],
            rotation[..., 0, 2] - rotation[..., 2, 0],
            rotation[..., 1, 0] - rotation[..., 0, 1],
        ],
        axis=-1,
    )
    sine = np.linalg.norm(skew, axis=-1)
    cosine = 0.5 * (np.trace(rotation, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    # At half a turn the axis is lost; such a measurement is an outlier in any case, and its length is what counts.
    lost = (sine < 1e-6) & (cosine < 0.0)
    factor = np.where(sine < 1e-9, 1.0, angle / np.where(sine < 1e-9, 1.0, sine))
    turn = factor[..., None] * skew
    return np.asarray(np.where(lost[..., None], np.array((np.pi, 0.0, 0.0)), turn))
