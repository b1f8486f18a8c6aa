"""Tests of writes that nothing interrupts."""

from __future__ import annotations

import signal
import threading

import pytest

from gateway.cli.recording.undisturbed import undisturbed


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_what_ends_a_command_waits_for_the_end_of_a_write(number):
    """It comes then, once, and the handlers are those of before."""
    came = []
    before = signal.signal(number, lambda *_: came.append(number))
    try:
        own, done = signal.getsignal(number), []
        with undisturbed():
            signal.raise_signal(number)
            signal.raise_signal(number)
            done.append(list(came))
        assert done == [[]] and came == [number] and signal.getsignal(number) is own
    finally:
        signal.signal(number, before)


def test_an_error_of_a_write_is_raised_and_the_handlers_are_those_of_before():
    """As without it."""
    own = signal.getsignal(signal.SIGINT)
    with pytest.raises(OSError, match="full"), undisturbed():
        raise OSError("full")
    assert signal.getsignal(signal.SIGINT) is own


def test_in_another_thread_it_is_nothing():
    """Signals are the first thread's."""
    ran = []

    def block():
        with undisturbed():
            ran.append(True)

    thread = threading.Thread(target=block)
    thread.start()
    thread.join()
    assert ran == [True]
