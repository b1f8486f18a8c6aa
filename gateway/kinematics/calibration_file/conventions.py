"""Conventions of a calibration file: how its numbers are meant, as the file itself says it, never as we guess it.

The manual (A.1) prescribes parent_T_child names, row-major matrices, millimetres, radians, quaternions xyzw, right-handed
frames, and that a reader goes by the file's own `conventions` section and by no default. So every word of that section
must be there and known; a file that says metres or wxyz is read as that, a file that says nothing is refused.

The manual names no keys for that section; those below are ours.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from gateway.values import ValueRefused

__all__ = ["MANUAL", "Conventions", "numbers"]

Array = NDArray[np.float64]

LENGTHS: Final = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
ANGLES: Final = {"rad": 1.0, "deg": math.pi / 180.0}
QUATERNIONS: Final = {"xyzw": (0, 1, 2, 3), "wxyz": (1, 2, 3, 0)}
LAYOUTS: Final = ("row_major", "column_major")
NAMINGS: Final = ("parent_T_child",)
STEREO: Final = ("right_T_left", "left_T_right")
HANDEDNESS: Final = ("right",)

WORDS: Final[Mapping[str, Sequence[str]]] = {
    "transform_naming": NAMINGS,
    "matrix_layout": LAYOUTS,
    "translation_unit": tuple(LENGTHS),
    "angle_unit": tuple(ANGLES),
    "quaternion_order": tuple(QUATERNIONS),
    "handedness": HANDEDNESS,
    "stereo_extrinsics": STEREO,
}
"""Every key of the section with the words it may say."""

ONLY_FOR_PAIRS: Final = frozenset({"stereo_extrinsics"})
"""May be missing in a file without stereo pairs."""

SPELLINGS: Final = {
    "millimeter": "mm", "millimetre": "mm", "millimeters": "mm", "millimetres": "mm",
    "meter": "m", "metre": "m", "meters": "m", "metres": "m",
    "radian": "rad", "radians": "rad", "degree": "deg", "degrees": "deg",
    "right_handed": "right", "row": "row_major", "column": "column_major",
}  # fmt: skip
"""Other spellings of a word; case and hyphens do not count."""


class Conventions(Struct, frozen=True, kw_only=True):
    """How the numbers of one file are meant.

    Attributes:
        transform_naming: `parent_T_child`: the matrix takes coordinates in the child to coordinates in the parent.
        matrix_layout: Order of a matrix's numbers.
        translation_unit: Of translations, in matrices and in T of a stereo pair.
        angle_unit: Of angles.
        quaternion_order: Of quaternions.
        handedness: Of all frames.
        stereo_extrinsics: What R | T of a stereo pair are (§5.5: from left to right eye); empty when the file is silent.
    """

    transform_naming: str
    matrix_layout: str
    translation_unit: str
    angle_unit: str
    quaternion_order: str
    handedness: str
    stereo_extrinsics: str = ""

    @staticmethod
    def of(section: object) -> Conventions:
        """Return the conventions of a file's section.

        Raises:
            ValueRefused: No section, a word is missing, unknown, or no text. The message lists what may stand there.
        """
        if not isinstance(section, Mapping) or not section:
            raise ValueRefused(
                f"the file has no section 'conventions'; it must say {', '.join(WORDS)} (manual A.1: no reader may guess)"
            )
        for key in section:
            if key not in WORDS:
                near = difflib.get_close_matches(str(key), WORDS, n=1)
                meant = f"; is {near[0]} meant?" if near else ""
                raise ValueRefused(f"conventions.{key} is not known: there are {', '.join(WORDS)}{meant}")
        for key in WORDS:
            if key not in section and key not in ONLY_FOR_PAIRS:
                raise ValueRefused(
                    f"conventions.{key} is missing: say one of {', '.join(WORDS[key])} (manual A.1: no reader may guess)"
                )
        return Conventions(**{str(key): _word(str(key), value) for key, value in section.items()})

    def angle_rad(self, value: float) -> float:
        """Return an angle of the file in radians."""
        return value * ANGLES[self.angle_unit]

    def quat_xyzw(self, values: object) -> Array:
        """Return a quaternion of the file as x, y, z, w; its length is left as it is.

        Raises:
            ValueRefused: Not four finite numbers.
        """
        return numbers(values, (4,))[list(QUATERNIONS[self.quaternion_order])]

    def vector_m(self, values: object) -> Array:
        """Return a translation of the file, shape (3,) [m].

        Raises:
            ValueRefused: Not three finite numbers.
        """
        return numbers(values, (3,)) * LENGTHS[self.translation_unit]

    def square(self, values: object, size: int) -> Array:
        """Return a square matrix of the file, given as rows, as columns or flat, as rows.

        Raises:
            ValueRefused: Another shape, or a number that is not finite.
        """
        matrix = numbers(values, (size, size))
        return matrix if self.matrix_layout == "row_major" else np.ascontiguousarray(matrix.T)

    def transform_m(self, values: object) -> Array:
        """Return a 4 × 4 matrix of the file as rows, with its translation in metres.

        Raises:
            ValueRefused: Another shape, or a number that is not finite.
        """
        matrix = self.square(values, 4)
        matrix[:3, 3] *= LENGTHS[self.translation_unit]
        return matrix


MANUAL: Final = Conventions(
    transform_naming="parent_T_child",
    matrix_layout="row_major",
    translation_unit="mm",
    angle_unit="rad",
    quaternion_order="xyzw",
    handedness="right",
    stereo_extrinsics="right_T_left",
)
"""What the manual prescribes (A.1, §5.5): for files that we write, never for reading one that does not say so."""


def _word(key: str, value: object) -> str:
    said = value.strip().replace("-", "_") if isinstance(value, str) else ""
    known: Callable[[str], str | None] = {word.lower(): word for word in WORDS[key]}.get
    word = known(said.lower()) or known(SPELLINGS.get(said.lower(), ""))
    if word is None:
        raise ValueRefused(f"conventions.{key} says {value!r}; this reader knows {', '.join(WORDS[key])}")
    return word


def numbers(values: object, shape: tuple[int, ...]) -> Array:
    """Return numbers of a file in a shape; a flat list of as many is the same.

    Raises:
        ValueRefused: Not so many, or one that is no finite number.
    """
    try:
        array = np.array(values, dtype=object)
        flat = [float(item) for item in array.ravel() if not isinstance(item, (bool, str))]
    except (TypeError, ValueError):
        raise ValueRefused(f"{values!r:.80} are not numbers") from None
    size = math.prod(shape)
    if array.size != size or len(flat) != size or array.shape not in (shape, (size,)):
        raise ValueRefused(f"{values!r:.80} has shape {array.shape}, {shape} numbers are needed")
    result = np.array(flat, dtype=np.float64).reshape(shape)
    if not np.isfinite(result).all():
        raise ValueRefused(f"{values!r:.80} has a number that is not finite")
    return result
