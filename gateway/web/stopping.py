"""A stop from the web: everybody's, first of all else, and past a gateway that hangs.

It is dropped into the gateway's pipe before anything is awaited: its control loop sleeps on it, and the guard of a gateway
that is dead or frozen reads it. Only then is the gateway asked, and its guard, what became of it. Where the stop lies in the
pipe that keeps nobody waiting for long: a browser has few connections for the next one.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Coroutine
from typing import Literal

import msgspec
from starlette.requests import Request

from gateway.api import protocol
from gateway.api.stop_pipe import drop_stop
from gateway.client import StopResult, aio
from gateway.client.asking.guard_stop import stop_at_guard
from gateway.errors import STOP_UNKNOWN, Code, GatewayError, failure
from gateway.web.messages import StopAsked, StopDone

__all__ = ["body_of", "reason_of", "stop"]

KEYS = {"stop": protocol.STOP_KEY, "estop": protocol.ESTOP_KEY}
NAME = "ta2 web"
MOST_REASON = 200
MOST_BODY_BYTES = 4096
CONFIRM_S = 1.0
"""How long a stop that lies in the pipe waits to be confirmed [s]."""

_asking: set[asyncio.Future[StopResult | None]] = set()
"""All that go on, waited for or not: the event loop itself would forget them."""


async def body_of(request: Request) -> bytes:
    """Return the body of a request; nothing of one that is too long."""
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > MOST_BODY_BYTES:
            return b""
    return body


def reason_of(body: bytes) -> str:
    """Return the reason in the body of a request, as far as there is one."""
    try:
        return msgspec.json.decode(body, type=StopAsked).reason[:MOST_REASON]
    except (msgspec.MsgspecError, UnicodeError, RecursionError):  # the last: brackets in brackets
        return ""


async def stop(word: Literal["stop", "estop"], reason: str, target: str | None, robot: aio.Robot | None) -> StopDone:
    """Stop everything.

    Args:
        word: Which stop.
        reason: Shown to the owner and in the log.
        target: Where the gateway is; None finds its socket.
        robot: A connection that is there already; None where there was no gateway yet.

    Raises:
        GatewayError: Nobody knows whether it stopped: use the physical emergency stop.
    """
    path = None
    with contextlib.suppress(protocol.AddressRefused):  # who is connected already is asked all the same
        path = protocol.find_socket() if target is None else protocol.parse_address(target).path
    is_dropped = path is not None and drop_stop(
        path, KEYS[word], protocol.encode({"name": NAME, "reason": reason}, protocol.JSON)
    )
    result: StopResult | None = None
    try:
        if robot is not None:
            result = await _told(robot.stop(reason) if word == "stop" else robot.estop(reason), is_dropped)
        elif path is not None:
            result = await _told(asyncio.to_thread(stop_at_guard, str(path), word, reason, NAME), is_dropped)
    except GatewayError:
        if not is_dropped:
            raise
    if result is None and not is_dropped:
        raise failure(Code.DISCONNECTED, "no gateway and no guard answers", hint=STOP_UNKNOWN)
    return StopDone(
        confirmed=result is not None,
        dropped=is_dropped,
        by_guard=result is not None and result.by_guard,
        undelivered=result is not None and result.undelivered,
    )


async def _told(asking: Coroutine[None, None, StopResult | None], is_dropped: bool) -> StopResult | None:
    """Return what became of a stop, None where that takes too long: it is asked on all the same."""
    task = asyncio.ensure_future(asking)
    _asking.add(task)
    task.add_done_callback(_ended)
    await asyncio.wait({task}, timeout=CONFIRM_S if is_dropped else None)
    return task.result() if task.done() else None


def _ended(task: asyncio.Future[StopResult | None]) -> None:
    _asking.discard(task)
    if not task.cancelled():
        task.exception()  # nobody may wait for it
