"""Pictures are for whoever looks, as far as a stop has its way beside them."""

from __future__ import annotations

import asyncio
import threading
from contextlib import aclosing
from types import SimpleNamespace

import pytest

from gateway.errors import Rejected

pytest.importorskip("av", reason="the extra `video` is missing")
from gateway.web import cameras


class Video:
    """Pictures without end."""

    def __init__(self, source: str, *, port: int) -> None:
        self.source, self.port = source, port

    async def __aenter__(self) -> Video:
        return self

    async def __aexit__(self, *_: object) -> None:
        return None

    async def frames(self, max_rate: float):
        """Yield one after the other."""
        while True:
            await asyncio.sleep(0)
            yield SimpleNamespace()


@pytest.fixture(autouse=True)
def _without_a_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cameras, "AsyncVideo", Video)
    monkeypatch.setattr(cameras, "_jpeg", lambda frame, view: b"picture")


def test_so_many_look_that_a_browser_has_a_connection_left_for_a_stop() -> None:
    """The next one is refused, and gets a place when somebody looks no more."""

    async def story() -> None:
        shown = cameras.Cameras(lambda: "127.0.0.1", 0)
        looking = [shown.pictures("ceiling") for _ in range(cameras.MOST_LOOKING)]
        for pictures in looking:
            assert b"picture" in await anext(pictures)
        with pytest.raises(Rejected, match="looked at already"):
            await anext(shown.pictures("ceiling"))
        await looking.pop().aclose()
        async with aclosing(shown.pictures("ceiling")) as pictures:
            assert b"picture" in await anext(pictures)
        for pictures in looking:
            await pictures.aclose()
        assert not shown.seen().is_receiving

    asyncio.run(story())


def test_a_name_that_is_looked_up_holds_up_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """A name server that is silent takes many seconds, and a stop comes through the same event loop."""
    threads = []
    monkeypatch.setattr(cameras, "robot_address", lambda *_: threads.append(threading.current_thread()) or "127.0.0.1")

    async def story() -> None:
        async with aclosing(cameras.Cameras(lambda: "robot", 0).pictures("ceiling")) as pictures:
            await anext(pictures)

    asyncio.run(story())
    assert threads and threads[0] is not threading.main_thread()
