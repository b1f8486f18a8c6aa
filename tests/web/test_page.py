"""A page that does not do its part: it reads nothing, or asks without end. Nobody else pays for it."""

from __future__ import annotations

import asyncio
import gc
import logging

import pytest
from starlette.websockets import WebSocketDisconnect

from gateway.web import server
from gateway.web.owning import Owning
from gateway.web.viewer import Viewer


class Stalled:
    """A socket to which nothing can be sent; it asks for something as often as it is listened to, or never."""

    def __init__(self, *, asks: bool) -> None:
        self._asks = asks
        self.heard = 0

    async def send_text(self, text: str = "") -> None:
        """Never return, as where the peer's window is full."""
        await asyncio.Event().wait()

    close = send_text

    async def receive(self) -> dict[str, str]:
        """Return nonsense, or nothing."""
        if not self._asks:
            await asyncio.Event().wait()
        await asyncio.sleep(0)
        self.heard += 1
        return {"type": "websocket.receive", "text": "nonsense"}


def page_of(socket: Stalled) -> server._Page:
    """Return a page of that socket."""
    return server._Page(socket, Viewer(None), Owning(None, "page"))  # type: ignore[arg-type]  # as much of one as is used


def test_a_page_that_takes_nothing_makes_room_for_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """There are so many places; one that is not even closed by its peer is given to the next."""
    monkeypatch.setattr(server, "STALLED_S", 0.05)
    monkeypatch.setattr(server, "CLOSE_S", 0.01, raising=False)
    asyncio.run(asyncio.wait_for(page_of(Stalled(asks=False)).run(), 20.0))


def test_a_page_that_asks_and_takes_no_answers_is_not_listened_to() -> None:
    """What it asks for waits where it comes from, not here."""

    async def story() -> None:
        socket = Stalled(asks=True)
        running = asyncio.create_task(page_of(socket).run())
        for _ in range(2000):
            await asyncio.sleep(0)
        assert socket.heard <= 2 * server.MOST_WAITING
        running.cancel()
        await asyncio.wait({running})

    asyncio.run(story())


class Gone(Stalled):
    """A socket whose peer is gone, as each answer to it finds out, or each ends by another error."""

    def __init__(self, error: Exception) -> None:
        super().__init__(asks=True)
        self._error = error

    async def send_text(self, text: str = "") -> None:
        """Raise, as where the peer is gone."""
        raise self._error


@pytest.mark.parametrize("error", [WebSocketDisconnect(1006), RuntimeError("closed"), ValueError("a fault of ours")])
def test_a_page_that_goes_while_its_request_waits_leaves_no_trace_in_the_log(
    caplog: pytest.LogCaptureFixture, error: Exception
) -> None:
    """That pages go is nothing to tell; another error is told, once, by us and not by asyncio."""

    async def story() -> None:
        page = page_of(Gone(error))
        page._take("nonsense")
        while page._waiting:
            await asyncio.sleep(0)
        gc.collect()

    with caplog.at_level(logging.DEBUG):
        asyncio.run(story())
        gc.collect()
    told = [(record.name, record.getMessage()) for record in caplog.records if record.levelno >= logging.WARNING]
    assert told == ([(server.__name__, "a page ended by an error")] if isinstance(error, ValueError) else [])
