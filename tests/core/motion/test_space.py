"""What joints and poses share: states, and the checks of numbers and factors."""

from __future__ import annotations

import math

import pytest

from gateway.core.motion.space import PlanFailed, Start, State, check_finite, check_speed

STILL = (0.0, -0.0, 0.0)


def test_a_state_rests_when_neither_velocity_nor_acceleration_is_left():
    """One that is about to move does not."""
    assert State((1.0, 2.0, 3.0), STILL, STILL).is_at_rest
    assert not State(STILL, (0.0, 1e-9, 0.0), STILL).is_at_rest
    assert not State(STILL, STILL, (0.0, 1e-9, 0.0)).is_at_rest


def test_a_start_is_equal_where_state_and_space_are():
    """Whoever planned from one knows whether it still holds."""
    state = State(STILL, STILL, STILL)
    assert Start(state, "space") == Start(state, "space") != Start(state, "another")


def test_finite_numbers_pass_as_a_tuple_and_others_are_refused_by_name():
    """Length and finiteness; there is no joint to blame."""
    assert check_finite("rates", [1, 2.5], 2) == (1, 2.5)
    for bad in ((1.0,), (1.0, math.nan), (math.inf, 1.0)):
        with pytest.raises(PlanFailed, match="rates") as failed:
            check_finite("rates", bad, 2)
        assert (failed.value.joint, failed.value.bound) == ("", "") and math.isnan(failed.value.value)


@pytest.mark.parametrize("speed", [0.0, -0.5, 1.0001, math.nan, math.inf])
def test_a_speed_that_is_no_factor_is_refused(speed):
    """A factor is above 0 and at most 1."""
    with pytest.raises(PlanFailed, match=r"speed is .*, a factor in \(0, 1\] is needed"):
        check_speed(speed)


def test_a_factor_passes():
    """Up to 1."""
    assert (check_speed(1.0), check_speed(0.01)) == (1.0, 0.01)
