"""What pages look through goes on, whatever happens to it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from types import SimpleNamespace

import pytest

from gateway.api.recorder_protocol import RecordingState
from gateway.errors import Code, failure
from gateway.web import viewer
from gateway.web.viewer import Viewer


class Broken:
    """A gateway that says something nobody expects, once, and nothing later."""

    tries = asked = recorded = 0
    is_closed = False

    @asynccontextmanager
    async def connect(self, *_: object, **__: object) -> AsyncIterator[Broken]:
        """Connect."""
        self.tries, self.is_closed = self.tries + 1, False
        try:
            yield self
        finally:
            self.is_closed = True
            for _ in range(10):
                await asyncio.sleep(0)

    async def info(self) -> None:
        """Fail at first."""
        if self.tries == 1:
            raise ValueError("nobody expects this")
        await asyncio.Event().wait()

    @property
    def recording(self) -> Broken:
        """Its recorder."""
        return self

    async def state(self) -> RecordingState:
        """Refuse at first."""
        self.recorded += 1
        if self.recorded == 2:
            return RecordingState(bag="/bag", episode=1, is_running=True)
        raise failure(Code.NO_RECORDER, "nobody records")

    async def events(self, timeout: float | None) -> AsyncIterator[None]:
        """Tell nothing; what is closed ends at once."""
        self.asked += 1
        assert self.asked < 10, "nobody else gets a turn"
        while not self.is_closed:
            await asyncio.sleep(0)
        for nothing in ():
            yield nothing


def test_a_connection_that_is_closed_is_not_asked_without_end() -> None:
    """What never waits would keep everybody else's stop out of the event loop."""

    async def story() -> None:
        gateway = Broken()
        gateway.is_closed = True
        hearing = asyncio.create_task(Viewer(None)._hear(gateway))  # type: ignore[arg-type]  # as much of one as is used
        await asyncio.sleep(0)
        assert not hearing.done()
        hearing.cancel()
        await asyncio.wait({hearing})

    asyncio.run(story())


def test_an_error_that_nobody_expects_leaves_no_old_state(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """It is told, pages hear that the gateway is away, and it is looked for again."""
    gateway = Broken()
    monkeypatch.setattr(viewer.aio, "connect", gateway.connect)
    monkeypatch.setattr(viewer, "RETRY_S", 0.0)

    async def story() -> None:
        seen = Viewer(None)
        seen.view, seen.state = object(), b"old"  # type: ignore[assignment]  # whatever was seen last
        running = asyncio.create_task(seen.run())
        for _ in range(100):
            await asyncio.sleep(0)
        assert gateway.tries == 2 and not running.done()
        assert seen.view is None and b"gone" in seen.state
        running.cancel()
        await asyncio.wait({running})

    asyncio.run(story())
    assert "nobody expects this" in caplog.text


class Dead:
    """A gateway of which is known what was heard last, and no more."""

    age = 10.0

    async def info(self) -> str:
        """Return what was kept."""
        return "info"

    async def states(self, **_: object) -> AsyncIterator[object]:
        """Begin with the last one, as long ago as it was."""
        yield SimpleNamespace(age=self.age, view=object())
        raise failure(Code.DISCONNECTED, "no state came")


@pytest.mark.parametrize(("age", "is_shown"), [(0.1, True), (10.0, False)])
def test_what_was_heard_of_a_dead_gateway_is_not_shown_again(age: float, is_shown: bool) -> None:
    """A page that shows it for a moment, over and over, shows a robot that stands still."""

    async def story() -> None:
        seen, shown = Viewer(None), []
        seen._show = lambda view: shown.append(view is not None)  # type: ignore[method-assign]  # what pages would get
        gateway = Dead()
        gateway.age = age
        seeing = asyncio.create_task(seen._see(gateway))  # type: ignore[arg-type]  # as much of one as is used
        for _ in range(20):
            await asyncio.sleep(0)
        assert (True in shown) is is_shown and shown[-1] is False
        seeing.cancel()
        await asyncio.wait({seeing})

    asyncio.run(story())


def test_the_recorder_is_followed_and_is_nobody_s_matter_where_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """It comes and goes while the page is open."""
    monkeypatch.setattr(viewer, "RECORDER_S", 0.0)

    async def story() -> None:
        seen, told = Viewer(None), []
        asking = asyncio.create_task(seen._ask(Broken()))  # type: ignore[arg-type]  # as much of one as is used
        for _ in range(20):
            await asyncio.sleep(0)
            told.append(seen.recording)
        assert told[0] is None and any(one is not None and one.is_running for one in told) and told[-1] is None
        asking.cancel()
        await asyncio.wait({asking})

    asyncio.run(story())
