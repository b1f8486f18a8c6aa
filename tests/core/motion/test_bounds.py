"""A number refused for its size, and what is no row of numbers, says what it is, its value, bound, unit and remedy."""

from __future__ import annotations

import math

import pytest

from gateway.core.motion.bounds import no_arm, not_finite, outside, within, wrong_count
from gateway.errors import Code


@pytest.mark.parametrize("value", [0.0, 1.5, 3.0])
def test_a_number_inside_its_bound_or_on_its_edge_is_taken(value):
    """Both edges belong to it."""
    assert within("mass_kg", value, 0.0, 3.0, "kg") is None


@pytest.mark.parametrize("value", [-1e-9, 3.0000001])
def test_a_number_beyond_either_edge_is_refused_with_value_bound_unit_and_remedy(value):
    """Value, bound, unit and remedy are in the refusal, for people and for programs."""
    refusal = within("mass_kg", value, 0.0, 3.0, "kg", hint="weigh it")
    assert refusal is not None
    assert (refusal.code, refusal.field, refusal.value) == (Code.OUT_OF_RANGE, "mass_kg", str(value))
    assert (refusal.bound, refusal.unit, refusal.hint) == ("[0, 3]", "kg", "weigh it")
    assert refusal.message == f"mass_kg is {value} kg, outside [0, 3] kg"


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_none_is_not_finite_even_where_the_bound_has_no_end(value):
    """A code of its own."""
    refusal = within("dt_s", value, 0.0, 10.0, "s")
    assert refusal is not None
    assert refusal.code is Code.NOT_FINITE


def test_a_plain_number_of_a_named_field_is_refused_without_a_unit_beside_it():
    """The bound then has no unit beside it."""
    refusal = outside("the share", 2.0, 0.0, 1.0, field="share")
    assert (refusal.field, refusal.unit) == ("share", "")
    assert refusal.message == "the share is 2.0, outside [0, 1]"
    assert refusal.hint


def test_a_number_that_is_none_can_be_told_with_the_bound_that_it_would_have_had():
    """And without one, where there is none."""
    refusal = not_finite("left arm joint 1 (l_joint1)", math.nan, "left_arm[0]", "[-1, 1]", "rad")
    assert refusal.message == "left arm joint 1 (l_joint1) is nan, a finite number is needed"
    assert (refusal.code, refusal.field, refusal.value) == (Code.NOT_FINITE, "left_arm[0]", "nan")
    assert (refusal.bound, refusal.unit) == ("[-1, 1]", "rad")
    assert (not_finite("vx_mps", math.inf, "vx_mps").bound, not_finite("vx_mps", math.inf, "vx_mps").unit) == ("", "")


def test_a_row_of_another_length_is_told_with_both_counts_and_what_is_needed():
    """Whoever reads it knows which numbers to give."""
    refusal = wrong_count("the direction", 2, 3, "until.direction", "x, y, z")
    assert refusal.message == "the direction has 2 values, 3 are needed: x, y, z"
    assert (refusal.code, refusal.field) == (Code.WRONG_SHAPE, "until.direction")
    assert (refusal.value, refusal.bound, refusal.unit) == ("2", "3", "values")


def test_a_request_that_names_neither_arm_is_told_how_many_there_may_be():
    """The field is the one that should have named them."""
    refusal = no_arm("sides")
    assert (refusal.code, refusal.field, refusal.value) == (Code.WRONG_SHAPE, "sides", "0")
    assert (refusal.bound, refusal.unit) == ("[1, 2]", "arms")
