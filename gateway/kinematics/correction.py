"""Correction: by how much one robot's arm differs from the description: joint zeros, its end effector, its shoulder.

    shoulder_T_ee(q) = shoulder · chain(q + offsets) · ee

`q` is what the robot reports. An offset is what has to be added to it to get the angle that the geometry has; `ee` is where
the real end effector is in the description's one, and `shoulder` where the description's shoulder frame is in the real one.

A turn of the end effector about joint 7's axis is the same as an offset of joint 7, and a turn of the shoulder about joint
1's axis the same as one of joint 1: no measurement of poses can tell them apart. So neither has that turn: by convention it
belongs to the joint.
"""

from __future__ import annotations

import math
from operator import mul

from msgspec import Struct
from msgspec.structs import replace

from gateway.kinematics.description import Description, Joint, arm_joint, ee_frame, shoulder_joint
from gateway.kinematics.placement import Placement, Rows, origin, rows_from_quat, turn_rad
from gateway.values import ARM_DOF, Side, Vector, require_finite

__all__ = ["NOWHERE", "ArmCorrection", "built_in", "corrected"]

NOWHERE = Placement((0.0, 0.0, 0.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
"""No displacement."""


class ArmCorrection(Struct, frozen=True, kw_only=True):
    """What was identified on one arm of one robot.

    Attributes:
        offsets_rad: Added to the reported joint angles, shape (7,) [rad].
        ee: `nominal_ee_T_ee`: the end effector in the description's one.
        shoulder: `shoulder_T_nominal_shoulder`: the description's shoulder frame in that of the robot's poses.

    Raises:
        ValueRefused: Not seven finite offsets.
    """

    offsets_rad: Vector
    ee: Placement = NOWHERE
    shoulder: Placement = NOWHERE

    def __post_init__(self) -> None:
        """Refuse other lengths and what is not finite."""
        require_finite("joint_zero_offsets", self.offsets_rad, ARM_DOF)


def corrected(description: Description, side: Side, correction: ArmCorrection) -> Description:
    """Return a description with the correction of one arm built in: its chain takes what the robot reports."""
    joints = dict(description.joints)
    for number, offset in enumerate(correction.offsets_rad, start=1):
        joint = joints[arm_joint(side, number)]
        if offset:
            joints[joint.name] = _at(joint, origin(joint).after(_turn(joint.axis, offset)))
    if correction.ee != NOWHERE:
        (tip,) = [joint for joint in joints.values() if joint.child == ee_frame(side)]
        joints[tip.name] = _at(tip, origin(tip).after(correction.ee))
    if correction.shoulder != NOWHERE:
        mount = joints[shoulder_joint(side)]
        joints[mount.name] = _at(mount, origin(mount).after(correction.shoulder.inverse()))
    return replace(description, joints=joints, described=description.described or description)


def built_in(description: Description, side: Side) -> ArmCorrection:
    """Return the correction of an arm that is built in since it was described."""
    plain = description.described or description

    def moved(joint: Joint) -> Placement:
        return origin(plain.joints[joint.name]).inverse().after(origin(joint))

    turns = [(joint.axis, turn_rad(NOWHERE.rows, moved(joint).rows)) for joint in description.arm(side)]
    return ArmCorrection(
        offsets_rad=tuple([sum(map(mul, axis, turn)) for axis, turn in turns]),
        ee=moved(description.above(ee_frame(side))[-1]),
        shoulder=moved(description.joints[shoulder_joint(side)]).inverse(),
    )


def _turn(axis: Vector, angle_rad: float) -> Placement:
    x, y, z = (math.sin(0.5 * angle_rad) * c for c in axis)
    return Placement((0.0, 0.0, 0.0), rows_from_quat((x, y, z, math.cos(0.5 * angle_rad))))


def _at(joint: Joint, placement: Placement) -> Joint:
    return replace(joint, xyz_m=placement.p_m, rpy_rad=_rpy_rad(placement.rows))


def _rpy_rad(rows: Rows) -> Vector:
    """Return roll, pitch, yaw of a rotation; at a pitch of a quarter turn, where only one of them counts, roll is 0."""
    (xx, xy, _), (yx, yy, _), (zx, zy, zz) = rows
    level = math.hypot(xx, yx)
    if level < 1e-8:
        return 0.0, math.atan2(-zx, level), math.atan2(-xy, yy)
    return math.atan2(zy, zz), math.atan2(-zx, level), math.atan2(yx, xx)
