"""A calibration file of an invented robot, written by the manual's conventions, and changed piece by piece in tests."""

from __future__ import annotations

import copy
import json

import numpy as np
from msgspec.structs import asdict

from gateway.kinematics.calibration import RobotIdentity
from gateway.kinematics.calibration_file.conventions import MANUAL
from gateway.kinematics.cameras.stereo import turned_level
from gateway.kinematics.transform import Transform
from tests.kinematics.lenses import EXAMPLE_K, skewed_pair

ROBOT = RobotIdentity(serial="TA2-0042", model="lift")
OTHER_ROBOT = RobotIdentity(serial="TA2-0043", model="lift")

PAIR = skewed_pair()
LEVEL = turned_level(PAIR)
CENTER_T_LEFT = Transform.of_quaternion(
    "head_camera_center_T_head_left_camera", (-0.0326, 0.0004, -0.0002), (0.005, -0.007, 0.003, 1.0)
)
WRIST = Transform.of_quaternion("left_ee_T_left_wrist_camera", (0.07, -0.05, 0.03), (0.12, -0.69, 0.1, 0.71))


def in_mm(transform):
    """Return a matrix as files have it: rows, millimetres."""
    matrix = transform.matrix.copy()
    matrix[:3, 3] *= 1e3
    return matrix.tolist()


def row(transform, source="arm_camera_calibration", **more):
    """Return the entry of a transform."""
    own = source != "mechanical_design"
    facts = {"parent_frame": transform.parent, "child_frame": transform.child, "source": source, "device_specific": own}
    return {**facts, "matrix": in_mm(transform), **more}


def camera():
    """Return the section of the head's camera."""
    return {
        "model": "opencv_fisheye",
        "width": 1920,
        "height": 1920,
        "KL": [957.752, 957.058, 953.094, 961.864],
        "DL": list(EXAMPLE_K),
        "KR": [955.1, 956.3, 960.2, 955.4],
        "DR": [-0.02, 0.003, -0.003, -0.0015],
        "R": PAIR.right_T_left.rotation.tolist(),
        "T": (1e3 * PAIR.right_T_left.p_m).tolist(),
        "RRawL_Row": LEVEL.level_R_left.ravel().tolist(),
        "RRawR_Row": LEVEL.level_R_right.ravel().tolist(),
    }


def wrist_camera():
    """Return the section of the left wrist's camera: two ideal eyes 50 mm apart."""
    lens = [600.0, 600.0, 639.5, 399.5]
    return {
        "model": "pinhole",
        "width": 1280,
        "height": 800,
        "KL": lens,
        "KR": lens,
        "R": np.eye(3).tolist(),
        "T": [-50.0, 0.0, 0.0],
    }


def document():
    """Return the whole file."""
    center_T_right = CENTER_T_LEFT @ PAIR.right_T_left.inverse
    rows = [row(CENTER_T_LEFT, "stereo_calibration"), row(center_T_right, "stereo_calibration"), row(WRIST)]
    return copy.deepcopy(
        {
            "robot": asdict(ROBOT),
            "conventions": asdict(MANUAL),
            "transforms": {f"{entry['parent_frame']}_T_{entry['child_frame']}": entry for entry in rows},
            "cameras": {"head": camera(), "left_wrist": wrist_camera()},
        }
    )


def written(folder, content, name="calibration.json"):
    """Write a file, and return its path."""
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return path
