"""Section `dynamics` of a calibration file: drives and masses of one robot's arms, as `ta2 identify --dynamics` writes them.

```json
"dynamics": {"left": {
    "source": "motion_identification", "device_specific": true, "description": "TeleAvatar 2, ...", "numbers": "3f0c...",
    "scale": [1.02, ...], "coulomb_nm": [0.6, ...], "viscous_nmsprad": [0.2, ...], "armature_kgm2": [0.02, ...],
    "friction_sd_nm": [0.11, ...], "heavier": [[0.02, 0.001, -0.003, 0.0], ...],
    "note": "40 s of motion; 0.12 N·m left"}}
```

In SI units, whatever the file's `conventions`; what the numbers are says `dynamics/parameters.py`. `description` and `numbers`
say what they were identified on, joint zeros and all: on other numbers they mean nothing. The manual has no such section.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from msgspec import Struct

from gateway.kinematics.calibration_file.conventions import numbers
from gateway.kinematics.dynamics.parameters import DriveParameters
from gateway.values import ARM_DOF, Side, ValueRefused

__all__ = ["DynamicsCalibration", "dynamics_of"]

SOURCE: Final = "motion_identification"
VECTORS: Final = ("scale", "coulomb_nm", "viscous_nmsprad", "armature_kgm2", "friction_sd_nm")
KEYS: Final = frozenset({"source", "device_specific", "description", "numbers", *VECTORS, "heavier", "note"})
MOST_SCALE: Final = 3.0
"""Efforts are not further off than by this factor (ours): a larger one is another unit."""


class DynamicsCalibration(Struct, frozen=True, kw_only=True):
    """What a file says of one arm's dynamics.

    Attributes:
        side: Which.
        drives: Drives and masses.
        description: Where the numbers are from that they belong to, for people.
        numbers: Their fingerprint, as the arm's joint zeros left them.
        note: What else there is to say, for people.
    """

    side: Side
    drives: DriveParameters
    description: str
    numbers: str
    note: str = ""

    def row(self) -> dict[str, object]:
        """Return the entry of a file; `dynamics_of` reads it."""
        values = {name: list(getattr(self.drives, name)) for name in VECTORS}
        facts = {"description": self.description, "numbers": self.numbers, "note": self.note}
        heavier = [list(link) for link in self.drives.heavier]
        return {"source": SOURCE, "device_specific": True, **facts, **values, "heavier": heavier}


def dynamics_of(name: str, row: Mapping[str, Any], source: str) -> DynamicsCalibration:
    """Return what a file says of an arm's dynamics.

    Args:
        name: `left` or `right`.
        row: The entry.
        source: The file, for people who ask what an estimate stands on.

    Raises:
        ValueRefused: It cannot be meant: another name, keys that are unknown or missing, numbers that no drive has.
    """
    if name not in {side.value for side in Side}:
        raise ValueRefused(f"dynamics.{name} is not known: there are {', '.join(Side)}")
    if set(row) | {"note"} != KEYS:
        raise ValueRefused(f"dynamics.{name} has other keys than {', '.join(sorted(KEYS))}")
    facts = [row["description"], row["numbers"], row.get("note", "")]
    if row["source"] != SOURCE or row["device_specific"] is not True or not all(isinstance(f, str) for f in facts):
        raise ValueRefused(f"dynamics.{name}: not as `ta2 identify --dynamics` writes it for one robot")
    try:
        vectors = {key: tuple(numbers(row[key], (ARM_DOF,)).tolist()) for key in VECTORS}
        heavier = tuple(map(tuple, numbers(row["heavier"], (ARM_DOF, 4)).tolist()))
        drives = DriveParameters(source=source, unsure_part=0.0, heavier=heavier, **vectors)
        if not 1.0 / MOST_SCALE <= min(drives.scale) <= max(drives.scale) <= MOST_SCALE:
            raise ValueError(
                f"a scale is outside [{1.0 / MOST_SCALE:.2f}, {MOST_SCALE:g}]: in what unit are the efforts?"
            )
    except ValueError as error:  # ValueRefused is one
        raise ValueRefused(f"dynamics.{name}: {error}") from None
    return DynamicsCalibration(side=Side(name), drives=drives, description=facts[0], numbers=facts[1], note=facts[2])
