"""What was sent on a stream: counts, rate and gaps of what left, without the silences that were meant."""

from __future__ import annotations

import inspect
from collections.abc import Iterable

import pytest

from gateway.core.streams.stream import SentLog, Stream

MS = 1_000_000
S = 1_000_000_000


def logged(times_ns: Iterable[int]) -> SentLog:
    """A log of frames that left at these times."""
    log = SentLog()
    for now_ns in times_ns:
        log.note(now_ns)
    return log


def test_a_stream_that_never_sent_has_no_figures():
    """Before the first frame: not running, no rate, no gap."""
    view = SentLog().view(5 * S)
    assert (view.running, view.sent, view.rate_hz, view.worst_gap_ns) == (False, 0, 0.0, 0)


def test_one_frame_is_no_rate_and_no_gap():
    """Both need two."""
    view = logged([5 * S]).view(5 * S)
    assert (view.running, view.sent, view.rate_hz, view.worst_gap_ns) == (True, 1, 0.0, 0)


@pytest.mark.parametrize(("period_ms", "rate_hz"), [(10, 100.0), (20, 50.0), (50, 20.0)])
def test_the_rate_is_that_of_the_last_two_seconds(period_ms, rate_hz):
    """Whatever the stream sent before: a rate that changed long ago is not averaged in."""
    slow = range(0, 3 * S, 400 * MS)
    fast = range(3 * S, 6 * S, period_ms * MS)
    log = logged([*slow, *fast])
    assert log.view(6 * S - period_ms * MS).rate_hz == pytest.approx(rate_hz)
    assert log.sent == len(slow) + len(fast)


def test_the_worst_gap_is_remembered_for_ten_seconds():
    """The longest of them all, not the latest; it is forgotten with its frame, and then the next worst counts."""
    log = logged([*range(0, S, 10 * MS), 1 * S + 70 * MS, *range(1 * S + 80 * MS, 6 * S, 10 * MS)])
    log.note(6 * S + 30 * MS)
    for now_ns in range(6 * S + 40 * MS, 18 * S, 10 * MS):
        log.note(now_ns)
        if now_ns <= 11 * S + 70 * MS:
            assert log.view(now_ns).worst_gap_ns == 80 * MS
        elif now_ns <= 16 * S + 30 * MS:
            assert log.view(now_ns).worst_gap_ns == 40 * MS
        else:
            assert log.view(now_ns).worst_gap_ns == 10 * MS


def test_figures_grow_old_without_new_frames():
    """A view long after the last frame shows no rate and no gap of before."""
    log = logged([0, 10 * MS, 500 * MS])
    assert log.view(600 * MS).worst_gap_ns == 490 * MS
    view = log.view(11 * S)
    assert (view.running, view.sent, view.rate_hz, view.worst_gap_ns) == (True, 3, 0.0, 0)


def test_a_silence_that_was_meant_is_no_gap_and_no_slow_rate():
    """A stream that was ended and starts again is judged from its new start; its gaps of before still show."""
    log = logged(range(0, S, 10 * MS))
    log.end()
    ended = log.view(S)
    assert (ended.running, ended.sent, ended.rate_hz, ended.worst_gap_ns) == (False, 100, 0.0, 10 * MS)
    for now_ns in range(2 * S, 2 * S + 500 * MS, 10 * MS):
        log.note(now_ns)
    again = log.view(2 * S + 500 * MS)
    assert (again.running, again.sent, again.worst_gap_ns) == (True, 150, 10 * MS)
    assert again.rate_hz == pytest.approx(100.0)


def test_a_stream_is_five_words():
    """Whatever sends to the robot has this shape; body, collector and gate know no other (DESIGN §6)."""
    words = {name for name in {**vars(Stream), **inspect.get_annotations(Stream)} if not name.startswith("_")}
    assert words == {"topic", "log", "running", "next_due_ns", "frame"}


def test_the_worst_gap_is_known_with_its_end_until_it_is_old() -> None:
    """When it ended and how long it was; nothing before the second frame, and nothing after 10 s."""
    log = SentLog()
    assert log.worst_gap(0) is None
    for at_ms in (0, 10, 90, 100):
        log.note(at_ms * 1_000_000)
    assert log.worst_gap(200_000_000) == (90_000_000, 80_000_000)
    assert log.worst_gap(10_095_000_000) == (100_000_000, 10_000_000)
    assert log.worst_gap(11_000_000_000) is None


def test_a_start_in_its_time_is_told_until_it_has_left() -> None:
    """It is no silence: rate and gaps go on."""
    log = logged([5 * S, 5 * S + 10 * MS])
    log.begin_anew()
    assert log.is_anew and log.view(5 * S + 10 * MS).rate_hz == 100.0
    log.note(5 * S + 20 * MS)
    assert not log.is_anew and log.view(5 * S + 20 * MS).rate_hz == 100.0
