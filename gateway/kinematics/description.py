"""Description: the robot's body as data, wherever the numbers come from: our own file, or a URDF (`urdf.py`).

Joint tree, ranges, masses, cameras, gripper linkage. What follows from the numbers is worked out elsewhere. Frames and
joints have the names of the vendor's description: `armL1_joint` is `l_joint1` of the robot's topics, with the same sign
and zero; poses of an arm are those of `left_ee` in `left_shoulder_base` (manual §4.0).
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any

from msgspec import Struct

from gateway.values import ARM_DOF, Side, Vector

if sys.version_info >= (3, 11):
    import tomllib
else:  # the same parser under its old name
    import tomli as tomllib

__all__ = [
    "DATA_FILE",
    "ROOT",
    "Camera",
    "Description",
    "Inertia",
    "Joint",
    "Kind",
    "arm_joint",
    "ee_frame",
    "nominal",
    "shoulder_joint",
]

DATA_FILE = Path(__file__).with_name("teleavatar2.toml")
"""Our own numbers, with their sources."""

ROOT = "base_link"
"""The link that everything hangs on."""


def arm_joint(side: Side, number: int) -> str:
    """Return the description's name of joint 1 to 7 of an arm."""
    return f"arm{side.value[0].upper()}{number}_joint"


def shoulder_joint(side: Side) -> str:
    """Return the name of the fixed joint whose child is the frame in which an arm's poses are given (§4.0.1)."""
    return f"{side}_shoulder_base_joint"


def ee_frame(side: Side) -> str:
    """Return the name of an arm's end-effector frame."""
    return f"{side}_ee"


class Kind(str, Enum):
    """How a joint moves."""

    FIXED = "fixed"
    REVOLUTE = "revolute"
    CONTINUOUS = "continuous"
    PRISMATIC = "prismatic"


class Joint(Struct, frozen=True, kw_only=True):
    """One joint: where its frame is in its parent's link, and how the child moves in it.

    Attributes:
        name: The description's.
        kind: How it moves.
        parent: Link on the side of the base.
        child: Link that it moves; has the joint's frame.
        xyz_m: Origin in the parent's link, shape (3,) [m].
        rpy_rad: Roll, pitch, yaw about the parent's fixed axes, in this order, shape (3,) [rad].
        axis: Unit vector in the joint's own frame, shape (3,); zeros for a fixed joint.
        lower: Lowest position [rad or m]; -inf where there is no range.
        upper: Highest position [rad or m]; inf where there is no range.
        effort: Greatest effort of the motor [N m or N]; 0 when not given.
        velocity: Greatest velocity of the motor, no safe limit for users [rad/s or m/s]; 0 when not given.
    """

    name: str
    kind: Kind
    parent: str
    child: str
    xyz_m: Vector
    rpy_rad: Vector
    axis: Vector = (0.0, 0.0, 0.0)
    lower: float = -float("inf")
    upper: float = float("inf")
    effort: float = 0.0
    velocity: float = 0.0


class Inertia(Struct, frozen=True, kw_only=True):
    """Mass of a link.

    Attributes:
        mass_kg: Mass [kg].
        com_m: Centre of mass in the link's frame, shape (3,) [m].
        inertia_kgm2: ixx ixy ixz iyy iyz izz about it, axes of the link's frame, shape (6,) [kg m²].
    """

    mass_kg: float
    com_m: Vector
    inertia_kgm2: Vector


class Camera(Struct, frozen=True, kw_only=True):
    """A stereo camera: its nominal mount and what is known of its two eyes.

    Attributes:
        xyz_m: Middle between the eyes in the link that it sits on, shape (3,) [m].
        rpy_rad: Roll, pitch, yaw about the link's fixed axes, shape (3,) [rad].
        baseline_m: Distance of the eyes [m].
        sensor_px: Width and height of one eye's sensor [px].
        field_of_view_deg: Horizontal and vertical [deg].
        rate_hz: Frames per second [Hz].
    """

    xyz_m: Vector
    rpy_rad: Vector
    baseline_m: float
    sensor_px: tuple[int, int]
    field_of_view_deg: tuple[float, float]
    rate_hz: float


class Description(Struct, frozen=True, kw_only=True):
    """The whole body.

    Attributes:
        source: Where the numbers come from, for people.
        joints: By name; a joint's parent is the base or the child of a joint before it.
        inertias: By link; a link that is missing here weighs nothing.
        cameras: `head`, `left_wrist`, `right_wrist`.
        gripper: Tables `left` and `right` of the data file: what the linkage's module makes of them is its own affair.
        chassis: Table `chassis` of the data file.
        described: The body before what was measured on one robot was built in (`correction.py`); None where nothing was.
    """

    source: str
    joints: Mapping[str, Joint]
    inertias: Mapping[str, Inertia]
    cameras: Mapping[str, Camera]
    gripper: Mapping[str, Mapping[str, Any]]
    chassis: Mapping[str, float]
    described: Description | None = None

    def arm(self, side: Side) -> tuple[Joint, ...]:
        """Return the seven joints of an arm, in order of the robot's topics (§4.0.3)."""
        return tuple(self.joints[arm_joint(side, number)] for number in range(1, ARM_DOF + 1))

    def above(self, link: str) -> tuple[Joint, ...]:
        """Return the joints from the base to a link, in this order.

        Raises:
            KeyError: There is no such link.
        """
        by_child = {joint.child: joint for joint in self.joints.values()}
        chain = [by_child[link]]
        while chain[-1].parent in by_child:
            chain.append(by_child[chain[-1].parent])
        return tuple(reversed(chain))


@cache
def nominal() -> Description:
    """Return the description of our own data file."""
    with DATA_FILE.open("rb") as file:
        table = tomllib.load(file)
    return Description(
        source=table["source"],
        joints={row["name"]: _joint(row) for row in table["joints"]},
        inertias={row["link"]: _inertia(row) for row in table["inertias"]},
        cameras={name: _camera(row) for name, row in table["cameras"].items()},
        gripper=table["gripper"],
        chassis=table["chassis"],
    )


def _joint(row: Mapping[str, Any]) -> Joint:
    vectors = {name: tuple(row[name]) for name in ("xyz_m", "rpy_rad", "axis") if name in row}
    return Joint(**{**row, **vectors, "kind": Kind(row["kind"])})


def _inertia(row: Mapping[str, Any]) -> Inertia:
    return Inertia(mass_kg=row["mass_kg"], com_m=tuple(row["com_m"]), inertia_kgm2=tuple(row["inertia_kgm2"]))


def _camera(row: Mapping[str, Any]) -> Camera:
    width, height = row["sensor_px"]
    across, down = row["field_of_view_deg"]
    return Camera(
        xyz_m=tuple(row["xyz_m"]),
        rpy_rad=tuple(row["rpy_rad"]),
        baseline_m=row["baseline_m"],
        sensor_px=(width, height),
        field_of_view_deg=(across, down),
        rate_hz=row["rate_hz"],
    )
