"""Transform: where one frame is in another, with both names on it, so that a wrong product cannot be formed.

`a_T_b` takes coordinates in frame b to coordinates in frame a (manual, appendix A.1). `a_T_b @ b_T_c` is `a_T_c`; any
other product is a `FrameMismatch`, which is a TypeError: frames are types here, checked when the product is formed.
Points carry the name of their frame for the same reason.

Metres and radians; right-handed frames; quaternions xyzw. Millimetres are for files (`calibration.py`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gateway.kinematics.placement import quat_from_rows, rows_from_quat, turn_rad
from gateway.values import ValueRefused

__all__ = ["RIGID_TOLERANCE", "Array", "FrameMismatch", "Points", "Transform", "frames_of", "nearest_rigid"]

Array = NDArray[np.float64]

INFIX: Final = "_T_"
"""Stands between parent and child in the name of a transform (A.1)."""

RIGID_TOLERANCE: Final = 1e-6
"""How far a rotation may be from orthonormal, largest element of RᵀR − 1. Files with few digits: `nearest_rigid`."""


class FrameMismatch(TypeError):
    """Two frames that had to be the same are not: the product would mean nothing."""


def frames_of(name: str) -> tuple[str, str]:
    """Return parent and child of a transform's name, `parent_T_child` (A.1).

    Raises:
        ValueRefused: The name is not of that form.
    """
    parent, infix, child = name.partition(INFIX)
    if not infix or not parent.isidentifier() or not child.isidentifier() or INFIX in child:
        raise ValueRefused(f"{name!r} does not name a transform: parent{INFIX}child is needed (manual A.1)")
    return parent, child


def nearest_rigid(matrix: ArrayLike) -> tuple[Array, float]:
    """Return the rigid transform nearest to a 4 × 4 matrix, and how far its rotation was from orthonormal.

    A file with four digits, as the manual prints (A.3), is some 1e-5 off. What is allowed, the caller decides.

    Args:
        matrix: Shape (4, 4); translation in any unit, kept as it is.

    Returns:
        The matrix with the nearest rotation (by singular values), and the largest element of RᵀR − 1 before.

    Raises:
        ValueRefused: Wrong shape, not finite, last row not 0 0 0 1, or a mirror image.
    """
    given = _checked(matrix)
    error = _orthogonality_error(given)
    u, _, vt = np.linalg.svd(given[:3, :3])
    rigid = given.copy()
    rigid[:3, :3] = u @ vt
    return rigid, error


def _checked(matrix: ArrayLike) -> Array:
    given = np.array(matrix, dtype=np.float64)
    if given.shape != (4, 4):
        raise ValueRefused(f"a transform has shape (4, 4), not {given.shape}")
    if not np.isfinite(given).all():
        raise ValueRefused("a transform has an element that is not finite")
    if np.abs(given[3] - (0.0, 0.0, 0.0, 1.0)).max() > RIGID_TOLERANCE:
        raise ValueRefused(f"the last row of a transform is 0 0 0 1, not {given[3].tolist()}: is it column-major?")
    if np.linalg.det(given[:3, :3]) <= 0.0:
        raise ValueRefused("the rotation of a transform is a mirror image; all frames are right-handed (manual A.1)")
    return given


def _orthogonality_error(matrix: Array) -> float:
    rotation = matrix[:3, :3]
    return float(np.abs(rotation.T @ rotation - np.eye(3)).max())


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Points, with the frame that their coordinates are in.

    Attributes:
        frame: Name of the frame.
        xyz_m: Coordinates, shape (..., 3) [m]; read-only.
    """

    frame: str
    xyz_m: Array

    def __post_init__(self) -> None:
        """Refuse other shapes."""
        xyz_m = np.array(self.xyz_m, dtype=np.float64)
        if xyz_m.ndim == 0 or xyz_m.shape[-1] != 3:
            raise ValueRefused(f"points have shape (..., 3), not {xyz_m.shape}")
        xyz_m.setflags(write=False)
        object.__setattr__(self, "xyz_m", xyz_m)


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """Frame `child` in frame `parent`: `parent_T_child`.

    Attributes:
        parent: Frame that the coordinates come out in.
        child: Frame that they go in from.
        matrix: Homogeneous, shape (4, 4), translation [m]; read-only.

    Raises:
        ValueRefused: The matrix is not a rigid transform (`RIGID_TOLERANCE`), or a name is none of a frame.
    """

    parent: str
    child: str
    matrix: Array

    __array_ufunc__: ClassVar[None] = None  # a bare array knows no frames: multiplying one is a TypeError

    def __post_init__(self) -> None:
        """Check names and matrix, keep a read-only copy."""
        frames_of(self.name)
        matrix = _checked(self.matrix)
        error = _orthogonality_error(matrix)
        if error > RIGID_TOLERANCE:
            raise ValueRefused(
                f"{self.name}: the rotation is {error:.1e} from orthonormal, up to {RIGID_TOLERANCE:.0e} is allowed"
            )
        self._keep(matrix)

    def _keep(self, matrix: Array) -> None:
        matrix.setflags(write=False)
        object.__setattr__(self, "matrix", matrix)

    @classmethod
    def _product(cls, parent: str, child: str, matrix: Array) -> Transform:
        """Return a transform that is rigid because its factors were."""
        made = object.__new__(cls)
        object.__setattr__(made, "parent", parent)
        object.__setattr__(made, "child", child)
        made._keep(matrix)
        return made

    @classmethod
    def named(cls, name: str, matrix: ArrayLike) -> Transform:
        """Return the transform of a name `parent_T_child` (A.1); translation [m]."""
        parent, child = frames_of(name)
        return cls(parent, child, np.asarray(matrix, dtype=np.float64))

    @classmethod
    def of(cls, name: str, *, p_m: Sequence[float] = (0.0, 0.0, 0.0), rotation: ArrayLike | None = None) -> Transform:
        """Return the transform of a name from its parts.

        Args:
            name: `parent_T_child`.
            p_m: Origin of the child in the parent, shape (3,) [m].
            rotation: Axes of the child in the parent as columns, shape (3, 3); None for parallel frames.
        """
        matrix = np.eye(4)
        if rotation is not None:
            matrix[:3, :3] = rotation
        matrix[:3, 3] = p_m
        return cls.named(name, matrix)

    @classmethod
    def of_quaternion(cls, name: str, p_m: Sequence[float], quat_xyzw: Sequence[float]) -> Transform:
        """Return the transform of a name from position [m] and orientation (xyzw, any length but 0)."""
        quat = np.asarray(quat_xyzw, dtype=np.float64)
        norm = float(np.linalg.norm(quat)) if quat.shape == (4,) else 0.0
        if not (np.isfinite(norm) and norm > 0.0):
            raise ValueRefused(f"{name}: an orientation is four finite numbers xyzw, not all 0, not {quat.tolist()}")
        return cls.of(name, p_m=p_m, rotation=rows_from_quat((quat / norm).tolist()))

    @classmethod
    def still(cls, frame: str) -> Transform:
        """Return a frame in itself."""
        return cls._product(frame, frame, np.eye(4))

    @property
    def name(self) -> str:
        """`parent_T_child`."""
        return f"{self.parent}{INFIX}{self.child}"

    @property
    def p_m(self) -> Array:
        """Origin of the child in the parent, shape (3,) [m]."""
        return self.matrix[:3, 3]

    @property
    def rotation(self) -> Array:
        """Axes of the child in the parent as columns, shape (3, 3)."""
        return self.matrix[:3, :3]

    @property
    def quat_xyzw(self) -> Array:
        """Orientation of the child in the parent, unit norm, w >= 0, shape (4,)."""
        return np.array(quat_from_rows(self.rotation.tolist()))

    @property
    def inverse(self) -> Transform:
        """`child_T_parent`."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation.T
        matrix[:3, 3] = -self.rotation.T @ self.p_m
        return Transform._product(self.child, self.parent, matrix)

    @overload
    def __matmul__(self, other: Transform) -> Transform: ...
    @overload
    def __matmul__(self, other: Points) -> Points: ...
    def __matmul__(self, other: Transform | Points) -> Transform | Points:
        """Return `parent_T_grandchild`, or points in the parent.

        Raises:
            FrameMismatch: The frames that meet are not one.
        """
        if isinstance(other, Transform):
            if self.child != other.parent:
                raise FrameMismatch(
                    f"{self.name} @ {other.name}: {self.child} is not {other.parent}; a_T_b @ b_T_c is needed (manual A.1)"
                )
            return Transform._product(self.parent, other.child, self.matrix @ other.matrix)
        if isinstance(other, Points):
            if self.child != other.frame:
                raise FrameMismatch(f"{self.name} takes points in {self.child}, these are in {other.frame}")
            return Points(self.parent, other.xyz_m @ self.rotation.T + self.p_m)
        return NotImplemented

    def angle_to_rad(self, other: Transform) -> float:
        """Return the angle between the orientations of two transforms of one name, 0 to π [rad].

        Raises:
            FrameMismatch: They are of different frames.
        """
        self._require_same(other)
        return math.hypot(*turn_rad(self.rotation.tolist(), other.rotation.tolist()))

    def distance_to_m(self, other: Transform) -> float:
        """Return the distance between the origins of two transforms of one name [m].

        Raises:
            FrameMismatch: They are of different frames.
        """
        self._require_same(other)
        return float(np.linalg.norm(self.p_m - other.p_m))

    def _require_same(self, other: Transform) -> None:
        if (self.parent, self.child) != (other.parent, other.child):
            raise FrameMismatch(f"{self.name} and {other.name} are not of the same frames")
