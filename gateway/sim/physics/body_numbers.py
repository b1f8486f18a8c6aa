"""The body's published numbers as the physics reads them: joints, inertias, cameras, gripper, wheels.

Reads the data file of the gateway's kinematics and none of its code: numbers are facts, what is made of them must be
able to disagree. Units as in the file: m, rad, kg, kg m², N m or N. Transforms are `parent_T_child`, shape (4, 4).
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = ["DATA", "BodyNumbers", "Inertia", "Joint", "body_numbers", "quat_wxyz", "transform"]

Array = NDArray[np.float64]

DATA: Final = Path(__file__).parents[2] / "kinematics" / "teleavatar2.toml"
"""Where the numbers stand, each with its source."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """A joint, fixed or moving.

    Attributes:
        name: Of the description.
        kind: `fixed`, `revolute`, `continuous` or `prismatic`.
        parent: Link that carries it.
        child: Link that it moves.
        parent_T_child: Where the child is with the joint at zero, shape (4, 4) [m].
        axis: In the child's frame; unit length.
        lower: Range [rad or m]; 0 where there is none.
        upper: The same.
        effort: Greatest torque or force of its motor [N m or N]; 0 for a fixed joint.
    """

    name: str
    kind: str
    parent: str
    child: str
    parent_T_child: Array
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    lower: float = 0.0
    upper: float = 0.0
    effort: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Inertia:
    """Mass of a link.

    Attributes:
        mass_kg: Mass [kg].
        com_m: Centre of mass in the link's frame [m].
        inertia_kgm2: ixx ixy ixz iyy iyz izz about the centre of mass, along the link's axes [kg m²].
    """

    mass_kg: float
    com_m: tuple[float, float, float]
    inertia_kgm2: tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyNumbers:
    """All of it.

    Attributes:
        joints: Parents first.
        inertias: By link.
        cameras: Tables of the file by name.
        gripper: Tables of the file by side.
        axle_height_m: Of the wheels' axes above the ground [m].
    """

    joints: tuple[Joint, ...]
    inertias: dict[str, Inertia]
    cameras: dict[str, dict[str, Any]]
    gripper: dict[str, dict[str, Any]]
    axle_height_m: float

    def joint(self, name: str) -> Joint:
        """Return a joint by name.

        Raises:
            KeyError: If there is none; the text lists those there are.
        """
        for joint in self.joints:
            if joint.name == name:
                return joint
        raise KeyError(f"no joint {name!r} in {DATA.name}; there are {', '.join(joint.name for joint in self.joints)}")


@lru_cache(maxsize=1)
def body_numbers() -> BodyNumbers:
    """Return the numbers of the file.

    Raises:
        OSError: If the file is not there.
    """
    table = tomllib.loads(DATA.read_text(encoding="utf-8"))
    return BodyNumbers(
        joints=tuple(
            Joint(
                name=row["name"],
                kind=row["kind"],
                parent=row["parent"],
                child=row["child"],
                parent_T_child=transform(row["xyz_m"], row["rpy_rad"]),
                axis=tuple(row.get("axis", (0.0, 0.0, 1.0))),
                lower=row.get("lower", 0.0),
                upper=row.get("upper", 0.0),
                effort=row.get("effort", 0.0),
            )
            for row in table["joints"]
        ),
        inertias={
            row["link"]: Inertia(
                mass_kg=row["mass_kg"], com_m=tuple(row["com_m"]), inertia_kgm2=tuple(row["inertia_kgm2"])
            )
            for row in table["inertias"]
        },
        cameras=table["cameras"],
        gripper=table["gripper"],
        axle_height_m=table["chassis"]["axle_height_m"],
    )


def transform(xyz_m: tuple[float, ...], rpy_rad: tuple[float, ...]) -> Array:
    """Return a transform of a URDF origin: roll, pitch and yaw about fixed axes, in this order; shape (4, 4)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy_rad), np.sin(rpy_rad)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    about_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    placed = np.eye(4)
    placed[:3, :3] = about_z @ about_y @ about_x
    placed[:3, 3] = xyz_m
    return placed


def quat_wxyz(rotation: Array) -> tuple[float, float, float, float]:
    """Return the unit quaternion of a rotation in MuJoCo's order: w, x, y, z.

    Args:
        rotation: Rotation matrix, shape (3, 3); of a transform the upper left part counts.
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation[:3, :3].tolist()
    squares = (1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i)
    largest = squares.index(max(squares))
    w, x, y, z = (
        (squares[0], h - f, c - g, d - b),
        (h - f, squares[1], b + d, g + c),
        (c - g, b + d, squares[2], f + h),
        (d - b, g + c, f + h, squares[3]),
    )[largest]
    scale = 0.5 / float(np.sqrt(squares[largest]))
    return (scale * w, scale * x, scale * y, scale * z)
