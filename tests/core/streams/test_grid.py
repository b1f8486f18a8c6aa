"""The grid: absolute instants, each given once, missed ones skipped, exact on a host that has been up for years."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.streams.grid import Grid

MS = 1_000_000
S = 1_000_000_000
DAY = 86_400 * S
RATES_HZ = (100.0, 70.0, 50.0, 20.0)


def instants(rate_hz: float, start_ns: int, count: int) -> list[int]:
    """The next instants of a grid that is always on time."""
    grid = Grid(rate_hz)
    grid.start(start_ns)
    found = [grid.due(start_ns)]
    while len(found) < count:
        found.append(grid.due(grid.next_ns()))
    return [instant for instant in found if instant is not None]


def newest(rate_hz: float, now_ns: int) -> int:
    """The newest instant that is not after now, by exact fractions [ns]."""
    period_ns = Fraction(S) / Fraction(rate_hz)
    index = int(now_ns / period_ns)
    return max(ns for ns in (round(index * period_ns), round((index + 1) * period_ns)) if ns <= now_ns)


def test_a_started_grid_is_due_at_once_and_then_on_multiples_of_the_period():
    """The first frame of a stream does not wait for its grid; the second one joins it."""
    grid = Grid(100.0)
    grid.start(1_003 * MS)
    assert grid.due(1_003 * MS) == 1_000 * MS
    assert (grid.due(1_003 * MS), grid.due(1_009 * MS), grid.next_ns()) == (None, None, 1_010 * MS)
    assert grid.due(1_010 * MS) == 1_010 * MS


def test_a_grid_that_starts_again_is_due_at_once_again():
    """A second start within one period gives the same instant anew: the new stream's first frame waits for nothing."""
    grid = Grid(20.0)
    grid.start(100 * MS)
    assert grid.due(110 * MS) == 100 * MS
    grid.start(120 * MS)
    assert (grid.due(120 * MS), grid.due(120 * MS), grid.next_ns()) == (100 * MS, None, 150 * MS)


def test_of_missed_instants_only_the_newest_is_given():
    """Nothing is caught up: a burst would compress the path in time (DESIGN §2, realtime)."""
    grid = Grid(100.0)
    grid.start(0)
    assert grid.due(0) == 0
    assert grid.due(57 * MS) == 50 * MS
    assert (grid.due(59 * MS), grid.due(60 * MS)) == (None, 60 * MS)


def test_the_first_instant_of_the_clock_is_an_instant_like_any_other():
    """A host whose clock has just begun."""
    grid = Grid(100.0)
    grid.start(3 * MS)
    assert (grid.due(3 * MS), grid.due(9 * MS), grid.due(10 * MS)) == (0, None, 10 * MS)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("up_ns", [0, DAY, 100 * DAY, 366 * DAY], ids=lambda ns: f"up {ns // DAY} days")
def test_intervals_have_one_length_at_any_uptime(rate_hz, up_ns):
    """70 Hz is 14.29 ms and not 10 and 20 ms in turn (BEHAVIOUR, values); floats may cost some ns in a year."""
    found = instants(rate_hz, up_ns, 300)
    assert len(found) == 300
    for before, after in pairwise(found):
        assert abs(after - before - S / rate_hz) <= 5


def test_streams_of_commensurate_rates_share_their_wake_ups():
    """Every 50 Hz and 20 Hz instant is a 100 Hz one: the loop wakes no more often for them."""
    fast = set(instants(100.0, 7 * DAY, 200))
    assert set(instants(50.0, 7 * DAY, 100)) <= fast
    assert set(instants(20.0, 7 * DAY, 40)) <= fast


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("up_ns", [DAY, 130 * DAY, 1000 * DAY], ids=lambda ns: f"up {ns // DAY} days")
def test_an_instant_is_due_from_its_very_nanosecond_on(rate_hz, up_ns):
    """One before it is not due, however rounding falls: what `next_ns` names is given then and not before."""
    grid = Grid(rate_hz)
    grid.start(up_ns)
    grid.due(up_ns)
    for _ in range(50):
        next_ns = grid.next_ns()
        assert grid.due(next_ns - 1) is None
        assert grid.due(next_ns) == next_ns


@given(rate_hz=st.sampled_from(RATES_HZ), times_ns=st.lists(st.integers(0, DAY), min_size=1, max_size=20))
def test_what_is_due_is_the_newest_instant_that_has_come(rate_hz, times_ns):
    """Against exact fractions: never one of the future, never an older one, never one twice."""
    grid, given_ns = Grid(rate_hz), -1
    for now_ns in sorted(times_ns):
        newest_ns = newest(rate_hz, now_ns)
        assert grid.due(now_ns) == (None if newest_ns == given_ns else newest_ns)
        assert newest_ns <= now_ns < grid.next_ns()
        given_ns = newest_ns


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("up_ns", [0, DAY, 100 * DAY, 366 * DAY, 3000 * DAY], ids=lambda ns: f"up {ns // DAY} days")
def test_a_start_at_an_instant_or_just_before_it_finds_the_right_one(rate_hz, up_ns):
    """Rounding and floats of a host that is long up lead neither to an instant too late nor to one too early."""
    for instant_ns in instants(rate_hz, up_ns, 200)[1:]:
        at, before = Grid(rate_hz), Grid(rate_hz)
        at.start(instant_ns)
        assert at.due(instant_ns) == instant_ns
        before.start(instant_ns - 1)
        early_ns = before.due(instant_ns - 1)
        assert early_ns is not None and early_ns < instant_ns == before.next_ns()
