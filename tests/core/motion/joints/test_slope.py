"""Slopes: velocities that the robot's own ramps can follow, whatever is asked for and when."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.motion.joints.slope import Slope

PERIOD_S = 0.05
UP, DOWN, JERK = 0.3, 0.6, 2.0


def slope(width: int = 1) -> Slope:
    """One with the robot's ramps."""
    return Slope(width, up=UP, down=DOWN, jerk=JERK, period_s=PERIOD_S)


def steps_to(one: Slope, wanted: float, most: int = 200) -> list[float]:
    """Step until the velocity stays where it is wanted."""
    seen = []
    while (one.velocity != (wanted,) or not seen) and len(seen) < most:
        seen.append(one.step((wanted,))[0])
    return seen


def test_it_begins_at_rest():
    """Nothing is commanded before something is asked for."""
    one = slope(3)
    assert one.is_at_rest and one.velocity == (0.0, 0.0, 0.0)
    assert one.step((0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0) and one.is_at_rest


@pytest.mark.parametrize("wanted", [0.3, -0.3, 0.5, 0.01])
def test_it_arrives_exactly_and_in_the_shortest_time(wanted):
    """As long as acceleration and jerk need: v/a + a/j, or less where the full acceleration is never reached."""
    one = slope()
    seen = steps_to(one, wanted)
    full_s = abs(wanted) / UP + UP / JERK if abs(wanted) > UP**2 / JERK else 2 * (abs(wanted) / JERK) ** 0.5
    assert seen[-1] == wanted and not one.is_at_rest and one.step((wanted,)) == (wanted,)
    assert full_s <= len(seen) * PERIOD_S + 1e-9 < full_s + 2 * PERIOD_S
    down = steps_to(one, 0.0)
    assert down[-1] == 0.0 and one.is_at_rest and len(down) < len(seen) + 1


def test_a_reversal_comes_to_rest_first():
    """The limits change at zero: down by the faster ramp, then up by the slower."""
    one = slope()
    steps_to(one, 0.3)
    seen = steps_to(one, -0.3)
    assert 0.0 in seen and seen[-1] == -0.3
    middle = seen.index(0.0)
    assert all(v > 0.0 for v in seen[:middle]) and all(v <= 0.0 for v in seen[middle:])


def test_a_halt_is_at_once():
    """What a stop frame says is what is commanded."""
    one = slope(2)
    for _ in range(10):
        one.step((0.3, -0.2))
    one.halt()
    assert one.is_at_rest and one.velocity == (0.0, 0.0)


@given(st.lists(st.tuples(st.sampled_from([0.5, 0.3, 0.1, 0.0, -0.05, -0.3, -0.5]), st.integers(1, 12)), max_size=12))
def test_no_sequence_of_wishes_breaks_a_ramp(wishes):
    """Growing by at most 0.3, shrinking by at most 0.6 (manual §4.5), the jerk limited, never faster than was ever asked."""
    one, before, rate, fastest = slope(), 0.0, 0.0, 0.0
    for wanted, count in wishes:
        fastest = max(fastest, abs(wanted))
        for _ in range(count):
            (after,) = one.step((wanted,))
            grows = abs(after) > abs(before) and after * before >= 0.0
            assert abs(after - before) <= (UP if grows else DOWN) * PERIOD_S + 1e-9
            new_rate = (after - before) / PERIOD_S
            assert abs(new_rate - rate) <= JERK * PERIOD_S + 1e-9
            assert abs(after) <= fastest + 1e-9
            before, rate = after, new_rate
    for _ in range(100):
        one.step((0.0,))
    assert one.is_at_rest
