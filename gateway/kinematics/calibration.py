"""Calibration: what was measured on one robot (manual §5.5, A.4), from a file, and never for another robot.

```json
{"robot": {"serial": "TA2-0042", "model": "standard"},
 "conventions": {"transform_naming": "parent_T_child", "matrix_layout": "row-major", "translation_unit": "mm",
                 "angle_unit": "rad", "quaternion_order": "xyzw", "handedness": "right",
                 "stereo_extrinsics": "right_T_left"},
 "transforms": {"left_ee_T_left_wrist_camera": {
     "parent_frame": "left_ee", "child_frame": "left_wrist_camera",
     "source": "arm_camera_calibration", "device_specific": true, "matrix": [[...], [...], [...], [0, 0, 0, 1]]}},
 "cameras": {"head": {"model": "opencv_fisheye", "width": 1920, "height": 1920,
     "KL": [fx, fy, cx, cy], "DL": [k1, k2, k3, k4], "KR": ..., "DR": ..., "R": [...], "T": [...],
     "RRawL_Row": [...], "RRawR_Row": [...]}},
 "arms": {"left": {...}}}
```

JSON or TOML. The manual names the transforms, their four facts, KL, KR, R, T and RRaw*_Row; it does not publish a file,
so the other keys are ours; `arms` is what `ta2 identify` writes (`arm_section.py`). Units and order are those that the file's
`conventions` say (`conventions.py`).

A file with anything that belongs to one robot must name that robot, and is refused by a gateway of another or of none.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from msgspec import Struct, field

from gateway.errors import Code, GatewayError, failure
from gateway.kinematics.calibration_file.arm_section import ArmCalibration, arm_of, with_arms
from gateway.kinematics.calibration_file.camera_section import CameraCalibration, camera_of
from gateway.kinematics.calibration_file.conventions import Conventions
from gateway.kinematics.calibration_file.dynamics_section import DynamicsCalibration, dynamics_of
from gateway.kinematics.cameras.eyes import CAMERAS
from gateway.kinematics.description import Description
from gateway.kinematics.frames import MOVING_EDGES, NOMINAL_EDGES, FixedEdge, Origin
from gateway.kinematics.nominal_frames import REPLACEABLE
from gateway.kinematics.transform import Transform, frames_of, nearest_rigid
from gateway.values import Side, ValueRefused

if sys.version_info >= (3, 11):
    import tomllib
else:  # the same parser under its old name
    import tomli as tomllib

__all__ = ["Calibration", "RobotIdentity", "load", "read"]

SECTIONS: Final = ("robot", "conventions", "transforms", "cameras", "arms", "dynamics")
TRANSFORM_KEYS: Final = frozenset(
    {"parent_frame", "child_frame", "source", "device_specific", "matrix", "translation", "quaternion", "note"}
)
RIGID_TOLERANCE: Final = 1e-3
"""How far a file's rotation may be from orthonormal: the manual itself prints four digits (A.3)."""
EYES_TOLERANCE_M: Final = 0.002
EYES_TOLERANCE_RAD: Final = math.radians(0.5)
"""How far the head's two mounts may be from what its stereo calibration says of them (ours)."""


class RobotIdentity(Struct, frozen=True, kw_only=True):
    """Which robot this is. The robot tells it on no topic: a person writes it into the configuration.

    Attributes:
        serial: Serial number, as on the robot's plate; case and outer spaces do not count.
        model: Key of `topics.VARIANTS`.
    """

    serial: str
    model: str

    def is_same(self, other: RobotIdentity) -> bool:
        """Return whether both are one robot."""
        return (self.serial.strip().casefold(), self.model) == (other.serial.strip().casefold(), other.model)

    def __str__(self) -> str:
        """Return serial number and model."""
        return f"{self.serial} ({self.model})"


class Calibration(Struct, frozen=True, kw_only=True):
    """What a file says.

    Attributes:
        path: The file.
        robot: Whose it is; None when nothing in it belongs to one robot.
        edges: Transforms, with their origin.
        cameras: Stereo cameras by name (`eyes.CAMERAS`).
        arms: Joint zeros and displaced frames of the arms that were identified.
        dynamics: Drives and masses of the arms that were identified.
    """

    path: Path
    robot: RobotIdentity | None
    edges: tuple[FixedEdge, ...] = ()
    cameras: Mapping[str, CameraCalibration] = field(default_factory=dict)
    arms: Mapping[Side, ArmCalibration] = field(default_factory=dict)
    dynamics: Mapping[Side, DynamicsCalibration] = field(default_factory=dict)

    def body(self, description: Description) -> Description:
        """Return a description with this robot's own joint zeros and displaced frames built in.

        Raises:
            ConfigError: BAD_CONFIG, they were identified on other numbers.
        """
        try:
            return with_arms(description, self.arms)
        except ValueRefused as error:
            hint = "run `ta2 identify` again with these numbers"
            raise failure(Code.BAD_CONFIG, f"{self.path}: {error}", hint=hint) from None


def load(path: Path, robot: RobotIdentity | None) -> Calibration:
    """Return the calibration of a file for a robot.

    Args:
        path: `.json` or `.toml`.
        robot: The robot that it shall be used on; None when nobody said which.

    Raises:
        ConfigError: BAD_CONFIG, the file cannot be read or its content cannot be meant; FOREIGN_CALIBRATION, it is
            another robot's, or it belongs to one robot and nobody said which this is.
    """
    found = read(path)
    if found.robot is None:
        return found
    if robot is None:
        raise _foreign(found, "nobody said which robot this is", "name this robot: `ta2 frames --serial`, robot.serial")
    if not found.robot.is_same(robot):
        raise _foreign(found, f"this robot is {robot}", "use this robot's own calibration; never copy one (manual A.6)")
    return found


def _foreign(found: Calibration, why: str, hint: str) -> GatewayError:
    return failure(
        Code.FOREIGN_CALIBRATION,
        f"{found.path}: calibrated on robot {found.robot}, and {why}; it is not used (manual A.4)",
        field="robot.serial",
        value=str(found.robot),
        hint=hint,
    )


def read(path: Path) -> Calibration:
    """Return what a file says, whosever it is: for showing, never for use on a robot.

    Raises:
        ConfigError: BAD_CONFIG, the file cannot be read or its content cannot be meant.
    """
    try:
        return _calibration(path, _document(path))
    except (ValueRefused, OSError, UnicodeDecodeError) as error:
        message = error.strerror or str(error) if isinstance(error, OSError) else str(error)
        hint = "correct the file; `gateway/kinematics/calibration.py` shows one"
        raise failure(Code.BAD_CONFIG, f"{path}: {message}", hint=hint) from None


def _document(path: Path) -> Mapping[str, Any]:
    text = path.read_text(encoding="utf-8")
    try:
        if path.suffix == ".json":
            document = json.loads(text)
        elif path.suffix == ".toml":
            document = tomllib.loads(text)
        else:
            raise ValueRefused(f"a calibration is a .json or .toml file, not {path.suffix or 'one without a suffix'}")
    except (json.JSONDecodeError, tomllib.TOMLDecodeError) as error:
        raise ValueRefused(f"is no {path.suffix[1:].upper()}: {error}") from None
    return _table(document, "the file")


def _table(value: object, name: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ValueRefused(f"{name} is no table of keys and values")
    return value


def _calibration(path: Path, document: Mapping[str, Any]) -> Calibration:
    for key in document:
        if key not in SECTIONS:
            raise ValueRefused(f"section {key!r} is not known: there are {', '.join(SECTIONS)}")
    conventions = Conventions.of(document.get("conventions"))
    edges = [
        _edge(name, _table(row, f"transforms.{name}"), conventions)
        for name, row in _table(document.get("transforms", {}), "transforms").items()
    ]
    cameras: dict[str, CameraCalibration] = {}
    for name, row in _table(document.get("cameras", {}), "cameras").items():
        if name not in CAMERAS:
            raise ValueRefused(f"cameras.{name} is not known: there are {', '.join(CAMERAS)}")
        cameras[name] = camera_of(name, _table(row, f"cameras.{name}"), conventions)
    arms = [
        arm_of(name, _table(row, f"arms.{name}"), conventions)
        for name, row in _table(document.get("arms", {}), "arms").items()
    ]
    dynamics = [
        dynamics_of(name, _table(row, f"dynamics.{name}"), str(path))
        for name, row in _table(document.get("dynamics", {}), "dynamics").items()
    ]
    edges += [camera.edge for name, camera in cameras.items() if camera.edge.transform.name in REPLACEABLE]
    names = [edge.transform.name for edge in edges]
    for name in names:
        if names.count(name) > 1:
            raise ValueRefused(
                f"{name} stands there as a transform and follows from R | T of its camera: leave one out"
            )
    _check_head(edges, cameras)
    robot = _robot(document.get("robot"))
    if robot is None and (cameras or arms or dynamics or any(edge.is_of_one_robot for edge in edges)):
        raise ValueRefused(
            "section 'robot' with serial and model is missing: the file has what belongs to one robot (manual A.4)"
        )
    by_side, feeling = {arm.side: arm for arm in arms}, {arm.side: arm for arm in dynamics}
    return Calibration(path=path, robot=robot, edges=tuple(edges), cameras=cameras, arms=by_side, dynamics=feeling)


def _robot(section: object) -> RobotIdentity | None:
    if section is None:
        return None
    table = _table(section, "robot")
    serial, model = table.get("serial"), table.get("model")
    if (
        set(table) != {"serial", "model"}
        or not isinstance(serial, str)
        or not isinstance(model, str)
        or not serial.strip()
    ):
        raise ValueRefused("section 'robot' says serial and model, both text, and nothing else")
    return RobotIdentity(serial=serial, model=model)


def _edge(name: str, row: Mapping[str, Any], conventions: Conventions) -> FixedEdge:
    """Return a transform with its four facts (A.4)."""
    parent, child = frames_of(name)
    if name in MOVING_EDGES:
        raise ValueRefused(f"{name} moves with the joints: it is worked out, never stored (manual A.5)")
    if name not in REPLACEABLE and name not in NOMINAL_EDGES:
        known = ", ".join(sorted((*NOMINAL_EDGES, *REPLACEABLE)))
        raise ValueRefused(f"{name} is no transform of the manual's tree (A.2, A.6); there are {known}")
    if (row.get("parent_frame"), row.get("child_frame")) != (parent, child):
        raise ValueRefused(
            f"{name}: parent_frame {row.get('parent_frame')!r} and child_frame {row.get('child_frame')!r} are not those "
            "of its name (manual A.4)"
        )
    for key in row:
        if key not in TRANSFORM_KEYS:
            raise ValueRefused(f"{name}.{key} is not known: there are {', '.join(sorted(TRANSFORM_KEYS))}")
    origins = [origin.value for origin in Origin if origin is not Origin.ASSUMPTION]
    source, is_own, note = row.get("source"), row.get("device_specific"), row.get("note", "")
    if source not in origins or not isinstance(is_own, bool) or not isinstance(note, str):
        raise ValueRefused(
            f"{name}: source must be one of {', '.join(origins)} and device_specific true or false (manual A.4), not "
            f"{source!r} and {is_own!r}; a note is text"
        )
    origin = Origin(source)
    if is_own is (origin is Origin.MECHANICAL_DESIGN):
        raise ValueRefused(
            f"{name}: {source} and device_specific = {str(is_own).lower()} contradict each other (manual A.4)"
        )
    if name in NOMINAL_EDGES and is_own:
        raise ValueRefused(f"{name} belongs to the model and contains no deviation of a single robot (manual A.3)")
    transform, off = _transform(name, row, conventions)
    notes = [note] if note else []
    if off > 1e-5:
        notes.append(f"rotation made orthonormal, it was {off:.0e} off")
    return FixedEdge(transform=transform, origin=origin, is_of_one_robot=is_own, note="; ".join(notes))


def _transform(name: str, row: Mapping[str, Any], conventions: Conventions) -> tuple[Transform, float]:
    """Return the transform, and how far its rotation was from orthonormal in the file."""
    try:
        if "matrix" not in row:
            if "translation" not in row or "quaternion" not in row:
                raise ValueRefused("a matrix is needed, or translation and quaternion")
            quat = conventions.quat_xyzw(row["quaternion"])
            if abs(float(quat @ quat) - 1.0) > RIGID_TOLERANCE:
                raise ValueRefused(f"the quaternion has norm {math.sqrt(float(quat @ quat)):.4f}, 1 is needed")
            p_m = conventions.vector_m(row["translation"])
            return Transform.of_quaternion(name, p_m.tolist(), quat.tolist()), 0.0
        if "translation" in row or "quaternion" in row:
            raise ValueRefused("a matrix and parts beside it: leave one out")
        matrix, off = nearest_rigid(conventions.transform_m(row["matrix"]))
        if off > RIGID_TOLERANCE:
            raise ValueRefused(f"the rotation is {off:.1e} from orthonormal, up to {RIGID_TOLERANCE:.0e} is allowed")
        return Transform.named(name, matrix), off
    except ValueRefused as error:
        raise ValueRefused(f"{name}: {error}") from None


def _check_head(edges: list[FixedEdge], cameras: Mapping[str, CameraCalibration]) -> None:
    """Refuse mounts of the head's eyes that its stereo calibration contradicts."""
    mounts = {edge.transform.child: edge.transform for edge in edges if edge.is_of_one_robot}
    if "head" not in cameras or not {"head_left_camera", "head_right_camera"} <= set(mounts):
        return
    mounted = mounts["head_right_camera"].inverse @ mounts["head_left_camera"]
    seen = cameras["head"].pair.right_T_left
    off_m, off_rad = mounted.distance_to_m(seen), mounted.angle_to_rad(seen)
    if off_m > EYES_TOLERANCE_M or off_rad > EYES_TOLERANCE_RAD:
        raise ValueRefused(
            f"the mounts of the head's eyes and R | T of its camera differ by {1e3 * off_m:.1f} mm and "
            f"{math.degrees(off_rad):.2f}°, up to {1e3 * EYES_TOLERANCE_M:.0f} mm and "
            f"{math.degrees(EYES_TOLERANCE_RAD):.1f}° are allowed: of two calibrations?"
        )
