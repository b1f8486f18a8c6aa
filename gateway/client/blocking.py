"""Runs procedures in the calling thread: the one place where the blocking client waits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from gateway.client.asking.procedures import Procedure
from gateway.client.asking.waits import Wait
from gateway.client.connection.session import Session
from gateway.errors import Code, GatewayError, failure
from gateway.process.threads import supervised

__all__ = ["SLICE_S", "opened", "run"]

T = TypeVar("T")

SLICE_S = 0.1
"""Longest wait between two looks [s]: lost replies are asked for again at this rate."""


def opened(open_it: Callable[[], T]) -> T:
    """Open a session of zenoh in a thread of its own: zenoh does not come back for Ctrl-C, which this one hears.

    Raises:
        GatewayError: As `open_it` does; INTERNAL, it ended otherwise.
    """
    found, failed = list[T](), list[GatewayError]()

    def work() -> None:
        try:
            found.append(open_it())
        except GatewayError as error:
            failed.append(error)

    thread = supervised(work, "ta2-open", on_lost=lambda lost: failed.append(failure(Code.INTERNAL, str(lost))))
    thread.start()
    thread.join()
    if failed:
        raise failed[0]
    return found[0]


def run(session: Session, procedure: Procedure[T]) -> T:
    """Run a procedure to its end, waiting in this thread.

    Ctrl-C leaves the robot held before it goes on its way.
    """
    try:
        wait = next(procedure)
        while True:
            try:
                answer = _wait(session, wait)
            except GatewayError as error:
                wait = procedure.throw(error)
            else:
                wait = procedure.send(answer)
    except StopIteration as end:
        value: T = end.value
        return value
    except KeyboardInterrupt:
        procedure.close()
        session.abandon()
        raise


def _wait(session: Session, wait: Wait[Any]) -> object:
    transport = session.transport
    with session.changed:
        while True:
            now_ns = transport.now_ns()
            answer = wait.poll(now_ns)
            if answer is not None:
                return answer
            if now_ns >= wait.deadline_ns:
                raise wait.expire()
            transport.wait(session.changed, min((wait.deadline_ns - now_ns) / 1e9, SLICE_S))
