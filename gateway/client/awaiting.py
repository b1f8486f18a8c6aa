"""Runs procedures in an event loop: the one place where the asyncio client waits. The twin of `blocking`."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any, TypeVar

from gateway.client.asking.procedures import Procedure
from gateway.client.asking.waits import Wait
from gateway.client.blocking import SLICE_S
from gateway.client.connection.session import Session
from gateway.errors import GatewayError

__all__ = ["run"]

T = TypeVar("T")


async def run(session: Session, procedure: Procedure[T]) -> T:
    """Run a procedure to its end, waiting in this event loop."""
    try:
        wait = next(procedure)
        while True:
            try:
                answer = await _wait(session, wait)
            except GatewayError as error:
                wait = procedure.throw(error)
            else:
                wait = procedure.send(answer)
    except StopIteration as end:
        value: T = end.value
        return value
    except asyncio.CancelledError:
        procedure.close()
        raise


async def _wait(session: Session, wait: Wait[Any]) -> object:
    loop = asyncio.get_running_loop()
    changed = asyncio.Event()

    def wake() -> None:
        with contextlib.suppress(RuntimeError):  # the event loop was closed meanwhile
            loop.call_soon_threadsafe(changed.set)

    with session.listening(wake):
        while True:
            changed.clear()
            now_ns = session.transport.now_ns()
            with session.changed:
                answer = wait.poll(now_ns)
            if answer is not None:
                return answer
            if now_ns >= wait.deadline_ns:
                raise wait.expire()
            # Not asyncio.wait_for: before Python 3.12 it can swallow a cancellation that comes together with the event.
            alarm = loop.call_later(min((wait.deadline_ns - now_ns) / 1e9, SLICE_S), changed.set)
            try:
                await changed.wait()
            finally:
                alarm.cancel()
