"""Bounds of a virtual mass: value, bound, unit and what to do instead; locked axes are asked for nothing."""

from __future__ import annotations

import math

import pytest

from gateway.core.limits.admittance_rules import LEAST_DAMPING, MASSES, MOST_DAMPING, check_admittance
from gateway.errors import Code
from gateway.messages.incoming import Admittance
from gateway.values import Space

GOOD = {"mass": [8.0] * 3 + [0.1] * 3, "damping": [200.0] * 3 + [20.0] * 3, "stiffness": [100.0] * 3 + [5.0] * 3}


def check(space=Space.POSE, **changes):
    """Judge a good one with values of one field changed, by axis, or given anew."""
    fields = {name: list(values) for name, values in GOOD.items()}
    for name, change in changes.items():
        if isinstance(change, dict):
            for axis, value in change.items():
                fields[name][axis] = value
        else:
            fields[name] = change
    return check_admittance(Admittance(**{name: tuple(values) for name, values in fields.items()}), space)


def test_whatever_is_inside_the_bounds_passes_to_the_last_bit():
    """The bounds themselves, of shifts and of turns; a spring up to where it would swing."""
    assert check() is None
    for kind in (0, 1):
        axis = 3 * kind
        for mass in MASSES[kind]:
            for damping in (LEAST_DAMPING[kind], MOST_DAMPING[kind]):
                for stiffness in (0.0, damping * damping / (4.0 * mass)):
                    assert check(mass={axis: mass}, damping={axis: damping}, stiffness={axis: stiffness}) is None


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"mass": {0: 0.5}}, "admittance.mass[0]", ("the mass x is 0.5 kg", "[1, 30] kg")),
        ({"mass": {4: 3.0}}, "admittance.mass[4]", ("about y is 3.0 kg·m²", "[0.02, 1] kg·m²")),
        ({"mass": {1: 0.0}}, "admittance.mass[1]", ("the mass y is 0.0 kg",)),
        ({"damping": {2: 149.0}}, "admittance.damping[2]", ("the damping z is 149.0 N·s/m", "[150, 2000] N·s/m")),
        ({"damping": {5: 1e9}}, "admittance.damping[5]", ("[15, 100] N·m·s/rad",)),
        ({"stiffness": {1: 1300.0}}, "admittance.stiffness[1]", ("1300.0 N/m", "[0, 1250] N/m")),
        ({"stiffness": {3: -1.0}}, "admittance.stiffness[3]", ("-1.0 N·m/rad", "[0, 1000] N·m/rad")),
    ],
)
def test_what_would_swing_is_refused_with_value_bound_unit_and_remedy(changes, field, words):
    """Nothing is clipped."""
    refusal = check(**changes)
    assert (refusal.code, refusal.field) == (Code.OUT_OF_RANGE, field) and refusal.hint and refusal.unit
    assert all(word in refusal.message for word in words)
    assert refusal.value and refusal.bound.startswith("[")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["mass", "damping", "stiffness"])
def test_what_is_no_number_is_refused(name, value):
    """Whichever of the three it is."""
    refusal = check(**{name: {2: value}})
    assert (refusal.code, refusal.field) == (Code.NOT_FINITE, f"admittance.{name}[2]")


def test_a_locked_axis_is_asked_for_nothing_but_one_must_be_free():
    """Whatever stands beside it."""
    assert check(mass={0: None, 4: None}, damping={0: 0.0, 4: math.nan}, stiffness={0: 1e9}) is None
    refusal = check(mass=(None,) * 6)
    assert (refusal.code, refusal.field) == (Code.BAD_REQUEST, "admittance.mass") and refusal.hint


@pytest.mark.parametrize("name", ["mass", "damping", "stiffness"])
def test_six_axes_are_needed(name):
    """Neither more nor fewer."""
    for count in (0, 3, 7):
        refusal = check(**{name: (1.0,) * count})
        assert (refusal.code, refusal.field, refusal.value) == (Code.WRONG_SHAPE, f"admittance.{name}", str(count))


def test_joints_do_not_yield():
    """It is the hand that does."""
    assert check(Space.JOINT).code is Code.BAD_REQUEST
