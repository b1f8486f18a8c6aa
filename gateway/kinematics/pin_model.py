"""The body as a model of pinocchio, built in code from a description: for dynamics and distances, and as a second opinion.

The only module of the kinematics that imports pinocchio (extra `body`): whoever needs it imports this on purpose.
"""

from __future__ import annotations

from typing import Any

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
    at: dict[str, tuple[int, Any]] = {}
    for joint in description.joints.values():
        if joint.parent not in at:
            at[joint.parent] = (0, pin.SE3.Identity())
            _add_link(model, description, joint.parent, at[joint.parent])
        index, placement = at[joint.parent]
        placement = placement * _se3(origin(joint))
        if joint.kind is not Kind.FIXED:
            index = model.addJoint(index, _motion(joint), placement, joint.name, *_limits(joint))
            placement = pin.SE3.Identity()
        at[joint.child] = (index, placement)
        _add_link(model, description, joint.child, at[joint.child])
    return model


def _add_link(model: Any, description: Description, link: str, at: tuple[int, Any]) -> None:  # noqa: ANN401
    index, placement = at
    model.addFrame(pin.Frame(link, index, placement, pin.FrameType.BODY))
    inertia = description.inertias.get(link)
    if inertia is not None:
        model.appendBodyToJoint(index, _inertia(inertia), placement)


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
