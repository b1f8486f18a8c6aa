"""The supervisor of threads: each unexpected end is told with its trace, and what is needed goes on."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator

import pytest

from gateway.process.threads import Lost, supervised, take_lost


class Panic(BaseException):
    """As a compiled part's: none of Python's own errors."""


def boom() -> None:
    """Fail as zenoh does."""
    raise Panic("boom")


@pytest.fixture(autouse=True)
def nothing_lost() -> Iterator[None]:
    """Begin and end with nothing lost that was not taken."""
    take_lost()
    yield
    assert take_lost() == []


def run(*args: object, **options: object) -> None:
    """Run a supervised thread to its end."""
    thread = supervised(*args, **options)  # type: ignore[arg-type]  # as each test says
    thread.start()
    thread.join(10.0)
    assert not thread.is_alive()


@pytest.mark.parametrize(
    ("work", "why"),
    [(boom, "Panic: boom"), (lambda: 1 / 0, "ZeroDivisionError: division by zero"), (lambda: exit(3), "SystemExit: 3")],
)
def test_whatever_ends_a_thread_is_told_with_its_trace(
    work: object, why: str, caplog: pytest.LogCaptureFixture
) -> None:
    """Errors, panics, and what a thread of Python's own swallows."""
    run(work, "worker")
    (lost,) = take_lost()
    assert lost.name == "worker" and lost.why.endswith(why) and "Traceback" in lost.trace and lost.at_ns > 0
    assert str(lost) == f"the thread worker ended unasked: {lost.why}"
    (record,) = caplog.records
    assert record.levelno == logging.CRITICAL and lost.trace in record.getMessage()


def test_a_return_that_nobody_asked_for_is_an_unexpected_end_too() -> None:
    """It has no trace."""
    run(lambda: None, "worker", may_return=lambda: False)
    (lost,) = take_lost()
    assert (lost.why, lost.trace) == ("it returned", "")


def test_an_end_that_was_asked_for_is_nobodys_business() -> None:
    """Asked when the work has returned, not before."""
    is_asked = threading.Event()
    run(is_asked.set, "worker", may_return=is_asked.is_set)
    run(lambda: None, "by itself")
    assert take_lost() == []


def test_what_is_needed_to_the_end_is_begun_anew_once() -> None:
    """Each loss is told; a second one is the end."""
    begun: list[str] = []

    def work() -> None:
        begun.append(threading.current_thread().name)
        boom()

    run(work, "worker", again=True)
    assert begun == ["worker", "worker"] and len(take_lost()) == 2


def test_in_a_users_process_whoever_must_know_is_called() -> None:
    """Nobody looks there."""
    told: list[Lost] = []
    run(boom, "worker", on_lost=told.append)
    assert [lost.name for lost in told] == ["worker"]


def test_a_thread_is_a_daemon_and_has_its_name_before_it_starts() -> None:
    """Unless the process must not end without it."""
    thread = supervised(boom, "worker")
    assert (thread.name, thread.daemon, thread.ident) == ("worker", True, None)
    assert not supervised(boom, "link", daemon=False).daemon
