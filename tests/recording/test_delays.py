"""Tests of the delays between stamp and arrival: what a clock that was set looks like, and what does not."""

from __future__ import annotations

import pytest

from gateway.recording.delays import STEP_NS, Delays, merged, step_ns, widened
from tests.recording.bags import BEGIN_NS

S, MS = 1_000_000_000, 1_000_000


def least(seconds, ahead, late=lambda n: MS, period_ns=5 * MS):
    """Return the smallest delays of a topic: how far its clock is ahead [ns], by the time [s]; how late a message is [ns]."""
    delays = Delays()
    for n in range(int(seconds * S / period_ns)):
        sent_ns = BEGIN_NS + n * period_ns
        delays.add(sent_ns + late(n), sent_ns + ahead(n * period_ns / S))
    return delays.least


@pytest.mark.parametrize("by_ms", [400, -400, 60, -60])
@pytest.mark.parametrize(("seconds", "at_s"), [(8, 4), (45, 4), (45, 22), (45, 42), (3, 1)])
def test_a_clock_that_is_set_shows_from_the_second_to_the_last_but_one_second_on(seconds, at_s, by_ms):
    """In a short bag, and near either end of a long one: by how much, and which way."""
    assert step_ns(least(seconds, lambda t_s: by_ms * MS if t_s >= at_s else 0)) == by_ms * MS


def test_neither_drift_nor_a_busy_network_is_a_clock_that_was_set():
    """200 ppm for an hour of one message a second; what was held up for up to 0.3 s comes at once; silence of 20 s."""
    assert step_ns(least(3600, lambda t_s: int(t_s * 200_000), period_ns=S)) == 0
    assert step_ns(least(10, lambda t_s: 0, late=lambda n: max(0, 60 - n % 100) * 5 * MS)) == 0
    quiet = least(30, lambda t_s: 0)
    assert step_ns({window: delay for number, (window, delay) in enumerate(quiet.items()) if not 5 < number < 25}) == 0


@pytest.mark.parametrize("number", [0, 1, 100, 199])
def test_a_single_stamp_that_is_ahead_is_no_delay(number):
    """Neither at either end of a bag that is shorter than a window."""
    found = least(1, lambda t_s: 10 * S if round(t_s * 200) == number else 0)
    assert step_ns(found) == 0 and min(found.values()) == MS


def test_the_delays_of_one_clock_are_put_together():
    """Of each window the smallest, in the order of time, in longer windows too."""
    found = merged([{20: 5 * MS, 21: 7 * MS}, {10: MS, 21: 6 * MS}])
    assert list(found.items()) == [(10, MS), (20, 5 * MS), (21, 6 * MS)]
    assert widened(found) == {1: MS, 2: 5 * MS}
    assert step_ns({1: 0, 2: STEP_NS}) == 0 and step_ns({1: 0, 2: STEP_NS + 1}) == -STEP_NS - 1 and step_ns({}) == 0
