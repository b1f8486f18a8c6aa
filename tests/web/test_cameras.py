"""Pictures are for whoever looks, as far as a stop has its way beside them."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import aclosing
from types import SimpleNamespace

import pytest

from gateway.errors import Rejected

pytest.importorskip("av", reason="the extra `video` is missing")
from gateway.video.errors import VideoCode, VideoTimeout
from gateway.web import cameras


class Video:
    """Pictures without end."""

    def __init__(self, source: str, *, port: int) -> None:
        self.source, self.port = source, port

    async def __aenter__(self) -> Video:
        return self

    async def __aexit__(self, *_: object) -> None:
        return None

    async def frames(self, max_rate: float, timeout: float):
        """Yield one after the other."""
        while True:
            await asyncio.sleep(0)
            yield SimpleNamespace()


async def shown_by(pictures: AsyncIterator[bytes]) -> bytes:
    """Return the next picture: the beginning of an answer is none."""
    return await anext(pictures) or await anext(pictures)


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
            assert b"picture" in await shown_by(pictures)
        with pytest.raises(Rejected, match="looked at already"):
            await anext(shown.pictures("ceiling"))
        await looking.pop().aclose()
        async with aclosing(shown.pictures("ceiling")) as pictures:
            assert b"picture" in await shown_by(pictures)
        for pictures in looking:
            await pictures.aclose()
        assert not shown.seen().is_receiving

    asyncio.run(story())


def test_an_answer_outlives_pictures_that_do_not_come(monkeypatch: pytest.MonkeyPatch) -> None:
    """A browser shows the last one for ever, and asks for no other: a robot that starts anew must be seen by itself."""

    async def silent_for_a_minute(self: Video, max_rate: float, timeout: float):
        yield SimpleNamespace()
        if timeout < 60.0:
            raise VideoTimeout(VideoCode.NO_PACKETS, "no picture came", "")
        yield SimpleNamespace()

    monkeypatch.setattr(Video, "frames", silent_for_a_minute)

    async def story() -> None:
        async with aclosing(cameras.Cameras(lambda: "127.0.0.1", 0).pictures("ceiling")) as pictures:
            assert b"picture" in await shown_by(pictures)
            assert b"picture" in await anext(pictures)

    asyncio.run(story())


def test_whoever_goes_before_the_first_picture_leaves_his_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """The answer begins before: a server hears of a page that is gone only while it answers."""

    async def none(self: Video, max_rate: float, timeout: float):
        await asyncio.Event().wait()
        yield SimpleNamespace()

    monkeypatch.setattr(Video, "frames", none)

    async def story() -> None:
        shown = cameras.Cameras(lambda: "127.0.0.1", 0)
        pictures = shown.pictures("ceiling")
        assert await asyncio.wait_for(anext(pictures), 20.0) == b""
        waiting = asyncio.ensure_future(anext(pictures))
        await asyncio.sleep(0)
        waiting.cancel()  # as a server does
        await asyncio.wait({waiting})
        assert not shown.seen().is_receiving and shown._looking == 0

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
