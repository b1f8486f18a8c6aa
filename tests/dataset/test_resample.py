"""Tests of resampling: each rule, and that none reaches across a gap."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.dataset.resample import resample
from gateway.dataset.series import Series

TIMES = np.array([0, 100, 200, 600, 700], dtype=np.int64)
SERIES = Series(times_ns=TIMES, values=np.array([[0.0], [1.0], [2.0], [6.0], [7.0]]))


def asked(rule, at, stale_ns=150, series=SERIES):
    """Return values, None where there is none."""
    values, ok = resample(series, np.array(at, dtype=np.int64), rule, stale_ns)
    assert np.all(values[~ok] == 0.0)
    return [float(value) if good else None for (value,), good in zip(values, ok, strict=True)]


@pytest.mark.parametrize(
    ("rule", "expected"),
    [
        ("hold", [None, 0.0, 0.0, 1.0, 2.0, None, 6.0, 7.0, None]),
        ("next", [0.0, 0.0, 1.0, 2.0, None, 6.0, 7.0, None, None]),
        ("nearest", [0.0, 0.0, 0.0, 1.0, 2.0, 6.0, 6.0, 7.0, None]),
        ("linear", [None, 0.0, 0.4, 1.1, None, None, 6.5, None, None]),
    ],
)
def test_each_rule_finds_its_sample_and_none_across_a_gap(rule, expected):
    """Before the first, on it, between, in the gap of 400 at its two ends, after the last, long after it."""
    found = asked(rule, [-40, 0, 40, 110, 250, 500, 650, 720, 900])
    assert found == [value if value is None else pytest.approx(value) for value in expected]


def test_a_sample_exactly_as_old_as_may_be_counts():
    """One nanosecond more does not."""
    assert asked("hold", [350, 351]) == [2.0, None]
    assert asked("next", [450, 449]) == [6.0, None]
    assert asked("linear", [400], stale_ns=400) == [4.0]
    assert asked("linear", [400], stale_ns=399) == [None]


@given(st.lists(st.floats(-3.1, 3.1), min_size=2, max_size=20), st.lists(st.booleans(), min_size=20, max_size=20))
def test_turns_go_the_shorter_way_whatever_the_signs_of_their_quaternions(angles, flips):
    """Unit quaternions, whose sign never changes from one row to the next by more than half a turn does."""
    times = np.arange(len(angles), dtype=np.int64) * 100
    signs = np.where(flips[: len(angles)], -1.0, 1.0)
    half = np.array(angles) / 2
    values = signs[:, np.newaxis] * np.stack(
        [np.zeros_like(half), np.zeros_like(half), np.sin(half), np.cos(half)], axis=1
    )
    at = np.arange(0, int(times[-1]) + 1, 10)
    found, ok = resample(Series(times_ns=times, values=values), at, "slerp", 150)
    assert ok.all() and np.allclose(np.linalg.norm(found, axis=1), 1.0)
    assert np.all(np.sum(found[1:] * found[:-1], axis=1) >= -1e-12)
    exact = found[::10]
    assert np.allclose(np.abs(np.sum(exact * values, axis=1)), 1.0)


def test_half_way_between_two_turns_is_half_the_turn():
    """At a constant rate, as no mean of the numbers is."""
    quarter = np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, np.sin(0.8), np.cos(0.8)]])
    series = Series(times_ns=np.array([0, 100], dtype=np.int64), values=-7.0 * quarter)
    found, _ = resample(series, np.array([25], dtype=np.int64), "slerp", 150)
    assert np.abs(found[0]) == pytest.approx([0.0, 0.0, np.sin(0.2), np.cos(0.2)])


def test_no_turn_is_no_value():
    """A quaternion of length 0 says nothing."""
    series = Series(times_ns=np.array([0, 100], dtype=np.int64), values=np.zeros((2, 4)))
    assert not resample(series, np.array([50], dtype=np.int64), "slerp", 150)[1].any()
