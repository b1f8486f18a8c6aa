"""A second opinion on distances: pinocchio with coal's capsules, where the extra `body` is installed."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gateway.kinematics.collision import CollisionModel
from gateway.kinematics.description import arm_joint, nominal
from gateway.kinematics.solving.chain import in_base
from gateway.robot.topics import shoulder_frame
from gateway.values import Side, Vector

__all__ = ["has_pinocchio", "pinocchio_least"]

Both = Mapping[Side, Vector]


def has_pinocchio() -> bool:
    """Whether it is installed."""
    return all(importlib.util.find_spec(name) is not None for name in ("pinocchio", "coal"))


def pinocchio_least(model: CollisionModel) -> Callable[[Both], float]:
    """Return pinocchio's distance of the same capsules and pairs [m], for joint angles of both arms."""
    import coal
    import pinocchio as pin

    from gateway.kinematics.pin_model import pin_model

    body = pin_model(nominal())
    rest = pin.neutral(body)
    data = body.createData()
    pin.forwardKinematics(body, data, rest)
    shoulders = [in_base(nominal(), shoulder_frame(side)) for side in Side]
    middle = 0.5 * (np.array(shoulders[0].p_m) + np.array(shoulders[1].p_m))
    base_T_chest = pin.SE3(np.array(shoulders[0].rows), middle)
    shapes = pin.GeometryModel()
    zero: Any = {side: (0.0,) * 7 for side in Side}
    for capsule, piece in zip(model.capsules, model.posture(zero).segments, strict=True):
        way, length = np.array(piece[3:6]), math.sqrt(piece[6])
        turned = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), way / length).matrix()
        placed = base_T_chest * pin.SE3(turned, np.array(piece[:3]) + 0.5 * way)
        joint = body.getJointId(arm_joint(capsule.side, capsule.after)) if capsule.side and capsule.after else 0
        shape = coal.Capsule(capsule.radius_m, length)
        shapes.addGeometryObject(pin.GeometryObject(capsule.name, joint, data.oMi[joint].actInv(placed), shape))
    for i, j, _, _ in model.pairs:
        shapes.addCollisionPair(pin.CollisionPair(i, j))
    found = pin.GeometryData(shapes)
    index = {side: [body.joints[body.getJointId(arm_joint(side, n))].idx_q for n in range(1, 8)] for side in Side}

    def least(q_rad: Both) -> float:
        q = rest.copy()
        for side in Side:
            q[index[side]] = q_rad[side]
        number = pin.computeDistances(body, data, shapes, found, q)
        return found.distanceResults[number].min_distance

    return least
