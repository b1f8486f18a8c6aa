"""Section `arms` of a calibration file: joint zeros and displaced frames of one robot's arms, as `ta2 identify` writes them.

```json
"arms": {"left": {
    "source": "joint_identification", "device_specific": true, "description": "TeleAvatar 2, ...", "numbers": "3f0c...",
    "joint_zero_offsets": [0.0041, -0.0072, 0.0109, -0.0031, 0.009, -0.0058, 0.015],
    "nominal_ee_T_ee": {"translation": [1.5, -2.5, 4.0], "quaternion": [0.003, -0.0045, 0.0, 0.999985]},
    "note": "±0.08 mrad, ±0.02 mm"}}
```

Offsets are added to the reported joints; `correction.py` says what the two frames are. Units and order are those of the
file's `conventions`. `description` says in words which numbers of the body the correction belongs to, and `numbers` is their
fingerprint: on others it means nothing. The manual has no such section: its keys are ours.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from typing import Any, Final

from msgspec import Struct

from gateway.kinematics.calibration_file.conventions import ANGLES, LENGTHS, QUATERNIONS, Conventions, numbers
from gateway.kinematics.correction import NOWHERE, ArmCorrection, corrected
from gateway.kinematics.description import Description
from gateway.kinematics.placement import Placement, rows_from_quat
from gateway.kinematics.solving.chain import ArmChain
from gateway.values import ARM_DOF, Side, ValueRefused

__all__ = ["SOURCE", "ArmCalibration", "arm_of", "fingerprint", "with_arms"]

SOURCE: Final = "joint_identification"
EE: Final = "nominal_ee_T_ee"
SHOULDER: Final = "shoulder_T_nominal_shoulder"
KEYS: Final = frozenset(
    {"source", "device_specific", "description", "numbers", "joint_zero_offsets", EE, SHOULDER, "note"}
)

MOST_OFFSET_RAD: Final = 0.35
"""A joint's zero is not further off than this (ours): a larger number is in another unit."""
MOST_SHIFT_M: Final = 0.1
"""Nor is a frame."""
NORM_TOLERANCE: Final = 1e-3


class ArmCalibration(Struct, frozen=True, kw_only=True):
    """What a file says of one arm.

    Attributes:
        side: Which.
        correction: Of the description.
        description: Where the numbers are from that it belongs to, for people.
        numbers: Their fingerprint.
        note: What else there is to say, for people.
    """

    side: Side
    correction: ArmCorrection
    description: str
    numbers: str
    note: str = ""

    def row(self, conventions: Conventions) -> dict[str, object]:
        """Return the entry of a file with these conventions; `arm_of` reads it."""
        angle = ANGLES[conventions.angle_unit]
        row: dict[str, object] = {
            "source": SOURCE,
            "device_specific": True,
            "description": self.description,
            "numbers": self.numbers,
            "joint_zero_offsets": [offset / angle for offset in self.correction.offsets_rad],
        }
        for key, placement in ((EE, self.correction.ee), (SHOULDER, self.correction.shoulder)):
            if placement != NOWHERE:
                row[key] = _written(placement, conventions)
        if self.note:
            row["note"] = self.note
        return row


def arm_of(name: str, row: Mapping[str, Any], conventions: Conventions) -> ArmCalibration:
    """Return what a file says of an arm.

    Raises:
        ValueRefused: It cannot be meant: another name, a key that is unknown or missing, numbers beyond their bounds.
    """
    if name not in {side.value for side in Side}:
        raise ValueRefused(f"arms.{name} is not known: there are {', '.join(Side)}")
    for key in row:
        if key not in KEYS:
            raise ValueRefused(f"arms.{name}.{key} is not known: there are {', '.join(sorted(KEYS))}")
    if row.get("source") != SOURCE or row.get("device_specific") is not True:
        raise ValueRefused(f"arms.{name}: source must be {SOURCE} and device_specific true: it belongs to one robot")
    description, belongs_to, note = row.get("description"), row.get("numbers"), row.get("note", "")
    if not isinstance(description, str) or not isinstance(belongs_to, str) or not isinstance(note, str):
        raise ValueRefused(
            f"arms.{name}: description and numbers must say what the offsets belong to, as `ta2 identify` writes it; "
            "a note is text"
        )
    try:
        correction = ArmCorrection(
            offsets_rad=_offsets_rad(row.get("joint_zero_offsets"), conventions),
            ee=_placement(row.get(EE), conventions),
            shoulder=_placement(row.get(SHOULDER), conventions),
        )
    except ValueRefused as error:
        raise ValueRefused(f"arms.{name}: {error}") from None
    return ArmCalibration(
        side=Side(name), correction=correction, description=description, numbers=belongs_to, note=note
    )


def fingerprint(description: Description, side: Side) -> str:
    """Return what tells the numbers of an arm from others: its axes and its end effector at zero, to a tenth of a µm."""
    chain = ArmChain(description, side)
    lines = [(*point, *axis) for point, axis in chain.lines]
    rows = [*lines, chain.zero.p_m, *chain.zero.rows]
    text = ";".join(" ".join(f"{round(c, 7) + 0.0:.7f}" for c in row) for row in rows)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def with_arms(description: Description, arms: Mapping[Side, ArmCalibration]) -> Description:
    """Return a description with the corrections of a file built in.

    Args:
        description: That which they belong to.
        arms: As `calibration.load` let them pass.

    Raises:
        ValueRefused: A correction belongs to other numbers.
    """
    body = description
    for arm in arms.values():
        if arm.numbers != fingerprint(description, arm.side):
            raise ValueRefused(
                f"the {arm.side} arm was identified on other numbers ({arm.description}) than these "
                f"({description.source}): offsets of one mean nothing on the other"
            )
        body = corrected(body, arm.side, arm.correction)
    return body


def _offsets_rad(values: object, conventions: Conventions) -> tuple[float, ...]:
    offsets = tuple(conventions.angle_rad(value) for value in numbers(values, (ARM_DOF,)).tolist())
    for joint, offset in enumerate(offsets, start=1):
        if abs(offset) > MOST_OFFSET_RAD:
            raise ValueRefused(
                f"joint {joint} has an offset of {offset:.3g} rad, up to {MOST_OFFSET_RAD:g} rad is allowed: is "
                f"{conventions.angle_unit} its unit?"
            )
    return offsets


def _placement(value: object, conventions: Conventions) -> Placement:
    if value is None:
        return NOWHERE
    if not isinstance(value, Mapping) or set(value) != {"translation", "quaternion"}:
        raise ValueRefused("a displaced frame has translation and quaternion, and nothing else")
    p_m = conventions.vector_m(value["translation"]).tolist()
    if math.hypot(*p_m) > MOST_SHIFT_M:
        raise ValueRefused(
            f"a frame is displaced by {math.hypot(*p_m):.3g} m, up to {MOST_SHIFT_M:g} m is allowed: is "
            f"{conventions.translation_unit} its unit?"
        )
    x, y, z, w = conventions.quat_xyzw(value["quaternion"]).tolist()
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if abs(norm - 1.0) > NORM_TOLERANCE:
        raise ValueRefused(f"a quaternion has norm {norm:.4f}, 1 is needed")
    return Placement(tuple(p_m), rows_from_quat((x / norm, y / norm, z / norm, w / norm)))


def _written(placement: Placement, conventions: Conventions) -> dict[str, list[float]]:
    quat_xyzw = placement.pose.quat_xyzw
    quat = [0.0] * 4
    for place, index in enumerate(QUATERNIONS[conventions.quaternion_order]):
        quat[index] = quat_xyzw[place]
    return {"translation": [c / LENGTHS[conventions.translation_unit] for c in placement.p_m], "quaternion": quat}
