"""Rules of `gateway.video.receiving.tap`: a taker waits for pictures, the receiver never for a taker; errors are told."""

from __future__ import annotations

import threading
import time

import pytest

from gateway.video.errors import VideoCode, VideoError
from gateway.video.hevc.access_unit import AccessUnit
from gateway.video.receiving.backlog import Keeping
from gateway.video.receiving.counters import Tally
from gateway.video.receiving.tap import CallbackTap, Tap
from tests.video.receiving.test_backlog import unit

DEADLINE_S = 20.0


def keeping() -> Tap:
    """Return a tap that keeps all."""
    return Tap(Keeping(Tally()))


def test_a_taker_is_woken_by_the_picture_it_waits_for() -> None:
    """From another thread."""
    tap, got = keeping(), []
    taker = threading.Thread(target=lambda: got.append(tap.take(DEADLINE_S)))
    taker.start()
    tap.put(unit(3))
    taker.join(DEADLINE_S)
    assert got == [unit(3)]


def test_a_taker_waits_no_longer_than_it_said() -> None:
    """None then; it is not over."""
    tap = keeping()
    begun = time.monotonic()
    assert tap.take(0.02) is None and time.monotonic() - begun >= 0.02
    assert not tap.is_over


def test_what_waits_can_be_taken_after_the_end_and_no_more_comes() -> None:
    """A recorder writes what it was given; nobody waits for what never comes."""
    tap = keeping()
    tap.put(unit(1))
    tap.close()
    tap.put(unit(2))
    assert not tap.is_over
    assert tap.take(DEADLINE_S) == unit(1)
    assert tap.is_over and tap.take(DEADLINE_S) is None


def test_the_end_wakes_who_waits() -> None:
    """At once, not after the time it would have waited."""
    tap, got = keeping(), []
    taker = threading.Thread(target=lambda: got.append(tap.take(DEADLINE_S)))
    taker.start()
    tap.close()
    taker.join(DEADLINE_S / 2)
    assert got == [None]


def test_an_error_of_the_receiver_reaches_whoever_takes() -> None:
    """Behind what had come before, also who only takes while it is not over; silence would look like a stream that stopped."""
    tap = keeping()
    tap.put(unit(1))
    tap.close(OSError("gone"))
    assert tap.take(0) == unit(1) and not tap.is_over
    with pytest.raises(VideoError, match="gone") as caught:
        tap.take(DEADLINE_S)
    assert caught.value.code is VideoCode.RECEIVER_FAILED and isinstance(caught.value.__cause__, OSError)


def test_a_function_is_called_with_every_picture_in_order_and_closing_waits_for_it() -> None:
    """However slow it is."""
    tap, left, got, may_go = keeping(), [], [], threading.Event()

    def write(one: AccessUnit) -> None:
        may_go.wait(DEADLINE_S)
        got.append(one.seq)

    callback = CallbackTap(tap, write, "writer", left.append)
    for n in range(50):
        tap.put(unit(n))  # never waits for the function
    assert got == []
    may_go.set()
    callback.close()
    assert got == list(range(50)) and left and set(map(id, left)) == {id(tap)}


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_error_of_a_function_ends_it_and_is_raised_when_it_is_closed() -> None:
    """And on the thread as well: the traceback is printed."""
    tap, left = keeping(), []

    def write(one: AccessUnit) -> None:
        raise OSError(f"no space for {one.seq}")

    with pytest.raises(VideoError, match=r"writer of the video ended.*no space for 1") as caught:
        with CallbackTap(tap, write, "writer", left.append):
            tap.put(unit(1))
            deadline = time.monotonic() + DEADLINE_S
            while not left and time.monotonic() < deadline:
                time.sleep(0.001)
            tap.put(unit(2))
    assert caught.value.code is VideoCode.TAKER_FAILED and len(left) >= 1


def test_a_function_that_does_not_end_is_told() -> None:
    """Closing does not hang for ever."""
    tap, may_go = keeping(), threading.Event()
    callback = CallbackTap(tap, lambda _: may_go.wait(DEADLINE_S), "writer", lambda _: None)
    tap.put(unit(1))
    with pytest.raises(VideoError, match=r"has not ended after 0\.05 s"):
        callback.close(0.05)
    may_go.set()
