"""Tests of conventions: the file says how its numbers are meant, and nothing is assumed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import asdict

from gateway.kinematics.calibration_file.conventions import MANUAL, ONLY_FOR_PAIRS, WORDS, Conventions, numbers
from gateway.values import ValueRefused
from tests.changed import replace

SAID = asdict(MANUAL)


def test_the_manuals_conventions_are_read():
    """parent_T_child, row-major, mm, rad, xyzw, right-handed (A.1)."""
    assert Conventions.of(SAID) == MANUAL
    assert (MANUAL.translation_unit, MANUAL.angle_unit, MANUAL.quaternion_order) == ("mm", "rad", "xyzw")
    assert MANUAL.matrix_layout == "row_major" and MANUAL.transform_naming == "parent_T_child"


@pytest.mark.parametrize("section", [None, {}, [], "mm", 3])
def test_a_file_that_says_nothing_is_refused(section):
    """A.1: no reader may go by its own defaults."""
    with pytest.raises(ValueRefused, match=r"no section 'conventions'.*no reader may guess"):
        Conventions.of(section)


@pytest.mark.parametrize("key", sorted(set(WORDS) - ONLY_FOR_PAIRS))
def test_every_word_must_be_there_and_known(key):
    """One that is missing, unknown or no text is refused, with the words that are known."""
    with pytest.raises(ValueRefused, match=f"{key} is missing: say one of {WORDS[key][0]}"):
        Conventions.of({name: word for name, word in SAID.items() if name != key})
    for word in ("", "inch", None, 3, ["mm"]):
        with pytest.raises(ValueRefused, match=f"{key} says .*knows {WORDS[key][0]}"):
            Conventions.of({**SAID, key: word})


def test_an_unknown_key_is_refused_with_its_neighbour():
    """What the reader does not know it cannot obey."""
    with pytest.raises(ValueRefused, match=r"translation_units.*is translation_unit meant"):
        Conventions.of({**SAID, "translation_units": "mm"})
    with pytest.raises(ValueRefused, match=r"conventions\.2 is not known"):
        Conventions.of({**SAID, 2: "mm"})


def test_only_stereo_pairs_need_the_direction_of_their_extrinsics():
    """Without it a file of transforms is complete."""
    assert Conventions.of({k: v for k, v in SAID.items() if k != "stereo_extrinsics"}).stereo_extrinsics == ""


@pytest.mark.parametrize(
    ("key", "spelt", "meant"),
    [
        ("translation_unit", "Millimetres", "mm"),
        ("translation_unit", "meter", "m"),
        ("angle_unit", "Degrees", "deg"),
        ("matrix_layout", "Row-Major", "row_major"),
        ("quaternion_order", "XYZW", "xyzw"),
        ("transform_naming", "parent_t_child", "parent_T_child"),
        ("handedness", "right-handed", "right"),
    ],
)
def test_other_spellings_of_a_word_are_that_word(key, spelt, meant):
    """Case, hyphens, long names of units."""
    assert getattr(Conventions.of({**SAID, key: spelt}), key) == meant


@pytest.mark.parametrize(("unit", "metres"), [("mm", 0.25), ("cm", 2.5), ("m", 250.0)])
def test_lengths_are_in_the_files_unit(unit, metres):
    """As vectors and translations of matrices; rotations have none."""
    said = replace(MANUAL, translation_unit=unit)
    np.testing.assert_allclose(said.vector_m([250, 0, -250]), (metres, 0, -metres))
    matrix = np.eye(4)
    matrix[0, 3] = 250
    found = said.transform_m(matrix.tolist())
    np.testing.assert_allclose(found[:3, 3], (metres, 0, 0))
    np.testing.assert_array_equal(found[:3, :3], np.eye(3))


def test_angles_and_quaternions_are_in_the_files_order():
    """Degrees become radians, wxyz becomes xyzw."""
    assert replace(MANUAL, angle_unit="deg").angle_rad(180.0) == pytest.approx(math.pi)
    assert MANUAL.angle_rad(1.5) == 1.5
    np.testing.assert_array_equal(MANUAL.quat_xyzw([1, 2, 3, 4]), (1, 2, 3, 4))
    np.testing.assert_array_equal(replace(MANUAL, quaternion_order="wxyz").quat_xyzw([4, 1, 2, 3]), (1, 2, 3, 4))


def test_column_major_matrices_are_turned():
    """Nested or flat; a row-major one stays."""
    matrix = np.arange(16.0).reshape(4, 4)
    columns = replace(MANUAL, matrix_layout="column_major", translation_unit="m")
    rows = replace(MANUAL, translation_unit="m")
    for given in (matrix.tolist(), matrix.ravel().tolist()):
        np.testing.assert_array_equal(rows.transform_m(given), matrix)
        np.testing.assert_array_equal(columns.transform_m(given), matrix.T)


@pytest.mark.parametrize(
    "values",
    [None, "1 2 3", 5.0, [1, 2], [1, 2, 3, 4], [1, 2, "3"], [1, 2, True], [[1, 2], [3]], [1, 2, None], [[1], [2], [3]]],
)
def test_what_is_not_so_many_numbers_is_refused(values):
    """Also text and true that Python would take for numbers."""
    with pytest.raises(ValueRefused, match="number"):
        numbers(values, (3,))


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_numbers_are_finite(bad):
    """JSON readers let NaN pass."""
    with pytest.raises(ValueRefused, match="not finite"):
        numbers([1.0, 2.0, bad], (3,))
