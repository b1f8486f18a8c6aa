"""Rules of `gateway.video.receiving.rtp_clock`: a time that never falls, and jumps that are recognised."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from gateway.video.receiving.rtp_clock import RtpClock
from tests.video.packets import TICKS

S = 1_000_000_000
FRAME_NS = 22_222_222


def test_time_goes_on_across_the_turn_of_32_bits() -> None:
    """13 hours at 90 kHz."""
    clock = RtpClock(2**32 - TICKS, 0)
    assert not clock.is_jump(TICKS, FRAME_NS)
    assert not clock.follow(TICKS, FRAME_NS)
    assert clock.time == 2**32 + TICKS


def test_the_same_timestamp_is_the_same_time() -> None:
    """All packets of a picture have one."""
    clock = RtpClock(500, 0)
    clock.follow(2500, FRAME_NS)
    assert not clock.follow(2500, FRAME_NS + 1) and clock.time == 2500


def test_a_pause_of_the_sender_is_no_jump() -> None:
    """Whether its clock went on meanwhile or not."""
    for step in (TICKS, 60 * 90_000):
        assert not RtpClock(0, 0).is_jump(step, 60 * S)


def test_a_step_back_or_far_ahead_is_a_jump() -> None:
    """No picture order and no network do that."""
    clock = RtpClock(90_000_000, 0)
    assert clock.is_jump(90_000_000 - 50_000, FRAME_NS)
    assert clock.is_jump(90_000_000 + 11 * 90_000, FRAME_NS)
    assert not clock.is_jump(90_000_000 - 2 * TICKS, FRAME_NS), "pictures may be shown in another order"


@given(st.lists(st.integers(-40_000, 800_000), max_size=60), st.integers(0, 2**32 - 1))
def test_time_never_falls(steps: list[int], start: int) -> None:
    """Whatever a sender does within the bounds of a jump; and while its own time rises ours is the same."""
    clock, sent, at_ns = RtpClock(start, 0), start, 0
    highest = start
    for step in steps:
        before, stamp, sent = clock.time, clock.stamp, highest + step
        at_ns += FRAME_NS
        assert not clock.is_jump(sent % 2**32, at_ns)
        fell = clock.follow(sent % 2**32, at_ns)
        assert clock.time > before or (clock.time == before and clock.stamp == sent % 2**32)
        if fell:
            assert step <= 0
        else:
            assert clock.time == (before if sent % 2**32 == stamp else max(sent, before + 1))
        highest = max(highest, sent)


def test_a_step_of_the_clock_is_stepped_over() -> None:
    """The distances behind it are those that were sent."""
    clock = RtpClock(1_000_000, 0)
    clock.follow(1_002_000, FRAME_NS)
    clock.step_over(77, 2 * FRAME_NS, TICKS)
    assert clock.time == 1_004_000
    clock.follow(77 + TICKS, 3 * FRAME_NS)
    assert clock.time == 1_006_000
