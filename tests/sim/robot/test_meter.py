"""Rules of the figures that the robot keeps about its command streams."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.sim.robot.manual import MS, S
from gateway.sim.robot.meter import MotionMeter, SetpointMeter, StreamMeter


def test_intervals_are_measured_at_arrival():
    """Rate, percentiles and the longest interval come from arrival times."""
    meter = StreamMeter()
    for number in range(101):
        meter.add(number * 10 * MS, number)
    meter.add(1000 * MS + 95 * MS, "last")
    figures = meter.as_dict(1200 * MS)
    assert figures["count"] == 102
    assert figures["rate_hz"] == pytest.approx(101 / 1.095, abs=0.01)
    assert (figures["p50_ms"], figures["max_ms"], figures["worst_gap_alive_ms"]) == (10.0, 95.0, 95.0)
    assert (figures["age_ms"], figures["last"]) == (105.0, "last")


def test_silence_of_more_than_a_second_ends_a_stream_and_is_no_gap():
    """Only gaps inside a stream's life count; a new beginning is another stream."""
    meter = StreamMeter()
    for now_ms in (0, 10, 20, 1020, 1030, 2031, 2041):
        meter.add(now_ms * MS, None)
    figures = meter.as_dict(3 * S)
    assert (figures["streams"], figures["worst_gap_alive_ms"]) == (2, 1000.0)


def test_gaps_beyond_the_robots_watchdogs_are_counted():
    """Gaps over 100 ms (gripper) and over 150 ms (arm) are told apart; the bounds themselves are no gap."""
    meter = StreamMeter()
    for now_ms in (0, 100, 201, 351, 502):
        meter.add(now_ms * MS, None)
    figures = meter.as_dict(S)
    assert (figures["gaps_over_100_ms"], figures["gaps_over_150_ms"]) == (3, 1)


def test_reset_forgets_everything():
    """After a reset the figures are those of a new meter."""
    meter = StreamMeter()
    meter.add(0, 1)
    meter.add(MS, 1)
    meter.reset()
    assert meter.as_dict(S) == StreamMeter().as_dict(S)
    assert meter.as_dict(S)["rate_hz"] is None


def test_how_old_a_stamped_message_is_counts_from_the_quickest_one():
    """The sender's clock may be an hour off; what waited for more than 100 ms on the way is late, and a reset forgets that."""
    meter = StreamMeter()
    hour_ns = 3600 * S
    for sent_ms, took_ms in ((0, 7), (10, 5), (20, 105), (30, 106), (40, 1205)):
        meter.add((sent_ms + took_ms) * MS, None, sent_ms * MS + hour_ns)
    figures = meter.as_dict(2 * S)
    assert (figures["oldest_ms"], figures["late"]) == (1200.0, 2)
    meter.reset()
    meter.add(3 * S + 155 * MS, None, 3 * S + hour_ns)
    assert (meter.as_dict(4 * S)["oldest_ms"], meter.as_dict(4 * S)["late"]) == (150.0, 1)


def test_a_message_without_a_stamp_has_no_age():
    """Poses and single numbers have none; a stamp that was never set says nothing."""
    meter = StreamMeter()
    meter.add(S, None)
    meter.add(2 * S, None, 0)
    assert (meter.as_dict(3 * S)["oldest_ms"], meter.as_dict(3 * S)["late"]) == (None, 0)


def sine(times_s):
    """Positions of a motion with known peaks: 0.2 sin(2 t) on joint 1, nothing else."""
    q = np.zeros((len(times_s), 7))
    q[:, 0] = 0.2 * np.sin(2.0 * times_s)
    return q


def test_peaks_of_a_smooth_motion_are_found():
    """Speed and acceleration of a known sine come out within two per cent; still joints have none."""
    meter = MotionMeter()
    for number, q in enumerate(sine(np.arange(0.0, 8.0, 0.005))):
        meter.add(number * 5 * MS, q)
    figures = meter.as_dict()
    assert figures["peak_radps"][0] == pytest.approx(0.4, rel=0.02)
    assert figures["peak_radps2"][0] == pytest.approx(0.8, rel=0.02)
    assert figures["peak_step_rad"][0] == pytest.approx(0.4 * 0.005, rel=0.02)
    assert figures["peak_radps"][1:] == [0.0] * 6


def test_one_sample_has_no_speed():
    """A lone sample gives no figure at all."""
    meter = MotionMeter()
    meter.add(0, np.ones(7))
    assert meter.as_dict()["peak_radps"] == [0.0] * 7


def test_a_break_is_not_a_jump():
    """Samples before and after a break are not compared."""
    meter = MotionMeter()
    for number in range(20):
        meter.add(number * 10 * MS, np.zeros(7))
    meter.break_off()
    for number in range(20, 40):
        meter.add(number * 10 * MS, np.ones(7))
    assert meter.as_dict()["peak_step_rad"] == [0.0] * 7


def test_jitter_of_the_network_does_not_look_like_acceleration():
    """A smooth 100 Hz stream with up to 8 ms of delay keeps its true peaks."""
    meter = SetpointMeter()
    rng = np.random.default_rng(5)
    for number, q in enumerate(sine(np.arange(0.0, 8.0, 0.01))):
        meter.add(number * 10 * MS + int(rng.uniform(0, 8) * MS), q)
    figures = meter.as_dict()
    assert figures["peak_radps"][0] == pytest.approx(0.4, rel=0.05)
    assert figures["peak_radps2"][0] == pytest.approx(0.8, rel=0.1)


@pytest.mark.parametrize("stall_ms", [40, 60, 90, 140])
def test_setpoints_that_pile_up_and_come_at_once_do_not_look_like_acceleration(stall_ms):
    """The receiver stood still now and then: neither the gap nor the burst behind it says how often they were sent."""
    meter = SetpointMeter()
    for number, q in enumerate(sine(np.arange(0.0, 8.0, 0.01))):
        sent_ms = number * 10
        held_until_ms = sent_ms // 500 * 500 + stall_ms  # a stall at the begin of each half second
        meter.add(int((max(sent_ms, held_until_ms) + 0.1 * (number % 50)) * MS), q)
    figures = meter.as_dict()
    assert figures["peak_radps"][0] == pytest.approx(0.4, rel=0.05)
    assert figures["peak_radps2"][0] == pytest.approx(0.8, rel=0.1)


def test_an_interrupted_stream_begins_a_new_time_line():
    """A step across a gap beyond the arm's watchdog is a new start, not a jump of the stream."""
    meter = SetpointMeter()
    for number in range(30):
        meter.add(number * 10 * MS, np.zeros(7))
    for number in range(30):
        meter.add(2 * S + number * 10 * MS, np.ones(7))
    assert meter.as_dict()["peak_step_rad"] == [0.0] * 7


def test_a_step_inside_a_stream_is_found():
    """The largest difference of two consecutive setpoints is reported."""
    meter = SetpointMeter()
    for number in range(40):
        meter.add(number * 10 * MS, np.full(7, 0.0 if number < 25 else 0.3))
    assert max(meter.as_dict()["peak_step_rad"]) == pytest.approx(0.3)


@pytest.mark.parametrize("is_lost", [False, True], ids=["nothing lost", "one lost"])
def test_a_setpoint_lost_with_its_sender_does_not_look_like_acceleration(is_lost):
    """Its sender froze with it, somebody else goes on 90 ms later: no speed is made of that, and no step of two."""
    meter = SetpointMeter()
    for number, q in enumerate(sine(np.arange(0.0, 8.0, 0.01))):
        if number < 400:
            meter.add(number * 10 * MS, q)
        elif number > 400 or not is_lost:
            meter.add(number * 10 * MS + 80 * MS, q)
    figures = meter.as_dict()
    assert figures["peak_radps"][0] == pytest.approx(0.4, rel=0.02)
    assert figures["peak_radps2"][0] == pytest.approx(0.8, rel=0.05)
    assert figures["peak_step_rad"][0] == pytest.approx(0.004, rel=0.02)


def test_a_step_over_a_silence_is_found():
    """Whoever goes on must go on from there: two setpoints' way is allowed, not more."""
    meter = SetpointMeter()
    for number in range(60):
        late = 80 * MS if number >= 40 else 0
        meter.add(number * 10 * MS + late, np.full(7, 0.0 if number < 40 else 0.3))
    assert max(meter.as_dict()["peak_step_rad"]) == pytest.approx(0.15)
