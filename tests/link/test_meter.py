"""Rules of `gateway.link.meter`: figures of the last seconds, exact for slow topics, and the robot's clock."""

from __future__ import annotations

import pytest

from gateway.link.mailbox import Tally
from gateway.link.meter import WINDOW_NS, Figure, Meter

MS = 1_000_000
S = 1_000_000_000
WALL_NS = 1_800_000_000 * S


class Topic:
    """A topic that is noted every quarter of a second, and the meter that does it."""

    def __init__(self, period_ns: int, copies: int = 0) -> None:
        self.meter = Meter()
        self.period_ns, self.copies = period_ns, copies
        self.samples = 0
        self.now_ns = 0
        self.is_silent = False

    def run(self, seconds: float) -> Figure:
        for _ in range(round(seconds * 4)):
            self.now_ns += 250 * MS
            if not self.is_silent:
                self.samples = self.now_ns // self.period_ns
            last_ns = self.samples * self.period_ns or None
            tally = Tally(self.samples, self.samples * self.copies, last_ns)
            self.meter.note(self.now_ns, {"/t": tally}, WALL_NS + self.now_ns)
        return self.meter.figures["/t"]


@pytest.mark.parametrize(("period_ns", "rate_hz"), [(5 * MS, 200.0), (50 * MS, 20.0), (S, 1.0), (3 * S, 1 / 3)])
def test_rates_are_exact_from_arrival_to_arrival(period_ns, rate_hz):
    """A topic of 1 Hz has no rate of 0.8 or 1.2 because of when one looked."""
    topic = Topic(period_ns)
    for _ in range(40):
        figure = topic.run(0.25)
        assert figure.rate_hz in (0.0, pytest.approx(rate_hz))
    assert topic.run(3.0).rate_hz == pytest.approx(rate_hz)


def test_copies_are_a_factor():
    """Three times the same sample is a rate as before, times three."""
    figure = Topic(5 * MS, copies=2).run(4.0)
    assert (figure.rate_hz, figure.times) == (pytest.approx(200.0), pytest.approx(3.0))


def test_what_falls_silent_has_no_rate_after_the_window():
    """Figures are of the last seconds; so are factors."""
    topic = Topic(5 * MS)
    assert topic.run(6.0).rate_hz == pytest.approx(200.0)
    topic.is_silent = True
    assert topic.run(WINDOW_NS / S + 0.5) == Figure()


def test_nothing_is_known_before_the_first_sample_and_after_a_loss():
    """No rate and no factor is made up."""
    topic = Topic(5 * MS)
    topic.is_silent = True
    assert topic.run(1.0) == Figure() and topic.meter.clock_ns is None
    topic.is_silent = False
    topic.run(1.0)
    topic.meter.stamp = (5 * S, topic.now_ns)
    topic.run(0.25)
    assert topic.meter.figures and topic.meter.clock_ns is not None
    topic.meter.forget()
    assert topic.meter.figures == {} and topic.meter.clock_ns is None and topic.meter.stamp is None


def test_the_clock_is_that_of_the_fastest_sample():
    """Samples are late by what they need to get here: the one that needed least is nearest to the truth."""
    meter, offset_ns = Meter(), -7 * S
    for n, late_ns in enumerate((30 * MS, 2 * MS, 80 * MS), start=1):
        arrived_ns = n * 250 * MS
        meter.stamp = (WALL_NS + arrived_ns - late_ns + offset_ns, arrived_ns)
        meter.note(arrived_ns + 3 * MS, {}, WALL_NS + arrived_ns + 3 * MS)
    assert meter.clock_ns == offset_ns - 2 * MS


def test_an_old_stamp_says_nothing_about_the_clock_now():
    """Who sent it may have been another robot; our own clock may have been set since."""
    meter = Meter()
    meter.stamp = (S, 0)
    meter.note(WINDOW_NS + 1, {}, WALL_NS)
    assert meter.clock_ns is None


def test_refused_samples_are_counted_with_the_last_reason():
    """So that a page can say what is wrong with the robot's samples."""
    meter = Meter()
    meter.refuse("/t", "too short")
    meter.refuse("/t", "no number")
    assert meter.refused == {"/t": (2, "no number")}
