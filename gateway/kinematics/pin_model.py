"""The body as a model of pinocchio, built in code from a description: for dynamics and distances, and as a second opinion.

The only module of the kinematics that imports pinocchio (extra `body`): whoever needs it imports this on purpose.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from gateway.kinematics.description import Description, Inertia, Joint, Kind
from gateway.kinematics.placement import Placement, origin

__all__ = ["pin_model"]


def pin_model(description: Description) -> Any:  # noqa: ANN401  pinocchio has no types
    """Return a `pinocchio.Model` with every moving joint of a description, by its name, and a frame for every link.

    Wheels, which have no range, are revolute joints with an infinite one, so that each joint has one coordinate. Links
    that are fixed to another one are part of its body.

    Args:
        description: Of the body; parents come before children.
    """
    model = pin.Model()
    model.name = description.source
    at = {root: _Place(0, 0, pin.SE3.Identity()) for root in _roots(description)}
    for root, place in at.items():
        at[root] = _add_link(model, description, root, place)
    for joint in description.joints.values():
        index, frame, placement = at[joint.parent]
        placement = placement * _se3(origin(joint))
        if joint.kind is not Kind.FIXED:
            index = model.addJoint(index, _motion(joint), placement, joint.name, *_limits(joint))
            frame = model.addJointFrame(index, frame)
            placement = pin.SE3.Identity()
        at[joint.child] = _add_link(model, description, joint.child, _Place(index, frame, placement))
    return model


class _Place(NamedTuple):
    """Where a link hangs: joint, frame before it, placement in the joint's frame."""

    joint: int
    frame: int
    placement: Any


def _roots(description: Description) -> list[str]:
    children = {joint.child for joint in description.joints.values()}
    return sorted({joint.parent for joint in description.joints.values()} - children)


def _add_link(model: Any, description: Description, link: str, place: _Place) -> _Place:  # noqa: ANN401
    """Add a link's frame and mass; return the place of what hangs on it."""
    frame = model.addFrame(pin.Frame(link, place.joint, place.frame, place.placement, pin.FrameType.BODY))
    inertia = description.inertias.get(link)
    if inertia is not None:
        model.appendBodyToJoint(place.joint, _inertia(inertia), place.placement)
    return place._replace(frame=frame)


def _motion(joint: Joint) -> Any:  # noqa: ANN401
    axis = np.array(joint.axis)
    return (
        pin.JointModelPrismaticUnaligned(axis)
        if joint.kind is Kind.PRISMATIC
        else pin.JointModelRevoluteUnaligned(axis)
    )


def _limits(joint: Joint) -> tuple[Any, ...]:
    """Return greatest effort, greatest velocity, lowest and highest position."""
    return tuple(np.array([value]) for value in (joint.effort, joint.velocity, joint.lower, joint.upper))


def _se3(placement: Placement) -> Any:  # noqa: ANN401
    return pin.SE3(np.array(placement.rows), np.array(placement.p_m))


def _inertia(inertia: Inertia) -> Any:  # noqa: ANN401
    xx, xy, xz, yy, yz, zz = inertia.inertia_kgm2
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return pin.Inertia(inertia.mass_kg, np.array(inertia.com_m), matrix)
