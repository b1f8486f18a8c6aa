"""The nominal frames: what is the same on every robot of the model, and stand-ins where the manual wants a calibration.

Fixed by the manual: the three transforms of A.3. Stand-ins for the four of A.4 come from the description's camera mounts
and the published baselines; they let projections work in the simulator and before a calibration, and are told wherever
they are used (`Located.stand_ins`). A robot's own file takes their place: `calibrated`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import numpy as np

from gateway.kinematics.description import Camera, Description
from gateway.kinematics.frames import (
    DEVICE_EDGES,
    NOMINAL_EDGES,
    ROOT,
    FixedEdge,
    Origin,
    base_frame,
    ee_frame,
    wrist_frame,
)
from gateway.kinematics.placement import rows_from_rpy
from gateway.kinematics.transform import Array, Transform
from gateway.robot.topics import shoulder_frame
from gateway.values import Side, Vector

__all__ = [
    "BASE_M",
    "HEAD_TILT_RAD",
    "REPLACEABLE",
    "calibrated",
    "nominal_edges",
    "right_wrist_eye_frame",
    "rotation_of_rpy",
]

HEAD_TILT_RAD: Final = math.radians(26.0)
"""How far the head's common optical axis points below the horizon (A.3)."""

BASE_M: Final = {Side.LEFT: (-0.10561, 0.22000, -0.19311), Side.RIGHT: (-0.10561, -0.22000, -0.19311)}
"""Origin of the arms' mounts in `virtual_base` [m] (A.3; the description has -0.105598, ±0.220000, -0.192546)."""

SHOULDER_NOTE: Final = (
    "taken as one frame: the manual does not place left_shoulder_base in its tree, and the description puts it "
    "0.56 mm above left_base_virtual of A.3"
)
MOUNT_NOTE: Final = "stand-in: mount and baseline of the description; this robot's own is needed (A.4)"
EYE_NOTE: Final = "left eye of the pair; the manual does not say where between the eyes the frame is"
OTHER_EYE_NOTE: Final = "stand-in: published baseline, parallel eyes; the pair's own calibration is needed (§5.5)"


def right_wrist_eye_frame(side: Side) -> str:
    """Return our name for the optical frame of a wrist pair's right eye; its left eye is `*_wrist_camera`."""
    return f"{side}_wrist_right_camera"


REPLACEABLE: Final = frozenset(
    {*DEVICE_EDGES, *(f"{wrist_frame(side)}_T_{right_wrist_eye_frame(side)}" for side in Side)}
)
"""Transforms that a calibration of one robot may give. The others that are fixed are the model's (A.3, A.6)."""


def rotation_of_rpy(rpy_rad: Vector) -> Array:
    """Return the rotation of roll, pitch, yaw about fixed axes, shape (3, 3): Rz(yaw) Ry(pitch) Rx(roll)."""
    return np.array(rows_from_rpy(rpy_rad), dtype=np.float64)


def nominal_edges(description: Description) -> tuple[FixedEdge, ...]:
    """Return every fixed edge of the tree, parents first, with stand-ins for what is calibrated on each robot.

    Args:
        description: Numbers of the body; its camera mounts make the stand-ins.
    """
    c, s = math.cos(HEAD_TILT_RAD), math.sin(HEAD_TILT_RAD)
    tilt = [[0.0, -s, c], [-1.0, 0.0, 0.0], [0.0, -c, -s]]
    half_m = 0.5 * description.cameras["head"].baseline_m
    edges = [
        _model(Transform.of(NOMINAL_EDGES[0], rotation=tilt), "26° below the horizon (A.3)"),
        _model(Transform.of(DEVICE_EDGES[0], p_m=(-half_m, 0.0, 0.0)), MOUNT_NOTE),
        _model(Transform.of(DEVICE_EDGES[1], p_m=(half_m, 0.0, 0.0)), MOUNT_NOTE),
    ]
    for side in Side:
        camera = description.cameras[f"{side}_wrist"]
        eyes = f"{wrist_frame(side)}_T_{right_wrist_eye_frame(side)}"
        shoulder = f"{base_frame(side)}_T_{shoulder_frame(side)}"
        edges += [
            _model(Transform.of(f"{ROOT}_T_{base_frame(side)}", p_m=BASE_M[side]), "A.3"),
            FixedEdge(
                transform=Transform.of(shoulder),
                origin=Origin.ASSUMPTION,
                is_of_one_robot=False,
                note=SHOULDER_NOTE.replace("left", side.value),
            ),
            _model(_wrist_camera(description, camera, side), f"{MOUNT_NOTE}; {EYE_NOTE}"),
            _model(Transform.of(eyes, p_m=(camera.baseline_m, 0.0, 0.0)), OTHER_EYE_NOTE),
        ]
    return tuple(edges)


def _model(transform: Transform, note: str) -> FixedEdge:
    return FixedEdge(transform=transform, origin=Origin.MECHANICAL_DESIGN, is_of_one_robot=False, note=note)


def _wrist_camera(description: Description, camera: Camera, side: Side) -> Transform:
    """Return the left eye of a wrist pair in the end effector's frame; its x axis points from left eye to right eye."""
    (joint,) = [joint for joint in description.joints.values() if joint.child == ee_frame(side)]
    hand = "hand"  # the gripper's base link, which carries both
    hand_T_ee = Transform.of(f"{hand}_T_{ee_frame(side)}", p_m=joint.xyz_m, rotation=rotation_of_rpy(joint.rpy_rad))
    hand_T_middle = Transform.of(f"{hand}_T_eyes", p_m=camera.xyz_m, rotation=rotation_of_rpy(camera.rpy_rad))
    middle_T_left = Transform.of(f"eyes_T_{wrist_frame(side)}", p_m=(-0.5 * camera.baseline_m, 0.0, 0.0))
    return hand_T_ee.inverse @ hand_T_middle @ middle_T_left


def calibrated(edges: Iterable[FixedEdge], own: Iterable[FixedEdge]) -> tuple[FixedEdge, ...]:
    """Return the edges, with those that a file gives in the place of those of the same name.

    Args:
        edges: All fixed edges.
        own: As `calibration.load` let them pass.
    """
    by_name = {edge.transform.name: edge for edge in own}
    return tuple(by_name.get(edge.transform.name, edge) for edge in edges)
