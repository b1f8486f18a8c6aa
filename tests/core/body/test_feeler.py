"""What a touch is: the wish for one, how hard a hand is pushed, and how long."""

from __future__ import annotations

import math

import pytest

from gateway.core.body.feeler import LASTS_NS, Feeler, Push, axis_of, push_of, unknown
from gateway.errors import Code, Refusal
from gateway.messages.body_views import ContactView
from gateway.messages.incoming import Until
from gateway.values import Side
from tests.pushed import felt

NAN = math.nan


@pytest.mark.parametrize(
    ("wish", "code", "field"),
    [
        ({"force_n": 0.5}, Code.OUT_OF_RANGE, "force_n"),
        ({"force_n": 201.0}, Code.OUT_OF_RANGE, "force_n"),
        ({"force_n": -8.0}, Code.OUT_OF_RANGE, "force_n"),
        ({"force_n": NAN}, Code.NOT_FINITE, "force_n"),
        ({"back_off_m": -0.01}, Code.OUT_OF_RANGE, "back_off_m"),
        ({"back_off_m": 0.11}, Code.OUT_OF_RANGE, "back_off_m"),
        ({"back_off_m": math.inf}, Code.NOT_FINITE, "back_off_m"),
        ({"direction": (0.0, 1.0)}, Code.WRONG_SHAPE, "direction"),
        ({"direction": (0.0,) * 3}, Code.OUT_OF_RANGE, "direction"),
        ({"direction": (1e-300, 0.0, 0.0)}, Code.OUT_OF_RANGE, "direction"),
        ({"direction": (1e300, 1e300, 0.0)}, Code.OUT_OF_RANGE, "direction"),
        ({"direction": (NAN, 0.0, 1.0)}, Code.NOT_FINITE, "direction"),
    ],
)
def test_a_wish_that_means_nothing_is_refused_with_value_bound_and_remedy(wish, code, field):
    """Forces that no arm feels or bears, ways back that are none or far, directions that are none."""
    found = axis_of(Until(**{"force_n": 8.0, **wish}))
    assert isinstance(found, Refusal) and (found.code, found.field) == (code, f"until.{field}")
    assert found.bound and found.message


def test_a_direction_may_have_any_length():
    """What counts is where it points; none means any."""
    assert axis_of(Until(force_n=1.0, direction=(0.0, 3.0, -4.0))) == pytest.approx((0.0, 0.6, -0.8))
    assert axis_of(Until(force_n=200.0, back_off_m=0.1)) == ()


def test_what_would_have_to_be_felt_and_cannot_be_is_refused_with_the_arm_and_the_reason():
    """For motions, streams and loads alike."""
    refusal = unknown(Side.LEFT, "no efforts", "NO_EFFORTS")
    assert (refusal.code, refusal.field, refusal.value) == (Code.CONTACT_UNKNOWN, "left_arm", "NO_EFFORTS")
    assert refusal.message == "what pushes the left hand is unknown: no efforts"


def test_a_push_is_its_part_along_the_direction_or_its_size():
    """Against the direction it is negative; the deviation is that of the axes that take part."""
    view = felt(3.0, 0.0, -4.0)
    assert push_of(view, (0.0, 0.0, 1.0)) == Push(-4.0, 2.0)
    assert push_of(view, ()) == Push(5.0, 2.0)
    assert push_of(view, (0.6, 0.0, -0.8)) == Push(pytest.approx(5.0), pytest.approx(2.8))


def test_what_a_posture_does_not_feel_is_told_and_not_made_up():
    """A direction mostly along such an axis; a size where one axis is missing is that of the others."""
    view = felt(None, 3.0, 4.0)
    assert push_of(view, (0.0, 0.0, 1.0)) == Push(4.0, 2.0)
    assert push_of(view, (0.1, 0.0, math.sqrt(0.99))).force_n == pytest.approx(4.0, rel=0.01)
    assert "does not feel that direction" in push_of(view, (0.6, 0.0, 0.8)).why
    assert push_of(view, ()) == Push(5.0, 2.0)
    assert "feels no force" in push_of(felt(None, None, None), ()).why
    unknown = ContactView(state="unknown", code="NO_EFFORTS", reason="none came")
    assert push_of(unknown, ()).why == "NO_EFFORTS: none came"


def test_a_clear_push_counts_at_once_and_another_one_when_it_stays():
    """Clear is one standard deviation; what goes and comes again begins anew."""
    feeler = Feeler(force_n=8.0)
    assert not feeler.feels(Push(8.0, 2.0), 0)
    assert feeler.feels(Push(10.1, 2.0), 0)
    feeler = Feeler(force_n=8.0)
    assert not feeler.feels(Push(9.0, 2.0), 0)
    assert not feeler.feels(Push(9.0, 2.0), LASTS_NS - 1)
    assert not feeler.feels(Push(7.0, 2.0), LASTS_NS)
    assert not feeler.feels(Push(9.0, 2.0), LASTS_NS)
    assert feeler.feels(Push(9.0, 2.0), 2 * LASTS_NS)
