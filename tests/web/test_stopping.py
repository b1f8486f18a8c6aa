"""A stop from the web is a stop, whatever came with it."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import AsyncMock

import pytest

from gateway.api.keys import ESTOP_KEY, STOP_KEY
from gateway.api.stop_pipe import stop_pipe
from gateway.client import StopResult
from gateway.errors import Code, Disconnected, failure
from gateway.web import stopping
from gateway.web.stopping import reason_of, stop


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (b'{"reason": "smoke"}', "smoke"),
        (b"", ""),
        (b"\xff\xfe", ""),
        (b"[1, 2", ""),
        (b'{"reason": 7}', ""),
        (b'{"reason": "\\ud800"}', ""),
        (b'{"reason": "x", "more": 1}', "x"),
        (b'{"x":' + b"[" * 4000, ""),
        (b'{"reason": "' + b"y" * 900 + b'"}', "y" * 200),
    ],
)
def test_of_a_stop_as_much_is_read_as_can_be(body: bytes, reason: str) -> None:
    """Nothing that comes with a stop refuses it."""
    assert reason_of(body) == reason


@pytest.mark.parametrize(("word", "key"), [("stop", STOP_KEY), ("estop", ESTOP_KEY)])
def test_it_lies_in_the_pipe_before_anybody_is_asked(tmp_path: Path, word, key: str) -> None:
    """Without any connection: by then the control loop, or the guard of a frozen gateway, has it."""
    socket = tmp_path / "gw.sock"
    os.mkfifo(stop_pipe(socket, key))
    reader = os.open(stop_pipe(socket, key), os.O_RDONLY | os.O_NONBLOCK)
    try:
        done = asyncio.run(stop(word, "smoke", str(socket), None))
        assert done.dropped and not done.undelivered
        assert not done.confirmed  # it lies there: nobody has said that the robot stops
        assert b"smoke" in os.read(reader, 4096)
    finally:
        os.close(reader)


def test_where_no_socket_can_be_found_whoever_is_connected_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """And where nobody is, the remedy is told, not what is wrong with a variable."""
    monkeypatch.setenv("TA2_SOCKET", "no-path.sock")
    with pytest.raises(Disconnected, match="physical emergency stop"):
        asyncio.run(stop("stop", "", None, None))
    robot = SimpleNamespace(stop=AsyncMock(return_value=StopResult(by_guard=False, undelivered=False)))
    assert asyncio.run(stop("stop", "", None, robot)).confirmed  # type: ignore[arg-type]  # as much of one as is used


def test_where_nobody_is_it_says_so(tmp_path: Path) -> None:
    """With the only remedy that counts."""
    with pytest.raises(Disconnected, match="physical emergency stop"):
        asyncio.run(stop("stop", "", str(tmp_path / "gw.sock"), None))


def test_what_lies_in_the_pipe_waits_a_moment_for_whoever_confirms_it(tmp_path: Path, monkeypatch) -> None:
    """A browser has few connections: an E-STOP would wait behind STOPs. Whoever is asked still is, and may answer anything."""
    monkeypatch.setattr(stopping, "CONFIRM_S", 0.01)
    path = tmp_path / "gw.sock"
    os.mkfifo(stop_pipe(path, STOP_KEY))
    reader = os.open(stop_pipe(path, STOP_KEY), os.O_RDONLY | os.O_NONBLOCK)

    async def story() -> None:
        answers, ended = asyncio.Event(), asyncio.Event()

        async def hang(_: str) -> StopResult:
            await answers.wait()
            ended.set()
            raise failure(Code.DISCONNECTED, "the gateway is away", hint="")

        done = await stop("stop", "", str(path), SimpleNamespace(stop=hang))  # type: ignore[arg-type]  # as much of one as is used
        assert done.dropped and not done.confirmed and not ended.is_set()
        answers.set()
        await ended.wait()

    try:
        asyncio.run(asyncio.wait_for(story(), 20.0))
    finally:
        os.close(reader)
