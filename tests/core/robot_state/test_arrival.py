"""Tests of how arrivals are counted."""

from __future__ import annotations

import pytest

from gateway.core.messages.events import SampleArrived
from gateway.core.robot_state.arrival import FIGURES_NS, Meter, Recent
from gateway.robot.topics import FSM_STATE

MS = 1_000_000
S = 1_000_000_000


def arrived(count: int = 1, duplicates: int = 0, worst_gap_ns: int = 0) -> SampleArrived:
    """Return an arrival; what it carries does not matter here."""
    return SampleArrived(
        topic=FSM_STATE, value=0, received_ns=0, count=count, duplicates=duplicates, worst_gap_ns=worst_gap_ns
    )


def test_an_extreme_is_forgotten_after_ten_buckets():
    """The worst of the last ten seconds is not the worst of all time."""
    recent = Recent(max, S)
    recent.add(0, 70)
    recent.add(1, 50)
    recent.add(5 * S, 20)
    assert recent.extreme(5 * S, 0) == 70
    assert recent.extreme(12 * S, 0) == 20
    assert recent.extreme(30 * S, 3) == 3


def test_the_rate_is_that_of_samples_not_of_ticks():
    """Two samples a tick at 100 Hz are 200 Hz, and duplicates are counted apart."""
    meter = Meter()
    assert meter.rate_hz(0) == 0.0
    for n in range(200):
        meter.add(arrived(count=2, duplicates=1), n * 10 * MS)
    assert meter.rate_hz(199 * 10 * MS) == pytest.approx(200.0, rel=0.01)
    assert (meter.count, meter.duplicates, meter.refused) == (400, 200, 0)


def test_the_rate_falls_when_samples_are_missing():
    """A topic that has died does not keep its rate: up to now counts once more than two periods are missing."""
    meter = Meter()
    for n in range(100):
        meter.add(arrived(), n * 10 * MS)
    assert meter.rate_hz(1200 * MS) < 90.0
    assert meter.rate_hz(10 * S) == 0.0


def test_the_worst_gap_takes_the_links_word_and_the_present_silence():
    """Between two ticks only the link knows the gap; since the last sample the silence itself counts."""
    meter = Meter()
    assert meter.worst_gap_ns(5) == 0
    meter.add(arrived(), 0)
    meter.add(arrived(worst_gap_ns=33 * MS), 10 * MS)
    assert meter.worst_gap_ns(11 * MS) == 33 * MS
    assert meter.worst_gap_ns(500 * MS) == 490 * MS


def test_figures_for_views_are_computed_ten_times_a_second():
    """Fifty snapshots a second cost ten computations; a figure is never older than 0.1 s."""
    meter = Meter()
    meter.add(arrived(), 0)
    first = meter.figures(10 * MS)
    assert first == (0.0, 10 * MS)
    assert meter.figures(10 * MS + FIGURES_NS - 1) == first
    assert meter.figures(10 * MS + FIGURES_NS) == (0.0, 10 * MS + FIGURES_NS)
    assert meter.figures(5 * MS) == (0.0, 5 * MS)
