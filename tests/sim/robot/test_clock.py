"""Rules of the robot's clock."""

from __future__ import annotations

import pytest

from gateway.sim.robot.clock import RobotClock
from gateway.sim.robot.manual import MS, S

EPOCH_NS = 1_795_600_000 * S


def test_a_clock_that_nobody_mistunes_is_the_wall_clock():
    """Also when that is set."""
    clock = RobotClock(EPOCH_NS, 5 * S)
    assert clock.stamp_ns(7 * S) == EPOCH_NS + 7 * S
    clock.epoch_ns += 3600 * S
    assert clock.stamp_ns(7 * S) == EPOCH_NS + 3607 * S


def test_an_offset_is_there_at_once_and_gone_when_it_ends():
    """The clock was set, and is set back."""
    clock = RobotClock(EPOCH_NS, 0)
    clock.mistune(1 * S, -50 * MS, 0.0)
    assert clock.stamp_ns(1 * S) == EPOCH_NS + 950 * MS
    clock.mistune(2 * S, 0, 0.0)
    assert clock.stamp_ns(2 * S) == EPOCH_NS + 2 * S


@pytest.mark.parametrize("drift_ppm", [500.0, -500.0])
def test_a_drift_adds_up_without_a_step_and_what_it_made_stays(drift_ppm):
    """30 ms in a minute at 500 ppm: neither the beginning nor the end is seen in the stamps, and no offset takes it away."""
    clock = RobotClock(EPOCH_NS, 0)
    clock.mistune(10 * S, 0, drift_ppm)
    assert clock.stamp_ns(10 * S) == EPOCH_NS + 10 * S
    gained_ns = round(60 * S * drift_ppm * 1e-6)
    assert clock.stamp_ns(70 * S) == EPOCH_NS + 70 * S + gained_ns
    clock.mistune(70 * S, 0, 0.0)
    clock.mistune(80 * S, 1 * S, 0.0)
    assert clock.stamp_ns(90 * S) == EPOCH_NS + 91 * S + gained_ns
