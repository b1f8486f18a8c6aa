"""A user's URDF as a description: the vendor's own file, or a single robot's calibrated one, in place of our numbers.

Joints are found by name: `armL1_joint` ... as the vendor has them, or `l_joint1` ... as the robot's topics do, and the
fixed joints or links of the shoulder and end-effector frames. Everything else in the tree is taken as it is. What a URDF
cannot say (cameras' eyes, the gripper's linkage) stays ours. Meshes are not read.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from msgspec.structs import replace

from gateway.errors import Code, GatewayError, failure
from gateway.kinematics.description import (
    Description,
    Inertia,
    Joint,
    Kind,
    arm_joint,
    ee_frame,
    nominal,
    shoulder_joint,
)
from gateway.kinematics.placement import rows_from_rpy
from gateway.robot.topics import ARM_JOINTS, shoulder_frame
from gateway.values import ARM_DOF, Side, Vector

__all__ = ["from_urdf"]

ALIASES = {ARM_JOINTS[side][n - 1]: arm_joint(side, n) for side in Side for n in range(1, ARM_DOF + 1)}
"""Names of the robot's topics -> the description's."""

NEEDED_FRAMES = {frame: joint for side in Side for frame, joint in (
    (shoulder_frame(side), shoulder_joint(side)), (ee_frame(side), f"{side}_ee_joint"))}  # fmt: skip
"""Links that poses are told in -> the fixed joint that they hang on."""

TINY = 1e-6
"""An axis shorter than this is none."""


def from_urdf(path: Path | str) -> Description:
    """Return the description of a URDF.

    Args:
        path: Of the file; plain URDF, xacro is not run.

    Raises:
        ConfigError: It cannot be read, is no URDF, or lacks something; the message names all that is missing.
    """
    try:
        robot = ElementTree.parse(path).getroot()
    except OSError as error:
        raise _error(
            path, f"cannot be read: {error.strerror or error}", "check path and permissions of the file"
        ) from error
    except ElementTree.ParseError as error:
        raise _error(path, f"is not XML: {error}", "give the plain .urdf, not a .xacro or an archive") from error
    if robot.tag != "robot":
        raise _error(path, f"is no URDF: its root is <{robot.tag}>, <robot> is needed", "give the plain .urdf")
    joints = [_joint(path, element) for element in robot.findall("joint")]
    named = {ALIASES.get(joint.name, joint.name): joint for joint in joints}
    _require(path, named)
    inertias = dict(_inertias(path, robot))
    ours = nominal()
    return Description(
        source=f"{robot.get('name', 'robot')} ({path})",
        joints={joint.name: joint for joint in _in_order(path, named)},
        inertias=inertias,
        cameras=ours.cameras,
        gripper=ours.gripper,
        chassis=ours.chassis,
    )


def _require(path: Path | str, named: Mapping[str, Joint]) -> None:
    """Refuse a tree without the arms or the frames of their poses, or with joints that do not move as arms do."""
    children = {joint.child for joint in named.values()}
    missing = [
        f"joint {name!r} (or {alias!r})" for alias, name in ALIASES.items() if name not in named
    ] + [f"link {frame!r}" for frame in NEEDED_FRAMES if frame not in children]  # fmt: skip
    if missing:
        hint = "give the vendor's description of TeleAvatar 2, or add what is missing; names must be these"
        raise _error(path, f"lacks {len(missing)} of what is needed: {', '.join(missing)}", hint)
    stiff = [name for name in ALIASES.values() if named[name].kind not in (Kind.REVOLUTE, Kind.CONTINUOUS)]
    if stiff:
        raise _error(path, f"has arm joints that do not turn: {', '.join(stiff)}", "give revolute joints")


def _in_order(path: Path | str, named: Mapping[str, Joint]) -> Iterator[Joint]:
    """Yield the joints with parents before children, under the description's names."""
    children = [joint.child for joint in named.values()]
    twice = sorted({child for child in children if children.count(child) > 1})
    if twice:
        raise _error(path, f"is no tree: {', '.join(twice)} hang on several joints", "give each link one parent")
    roots = {joint.parent for joint in named.values()} - set(children)
    if len(roots) != 1:
        raise _error(
            path, f"is no tree: it has the roots {', '.join(sorted(roots)) or 'none'}", "give it one base link"
        )
    waiting, known = dict(named), set(roots)
    while waiting:
        ready = [name for name, joint in waiting.items() if joint.parent in known]
        if not ready:
            raise _error(path, f"is no tree: {', '.join(sorted(waiting))} hang on each other", "break the circle")
        for name in ready:
            joint = waiting.pop(name)
            known.add(joint.child)
            yield replace(joint, name=name)


def _joint(path: Path | str, element: ElementTree.Element) -> Joint:
    name = element.get("name", "")
    kind = element.get("type", "")
    if kind not in {k.value for k in Kind}:
        raise _error(
            path, f"joint {name!r} is {kind!r}; known: {', '.join(k.value for k in Kind)}", "model it with these"
        )
    place, limit = element.find("origin"), element.find("limit")
    joint = Joint(
        name=name,
        kind=Kind(kind),
        parent=_link(path, element, name, "parent"),
        child=_link(path, element, name, "child"),
        xyz_m=_numbers(path, name, "origin xyz", place, "xyz", "0 0 0"),
        rpy_rad=_numbers(path, name, "origin rpy", place, "rpy", "0 0 0"),
    )
    if joint.kind is Kind.FIXED:
        return joint
    axis = _numbers(path, name, "axis", element.find("axis"), "xyz", "1 0 0")
    length = math.hypot(*axis)
    if length < TINY:
        raise _error(path, f"joint {name!r} has an axis without length: {axis}", "give a direction")
    joint = replace(joint, axis=tuple(c / length for c in axis))
    (effort,) = _numbers(path, name, "limit effort", limit, "effort", "0")
    (velocity,) = _numbers(path, name, "limit velocity", limit, "velocity", "0")
    joint = replace(joint, effort=effort, velocity=velocity)
    if joint.kind is Kind.CONTINUOUS:
        return joint
    if limit is None:
        raise _error(path, f"joint {name!r} is {kind} and has no <limit>", "add lower and upper")
    (lower,) = _numbers(path, name, "limit lower", limit, "lower", "0")
    (upper,) = _numbers(path, name, "limit upper", limit, "upper", "0")
    if not lower < upper:
        raise _error(path, f"joint {name!r} has the range [{lower:g}, {upper:g}]", "give a lower below the upper")
    return replace(joint, lower=lower, upper=upper)


def _link(path: Path | str, element: ElementTree.Element, joint: str, which: str) -> str:
    found = element.find(which)
    link = "" if found is None else found.get("link", "")
    if not link:
        raise _error(path, f"joint {joint!r} has no {which} link", f'add <{which} link="..."/>')
    return link


def _inertias(path: Path | str, robot: ElementTree.Element) -> Iterator[tuple[str, Inertia]]:
    for link in robot.findall("link"):
        name, inertial = link.get("name", ""), link.find("inertial")
        if inertial is None:
            continue
        place, mass, tensor = inertial.find("origin"), inertial.find("mass"), inertial.find("inertia")
        (mass_kg,) = _numbers(path, name, "mass", mass, "value", "0")
        moments = [_numbers(path, name, key, tensor, key, "0")[0] for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")]
        com_m = _numbers(path, name, "inertial origin xyz", place, "xyz", "0 0 0")
        rpy_rad = _numbers(path, name, "inertial origin rpy", place, "rpy", "0 0 0")
        yield name, Inertia(mass_kg=mass_kg, com_m=com_m, inertia_kgm2=_turned(tuple(moments), rpy_rad))


def _turned(moments: Vector, rpy_rad: Vector) -> Vector:
    """Return an inertia tensor in the link's axes."""
    xx, xy, xz, yy, yz, zz = moments
    rows = np.array(rows_from_rpy(rpy_rad))
    tensor = rows @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ rows.T
    return tuple(tensor[np.triu_indices(3)].tolist())


def _numbers(
    path: Path | str, owner: str, what: str, element: ElementTree.Element | None, key: str, default: str
) -> Vector:
    """Return the numbers of an attribute, as many as the default has."""
    text = default if element is None else element.get(key, default)
    try:
        values = tuple(float(word) for word in text.split())
    except ValueError:
        values = ()
    if len(values) != len(default.split()) or not all(map(math.isfinite, values)):
        count = len(default.split())
        raise _error(path, f"{what} of {owner!r} is {text!r}; {count} finite numbers are needed", "correct it there")
    return values


def _error(path: Path | str, message: str, hint: str) -> GatewayError:
    return failure(Code.BAD_CONFIG, f"{path}: {message}", field="urdf", hint=hint)
