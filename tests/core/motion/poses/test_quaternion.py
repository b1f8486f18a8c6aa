"""Quaternions and rotation vectors: xyzw, turned from the left, the shorter way unless the sign says otherwise."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.motion.poses.quaternion import (
    aligned,
    angle_rad,
    conjugate,
    dot,
    exp,
    log,
    long_log,
    multiply,
    turn,
    unit,
)

NUMBERS = st.floats(-1.0, 1.0)
QUATERNIONS = st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS).filter(lambda q: math.hypot(*q) > 0.1).map(unit)
IDENTITY = (0.0, 0.0, 0.0, 1.0)


def near(a, b, within=1e-12):
    """Whether two vectors are equal but for rounding."""
    return all(abs(x - y) <= within for x, y in zip(a, b, strict=True))


def test_a_product_turns_by_the_right_factor_first():
    """A quarter about z after a quarter about x is not the other way round."""
    about_x, about_z = exp((math.pi / 2, 0.0, 0.0)), exp((0.0, 0.0, math.pi / 2))
    assert near(multiply(about_z, about_x), (0.5, 0.5, 0.5, 0.5))
    assert near(multiply(about_x, about_z), (0.5, -0.5, 0.5, 0.5))


@given(q=QUATERNIONS)
def test_the_conjugate_is_the_inverse(q):
    """A turn there and back is none."""
    assert near(multiply(q, conjugate(q)), IDENTITY)


@given(r=st.tuples(NUMBERS, NUMBERS, NUMBERS), size=st.sampled_from((1e-13, 1e-6, 1e-3, 1.0, 1.8)))
def test_log_undoes_exp_from_nothing_to_half_a_turn(r, size):
    """Rotation vectors of every size below π come back."""
    r = tuple(size * c for c in r)
    if math.hypot(*r) < math.pi:
        assert near(log(exp(r)), r, 1e-12 * max(size, 1e-3))


def test_the_sign_decides_which_way_the_long_log_goes():
    """The same orientation in the other sign is reached by the rest of the whole turn."""
    q = exp((0.0, 0.0, 0.5))
    opposite = tuple(-c for c in q)
    assert near(log(opposite), (0.0, 0.0, 0.5))
    assert near(long_log(opposite), (0.0, 0.0, 0.5 - 2.0 * math.pi))
    assert math.hypot(*long_log((0.0, 0.0, 0.0, -1.0))) == 0.0


@given(a=QUATERNIONS, b=QUATERNIONS)
def test_a_turn_leads_from_one_orientation_to_the_other(a, b):
    """Turning a by it gives b, in one of its signs, by at most half a turn."""
    way = turn(a, b)
    assert near(aligned(multiply(exp(way), a), b), b, 1e-9)
    assert math.hypot(*way) == angle_rad(a, b) <= math.pi + 1e-12


@given(a=QUATERNIONS, b=QUATERNIONS)
def test_aligned_gives_the_nearer_sign(a, b):
    """It is one of the two signs, and its product with the other is not negative."""
    q = aligned(a, b)
    assert q in (a, tuple(-c for c in a))
    assert dot(q, b) >= 0.0


def test_a_unit_quaternion_has_norm_one():
    """Whatever its length was."""
    assert unit((0.0, 3.0, 0.0, 4.0)) == pytest.approx((0.0, 0.6, 0.0, 0.8))
