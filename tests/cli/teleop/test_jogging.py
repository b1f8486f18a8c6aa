"""Tests of jogging in numbers: speeds, ramps, the deadman of keys, poses."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.api.translate import describe
from gateway.cli.teleop.jogging import AXES, HAND, LEVELS, KeyDeadman, Ramp, apart, full_speeds, moved
from gateway.settings.settings import Settings

INFO = describe(Settings(), socket="/s", pid=1)
MS = 1_000_000
STEP_S = 0.02
POSE = (0.3, 0.1, -0.4, 0.5, -0.5, 0.5, 0.5)

wishes = st.dictionaries(st.sampled_from(AXES), st.floats(-3.0, 3.0) | st.sampled_from([math.nan, math.inf, -math.inf]))
steps = st.lists(st.tuples(wishes, st.floats(0.001, 0.04)), min_size=1, max_size=60)


def test_full_speed_is_never_above_the_gateways_limits():
    """At any level; each is faster than the one before."""
    before = dict.fromkeys(AXES, 0.0)
    for level in range(len(LEVELS)):
        full = full_speeds(INFO, level)
        assert all(full[axis] <= INFO.pose_v_mps for axis in ("x", "y", "z"))
        assert all(full[axis] <= INFO.pose_w_radps for axis in ("roll", "pitch", "yaw"))
        assert full["joint"] <= INFO.v_radps and full["lift"] <= INFO.lift_v_max
        assert full["vx"] == full["vy"] <= INFO.chassis_v_mps and full["wz"] <= INFO.chassis_w_radps
        assert all(full[axis] > before[axis] for axis in AXES)
        before = full


def test_a_diagonal_at_full_speed_is_inside_the_gateways_bound():
    """Which is on the sum of squares, and allows nothing above it."""
    full = full_speeds(INFO, len(LEVELS) - 1)
    for degrees in range(360):
        wish = {"vx": 2.0 * math.cos(math.radians(degrees)), "vy": 2.0 * math.sin(math.radians(degrees))}
        parts = Ramp().step(wish, 1.0)
        assert math.hypot(*(parts[axis] * full[axis] for axis in wish)) <= INFO.chassis_v_mps, degrees


@given(steps)
def test_no_vector_is_ever_longer_than_full_speed_and_nothing_jumps(steps):
    """Whatever is wished for, NaN and infinity too."""
    ramp, before = Ramp(), dict.fromkeys(AXES, 0.0)
    for wish, dt_s in steps:
        now = ramp.step(wish, dt_s)
        for group in (HAND[:3], HAND[3:], ("vx", "vy"), ("joint",), ("wz",), ("lift",)):
            assert math.hypot(*(now[axis] for axis in group)) <= 1.0 + 1e-12
        assert all(abs(now[axis] - before[axis]) <= 10.0 * dt_s + 0.3 * dt_s * 10.0 + 1e-12 for axis in AXES)
        before = now


@given(steps)
def test_what_is_let_go_is_at_rest_after_a_tenth_of_a_second(steps):
    """From any speed, and it never turns back."""
    ramp = Ramp()
    for wish, dt_s in steps:
        before = ramp.step(wish, dt_s)
    for _ in range(6):
        now = ramp.step({}, STEP_S)
        assert all(abs(now[axis]) <= abs(before[axis]) and now[axis] * before[axis] >= 0.0 for axis in AXES)
        before = now
    assert not any(now.values())


def way_of(presses_ms, until_ms=3000, key="w"):
    """Return how far a target goes at full speed 1 when a key arrives at these times, and the steps [m]."""
    deadman, ramp, way, presses = KeyDeadman(), Ramp(), [], list(presses_ms)
    for now_ms in range(0, until_ms, 20):
        while presses and presses[0] <= now_ms:
            deadman.press(key, presses.pop(0) * MS)
        pressed, level = deadman.level(now_ms * MS)
        way.append(STEP_S * ramp.step({"x": level} if pressed else {}, STEP_S)["x"])
    return sum(way), way


def test_a_tap_is_a_small_step():
    """A tenth of a second of full speed, however long a terminal waits before it repeats."""
    assert 0.05 < way_of([0])[0] < 0.1
    assert way_of([0, 1500])[0] < 0.2


@pytest.mark.parametrize("delay_ms", [150, 250, 500, 590])
@pytest.mark.parametrize("period_ms", [25, 33, 90])
def test_a_held_key_moves_on_without_a_pause_from_its_first_press(delay_ms, period_ms):
    """Slowly at first, at full speed once it is repeated; within 0.4 s after the last one it rests."""
    last_ms = delay_ms + 1000
    _, way = way_of([0, *range(delay_ms, last_ms, period_ms)])
    moving = [n for n, step in enumerate(way) if step > 0.0]
    assert moving == list(range(moving[0], moving[-1] + 1)) and moving[0] == 0
    assert max(way) == pytest.approx(STEP_S) and moving[-1] * 20 <= last_ms + 400


@given(st.lists(st.integers(160, 590), min_size=1, max_size=10))
def test_a_finger_that_taps_never_reaches_full_speed(gaps):
    """Only what comes as quickly as a terminal repeats counts as held."""
    presses = [sum(gaps[:n]) for n in range(len(gaps) + 1)]
    assert max(way_of(presses, presses[-1] + 1000)[1]) <= 0.15 * STEP_S + 1e-12


def test_another_key_lets_go_of_the_first():
    """And an empty one of any."""
    deadman = KeyDeadman()
    for now_ms in (0, 30, 60):
        deadman.press("w", now_ms * MS)
    assert deadman.level(70 * MS) == ("w", 1.0) and deadman.level(320 * MS) == ("", 0.0)
    deadman.press("s", 90 * MS)
    assert deadman.level(100 * MS) == ("s", 0.15)
    deadman.press("", 110 * MS)
    assert deadman.level(110 * MS)[0] == ""


unit = st.floats(-1.0, 1.0)


@given(st.tuples(*[unit] * 6), st.floats(0.001, 0.04), st.booleans())
def test_a_step_goes_as_far_as_its_twist_says_and_back(twist, dt_s, in_hand):
    """In either axes; orientations keep norm 1."""
    there = moved(POSE, twist, dt_s, in_hand=in_hand)
    gap_m, gap_rad = apart(there, POSE)
    assert gap_m == pytest.approx(math.hypot(*twist[:3]) * dt_s, abs=1e-12)
    assert gap_rad == pytest.approx(math.hypot(*twist[3:]) * dt_s, abs=1e-9)
    assert math.hypot(*there[3:]) == pytest.approx(1.0)
    turned = tuple(-v for v in twist[3:])
    back = moved(there, (0.0, 0.0, 0.0, *turned), dt_s, in_hand=in_hand)
    assert apart(back, POSE)[1] < 1e-9


def test_the_axes_are_those_that_were_named():
    """Of the shoulder frame, or the hand's own, which here are the others in turn."""
    assert moved(POSE, (1.0, 0, 0, 0, 0, 0), 0.1, in_hand=False)[:3] == pytest.approx((0.4, 0.1, -0.4))
    x, y, z = (b - a for a, b in zip(POSE[:3], moved(POSE, (1.0, 0, 0, 0, 0, 0), 0.1, in_hand=True)[:3], strict=True))
    assert sorted(map(abs, (x, y, z))) == pytest.approx([0.0, 0.0, 0.1]) and abs(x) < 1e-9
    quarter = moved((0, 0, 0, 0, 0, 0, 1.0), (0, 0, 0, 0, 0, 1.0), math.pi / 2, in_hand=False)
    assert quarter[3:] == pytest.approx((0, 0, math.sqrt(0.5), math.sqrt(0.5)))
