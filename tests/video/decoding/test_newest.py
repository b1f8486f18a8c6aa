"""Tests of the newest frame: one reference for many readers, who miss what was replaced and never see it twice."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from gateway.video.decoding.frame import Frame
from gateway.video.decoding.newest import Newest, Pace
from gateway.video.errors import VideoCode, VideoError
from tests.video.shown import Shown

S = 1_000_000_000


def frame(seq):
    """Return a frame with a number."""
    return Frame(Shown(np.zeros((34, 16, 3), np.uint8)), seq, rtp_time=0, received_ns=0, published_ns=0, clean=True)


def test_a_reader_is_given_what_is_newer_than_what_it_had():
    """The newest one, once; nothing before the first."""
    newest = Newest()
    assert newest.frame is None and newest.wait(-1, 0.0) is None
    for seq in range(3):
        newest.publish(frame(seq))
    assert newest.wait(-1, 0.0).seq == 2 and newest.wait(1, 0.0).seq == 2
    assert newest.wait(2, 0.0) is None and newest.frame.seq == 2


def test_all_readers_are_woken_by_one_frame():
    """Without polling: each waits until the frame is there."""
    newest, seen, ready = Newest(), [], threading.Barrier(5)

    def read():
        ready.wait()
        seen.append(newest.wait(-1, 30.0))

    threads = [threading.Thread(target=read) for _ in range(4)]
    for thread in threads:
        thread.start()
    ready.wait()
    published = frame(0)
    newest.publish(published)
    for thread in threads:
        thread.join(30.0)
    assert seen == [published] * 4


def test_the_end_wakes_whoever_waits():
    """No reader waits for its whole timeout after a stop; a frame that it has not had is still given."""
    newest, seen = Newest(), []
    thread = threading.Thread(target=lambda: seen.append(newest.wait(0, 1e12)))
    newest.publish(frame(0))
    thread.start()
    newest.close()
    thread.join(30.0)
    assert seen == [None] and not newest.is_open
    assert newest.wait(-1, 0.0).seq == 0 and newest.pause(60.0) is False
    newest.open()
    assert newest.is_open


def test_an_error_surfaces_at_every_reader():
    """With its cause; until it is opened again."""
    newest, cause = Newest(), ZeroDivisionError("in the other thread")
    newest.publish(frame(0))
    newest.close(cause)
    for _ in range(2):
        with pytest.raises(VideoError, match="in the other thread") as caught:
            newest.wait(-1, 0.0)
        assert caught.value.code is VideoCode.DECODER_FAILED and caught.value.__cause__ is cause
    newest.open()
    assert newest.wait(-1, 0.0).seq == 0


def test_an_error_of_the_receiver_keeps_its_code():
    """Whoever reads it shall know which thread failed."""
    newest = Newest()
    newest.close(VideoError(VideoCode.RECEIVER_FAILED, "no socket", "start again"))
    with pytest.raises(VideoError, match="RECEIVER_FAILED: no socket -> start again"):
        newest.peek(-1)


def test_a_listener_is_told_of_each_change_while_its_block_lasts():
    """By the thread that publishes."""
    newest, told = Newest(), []
    with newest.listening(lambda: told.append(newest.frame)):
        newest.publish(frame(0))
        newest.close()
    newest.publish(frame(1))
    assert [None if each is None else each.seq for each in told] == [0, 0]


def test_a_pace_takes_no_more_than_its_rate():
    """On a grid; who was late is not given a burst to make up for it."""
    pace, now_ns, taken = Pace(10.0), 0, []
    while now_ns < 2 * S:
        if pace.rest_s(now_ns) == 0.0:
            pace.taken(now_ns)
            taken.append(now_ns)
        now_ns += 22_222_222
    assert 19 <= len(taken) <= 21
    pace.taken(10 * S)
    pace.taken(10 * S)
    assert pace.rest_s(10 * S) == pytest.approx(0.1)


def test_without_a_rate_nothing_is_waited_for():
    """Frames come as they come."""
    pace = Pace(None)
    for now_ns in (5, 6, 7):
        assert pace.rest_s(now_ns) == 0.0
        pace.taken(now_ns)


@pytest.mark.parametrize("rate", [0, -1.0, float("nan"), float("inf")])
def test_a_rate_that_is_none_is_refused(rate):
    """With the value and what is needed."""
    with pytest.raises(ValueError, match="positive"):
        Pace(rate)


def test_a_pause_ends_in_time():
    """It says whether frames may still come."""
    newest = Newest()
    began = time.monotonic()
    assert newest.pause(0.01) and time.monotonic() - began >= 0.01
