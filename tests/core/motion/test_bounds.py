"""A number refused for its size says what it is, its value, bound, unit and remedy."""

from __future__ import annotations

import math

import pytest

from gateway.core.motion.bounds import outside, within
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
