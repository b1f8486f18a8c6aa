"""Forward and inverse kinematics of both arms in plain numpy.

The numbers are those of the vendor's published description `teleavatar_urdf_20260928-v2` (2026-10-08): joint origins
(xyz, fixed-axis rpy) and axes from body_link to left_ee / right_ee. Base frames are left_shoulder_base and
right_shoulder_base of §4.0.1. The manual does not publish its own end-effector frames (§4.0.5).

Knows nothing of topics, modes or time. Shares no code with the gateway's kinematics.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.sim.robot.manual import DOF, LOWER_RAD, UPPER_RAD, Side

__all__ = ["POSE_TOLERANCE_M", "POSE_TOLERANCE_RAD", "ArmGeometry", "EePose", "arm_geometry"]

Array = NDArray[np.float64]

_PI: Final = float(np.pi)
_H: Final = _PI / 2.0

POSE_TOLERANCE_M: Final = 1e-5
"""A solution is accepted when the position is at least this close [m] (choice)."""

POSE_TOLERANCE_RAD: Final = 1e-4
"""... and the orientation this close [rad] (choice)."""

_MAX_ITERATIONS: Final = 120
_PATIENCE: Final = 12  # iterations in which the squared error does not even halve: there is no solution this way
_MAX_STEP_RAD: Final = 0.25

# Shoulder frame in body_link: the fixed joint to virtual_base (turned +90 deg about z), then the one to the shoulder.
_VIRTUAL_BASE: Final = ((0.0, 0.105797711221034, 0.192545691255924), (0.0, 0.0, _H))
_SHOULDER: Final = {
    Side.LEFT: ((-0.105597711221034, 0.22, -0.192545691255924), (0.0, 0.0, 0.0)),
    Side.RIGHT: ((-0.105597711221034, -0.22, -0.192545691255924), (0.0, 0.0, 0.0)),
}

# Per joint: xyz [m], rpy [rad] of the joint frame in its parent, sign of the rotation about its own z axis.
_JOINTS: Final = {
    Side.LEFT: (
        ((-0.1005, 0.0002, 0.0), (0.0, _H, 0.0), 1.0),
        ((0.0, 0.0, -0.1195), (_H, -_H, _PI), -1.0),
        ((-0.134, 0.0, 0.0), (_H, 0.0, -_H), -1.0),
        ((0.0, 0.03, 0.14), (0.0, _H, 0.0), -1.0),
        ((-0.1135, -0.03, 0.0), (-_H, 0.0, -_H), 1.0),
        ((0.0, 0.0, -0.162), (_PI, -_H, 0.0), -1.0),
        ((0.0, 0.021, 0.0), (-_H, _PI, 0.0), -1.0),
    ),
    Side.RIGHT: (
        ((0.1005, 0.0002, 0.0), (0.0, -_H, 0.0), 1.0),
        ((0.0, 0.0, -0.1195), (-_H, _H, 0.0), -1.0),
        ((0.134, 0.0, 0.0), (-_H, 0.0, _H), 1.0),
        ((0.0, -0.03, -0.14), (_PI, _H, 0.0), -1.0),
        ((0.1135, -0.03, 0.0), (0.0, -_H, 0.0), 1.0),
        ((0.0, 0.0, -0.162), (-_H, _H, 0.0), 1.0),
        ((0.0, -0.021, 0.0), (-_H, 0.0, 0.0), 1.0),
    ),
}
_EE: Final = {
    Side.LEFT: ((0.0, 0.0, -0.021), (0.0, 0.0, 0.0)),
    Side.RIGHT: ((0.0, 0.0, 0.021), (_PI, 0.0, 0.0)),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class EePose:
    """A pose of the end effector in its own shoulder frame (§4.0.2).

    Attributes:
        position_m: x, y, z [m].
        quat_xyzw: Orientation, order x, y, z, w; of any non-zero length on the way in, unit length on the way out.
    """

    position_m: tuple[float, float, float]
    quat_xyzw: tuple[float, float, float, float]


def _rotation(axis: int, angle_rad: float) -> Array:
    """Return the rotation matrix about a coordinate axis (0 x, 1 y, 2 z), shape (3, 3)."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    matrix = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix


def _origin(xyz: tuple[float, ...], rpy: tuple[float, ...]) -> Array:
    """Return the transform of a URDF origin (fixed-axis roll, pitch, yaw), shape (4, 4)."""
    transform = np.eye(4)
    transform[:3, :3] = _rotation(2, rpy[2]) @ _rotation(1, rpy[1]) @ _rotation(0, rpy[0])
    transform[:3, 3] = xyz
    return transform


def rotation_from_quat(quat_xyzw: Sequence[float]) -> Array:
    """Return the rotation matrix of a quaternion of any non-zero length, shape (3, 3)."""
    x, y, z, w = np.asarray(quat_xyzw, dtype=np.float64) / np.linalg.norm(quat_xyzw)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quat_from_rotation(rows: Sequence[Sequence[float]]) -> tuple[float, float, float, float]:
    """Return the unit quaternion (x, y, z, w) of a rotation matrix, from its largest component for accuracy."""
    (a, b, c), (d, e, f), (g, h, i) = rows
    squares = (1 + a - e - i, 1 - a + e - i, 1 - a - e + i, 1 + a + e + i)
    largest = squares.index(max(squares))
    scale = 0.5 / math.sqrt(squares[largest])
    x, y, z, w = (
        (squares[0], b + d, g + c, h - f),
        (b + d, squares[1], f + h, c - g),
        (g + c, f + h, squares[2], d - b),
        (h - f, c - g, d - b, squares[3]),
    )[largest]
    return (scale * x, scale * y, scale * z, scale * w)


def rotation_vector(rotation: Array) -> Array:
    """Return axis times angle of a rotation matrix [rad], shape (3,); angle in [0, pi]."""
    x, y, z, w = quat_from_rotation(rotation.tolist())
    vector = np.array([x, y, z]) * (1.0 if w >= 0.0 else -1.0)
    sine = float(np.linalg.norm(vector))
    if sine < 1e-12:
        return 2.0 * vector
    return np.asarray(vector * (2.0 * np.arctan2(sine, abs(w)) / sine))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Turn:
    """A joint of which the fixed part only renames axes: all turns of this robot's origins are quarter turns.

    Attributes:
        xyz: Offset in the parent [m].
        columns: For x, y, z of the joint frame: which axis of the parent it lies along.
        signs: ... and in which sense, 1 or -1.
        sense: Sense of the rotation about the joint frame's z; 0 for a fixed frame.
    """

    xyz: tuple[float, ...]
    columns: tuple[int, ...]
    signs: tuple[float, ...]
    sense: float


def _turn(origin: Array, sense: float) -> _Turn:
    rotation = origin[:3, :3]
    quarters = np.rint(rotation)
    if not np.allclose(rotation, quarters, atol=1e-9):
        raise ValueError(f"not a quarter turn: {rotation.tolist()}")
    columns = [int(index) for index in np.argmax(np.abs(quarters), axis=0)]
    signs = tuple(float(quarters[row, column]) for column, row in enumerate(columns))
    return _Turn(xyz=tuple(origin[:3, 3].tolist()), columns=tuple(columns), signs=signs, sense=sense)


class ArmGeometry:
    """Kinematics of one arm between its shoulder frame and its end-effector frame."""

    def __init__(self, side: Side) -> None:
        """Multiply the fixed parts out once."""
        self.side = side
        self.lower_rad = np.array(LOWER_RAD[side])
        self.upper_rad = np.array(UPPER_RAD[side])
        shoulder = _origin(*_VIRTUAL_BASE) @ _origin(*_SHOULDER[side])
        origins = [_origin(xyz, rpy) for xyz, rpy, _ in _JOINTS[side]]
        origins[0] = np.linalg.inv(shoulder) @ origins[0]
        self._origins = np.stack(origins)
        self._signs = np.array([sign for _, _, sign in _JOINTS[side]])
        self._ee = _origin(*_EE[side])
        senses = [*self._signs.tolist(), 0.0]
        self._turns = [_turn(origin, sense) for origin, sense in zip([*origins, self._ee], senses, strict=True)]

    def _chain(self, q_rad: Array) -> tuple[Array, Array]:
        """Return the joint frames (7, 4, 4) and the end-effector frame (4, 4) in the shoulder frame."""
        angles = self._signs * q_rad
        c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
        local = self._origins.copy()
        x, y = self._origins[:, :, 0], self._origins[:, :, 1]
        local[:, :, 0] = c * x + s * y
        local[:, :, 1] = c * y - s * x
        frames = np.empty((DOF, 4, 4))
        frame = local[0]
        frames[0] = frame
        for index in range(1, DOF):
            frame = frame @ local[index]
            frames[index] = frame
        return frames, frame @ self._ee

    def forward(self, q_rad: Array | Sequence[float]) -> EePose:
        """Return the end-effector pose in the shoulder frame.

        The same chain as `inverse` uses, in plain floats: at 400 poses a second numpy's cost per call would count.

        Args:
            q_rad: Joint angles, shape (7,) [rad], index order of §4.0.3.
        """
        x_axis, y_axis, z_axis = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
        px = py = pz = 0.0
        for turn, angle in zip(self._turns, (*map(float, q_rad), 0.0), strict=True):
            x, y, z = turn.xyz
            px += x_axis[0] * x + y_axis[0] * y + z_axis[0] * z
            py += x_axis[1] * x + y_axis[1] * y + z_axis[1] * z
            pz += x_axis[2] * x + y_axis[2] * y + z_axis[2] * z
            columns = (x_axis, y_axis, z_axis)
            (a0, a1, a2), (b0, b1, b2) = columns[turn.columns[0]], columns[turn.columns[1]]
            c, s = math.cos(angle), math.sin(angle) * turn.sense
            ca, sa, cb, sb = c * turn.signs[0], s * turn.signs[0], c * turn.signs[1], s * turn.signs[1]
            c0, c1, c2 = columns[turn.columns[2]]
            x_axis = (ca * a0 + sb * b0, ca * a1 + sb * b1, ca * a2 + sb * b2)
            y_axis = (cb * b0 - sa * a0, cb * b1 - sa * a1, cb * b2 - sa * a2)
            z_axis = (turn.signs[2] * c0, turn.signs[2] * c1, turn.signs[2] * c2)
        rows = tuple(zip(x_axis, y_axis, z_axis, strict=True))
        return EePose(position_m=(px, py, pz), quat_xyzw=quat_from_rotation(rows))

    def jacobian(self, q_rad: Array | Sequence[float]) -> Array:
        """Return the geometric Jacobian (linear rows first) in the shoulder frame, shape (6, 7)."""
        frames, ee = self._chain(np.asarray(q_rad, dtype=np.float64))
        return self._jacobian(frames, ee)

    def _jacobian(self, frames: Array, ee: Array) -> Array:
        axes = frames[:, :3, 2] * self._signs[:, None]
        jacobian = np.empty((6, DOF))
        jacobian[:3] = np.cross(axes, ee[:3, 3] - frames[:, :3, 3]).T
        jacobian[3:] = axes.T
        return jacobian

    def inverse(self, pose: EePose, q_start_rad: Array | Sequence[float]) -> Array | None:
        """Return joint angles inside §4.13 that reach a pose, found from `q_start_rad`; None when there are none.

        Damped least squares with a damping that shrinks with the error. A joint at its limit that would have to go
        further is left out of the step.

        Args:
            pose: Wanted pose in the shoulder frame; must be finite with a non-zero quaternion.
            q_start_rad: Where the search begins, shape (7,) [rad].
        """
        wanted_m = np.array(pose.position_m)
        wanted = rotation_from_quat(pose.quat_xyzw)
        q_rad = np.clip(np.asarray(q_start_rad, dtype=np.float64), self.lower_rad, self.upper_rad)
        best, best_at = math.inf, 0
        for iteration in range(_MAX_ITERATIONS):
            frames, ee = self._chain(q_rad)
            error = np.concatenate((wanted_m - ee[:3, 3], rotation_vector(wanted @ ee[:3, :3].T)))
            if np.linalg.norm(error[:3]) < POSE_TOLERANCE_M and np.linalg.norm(error[3:]) < POSE_TOLERANCE_RAD:
                return q_rad
            size = float(error @ error)
            if size < 0.5 * best:
                best, best_at = size, iteration
            elif iteration - best_at >= _PATIENCE:
                return None
            q_rad = self._step(q_rad, self._jacobian(frames, ee), error)
        return None

    def _step(self, q_rad: Array, jacobian: Array, error: Array) -> Array:
        """Return the joint angles after one damped step that respects the limits."""
        weighted = error.copy()
        weighted[:3] /= 0.3  # metres to radians at about half an arm's length, so that both parts count alike
        rows = jacobian.copy()
        rows[:3] /= 0.3
        damping = 1e-8 + 1e-2 * min(float(weighted @ weighted), 1.0)
        free = np.ones(DOF, dtype=bool)
        step = np.zeros(DOF)
        for _ in range(DOF):
            active = rows[:, free]
            step = np.zeros(DOF)
            step[free] = active.T @ np.linalg.solve(active @ active.T + damping * np.eye(6), weighted)
            pushing = ((q_rad <= self.lower_rad) & (step < 0.0)) | ((q_rad >= self.upper_rad) & (step > 0.0))
            if not np.any(pushing & free):
                break
            free &= ~pushing
        largest = float(np.max(np.abs(step)))
        if largest > _MAX_STEP_RAD:
            step *= _MAX_STEP_RAD / largest
        return np.asarray(np.clip(q_rad + step, self.lower_rad, self.upper_rad))


_GEOMETRY: Final = {side: ArmGeometry(side) for side in Side}


def arm_geometry(side: Side) -> ArmGeometry:
    """Return the (immutable, shared) geometry of an arm."""
    return _GEOMETRY[side]
