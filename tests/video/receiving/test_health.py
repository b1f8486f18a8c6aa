"""Tests of rates and latencies: what is handed out is of the last two seconds, and stops when the frames stop."""

from __future__ import annotations

import pytest

from gateway.video.receiving.health import Meter, Reading

PERIOD_NS = 20_000_000
MS = 1_000_000
S = 1_000_000_000


def metered(count, *, damaged=0):
    """Return a meter of so many frames at 50 Hz, and the time of the newest one."""
    meter = Meter()
    for n in range(count):
        meter.published(n * PERIOD_NS, (10 + n % 3) * MS, 4 * MS, clean=n >= damaged)
    return meter, (count - 1) * PERIOD_NS


def test_nothing_is_measured_before_the_first_frame():
    """Zeros, no division by them."""
    assert Meter().reading(5 * S) == Reading()


def test_the_rate_is_that_of_the_last_two_seconds():
    """Also with few frames."""
    for count in (2, 10, 1000):
        meter, now_ns = metered(count)
        assert meter.reading(now_ns + 5 * MS).fps == pytest.approx(50.0)
    assert metered(1)[0].reading(0).fps == 0.0


def test_the_rate_falls_when_frames_stop():
    """Nobody shall believe in a camera that has ended."""
    meter, now_ns = metered(200)
    rates = [meter.reading(now_ns + ms * MS).fps for ms in (0, 500, 1000, 2500)]
    assert rates == sorted(rates, reverse=True) and rates[2] < 30.0 and rates[3] == 0.0


def test_latency_is_the_median_and_the_worst_of_lately():
    """In milliseconds."""
    meter, now_ns = metered(200, damaged=3)
    reading = meter.reading(now_ns)
    assert (reading.latency_ms, reading.worst_latency_ms, reading.decode_ms) == (11.0, 12.0, 4.0)
    assert (reading.frames, reading.damaged) == (200, 3)


def test_counters_add_up():
    """What was withheld, refused or could not be decoded is told apart."""
    meter, now_ns = metered(10)
    meter.add(withheld=2, undecodable=3)
    meter.refused(now_ns)
    reading = meter.reading(now_ns)
    assert (reading.frames, reading.withheld, reading.undecodable, reading.errors) == (10, 2, 3, 1)
    assert meter.since(now_ns - PERIOD_NS) == (2, 1) and meter.since(now_ns + 1) == (0, 0)
