"""A page's robot: whatever is asked for at once, and whenever the page goes, no robot is left with an owner that nobody is."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager
from types import SimpleNamespace

import pytest

from gateway.api.recorder_protocol import RecordingState
from gateway.errors import Code, LeaseError, Refusal, to_exception
from gateway.web import owning
from gateway.web.messages import Acquire, Episode, Hold, Release
from gateway.web.owning import Owning


class World:
    """Clients of a gateway: one of them owns the robot, and everything takes a while."""

    def __init__(self) -> None:
        self.owner, self.made = "", 0
        self.may_leave = asyncio.Event()
        self.may_leave.set()

    async def success(self, text: str) -> RecordingState:
        self.told = text
        return RecordingState(bag="/bag", episode=3)

    @asynccontextmanager
    async def connect(self, target: str | None, *, name: str):
        self.made += 1
        me = f"client {self.made}"

        async def state() -> object:
            return SimpleNamespace(lease=SimpleNamespace(client_id=self.owner))

        @asynccontextmanager
        async def control(take: str | None):
            await asyncio.sleep(0)
            if self.owner and take is None:
                raise to_exception(Refusal(code=Code.LEASE_HELD, message=self.owner))
            self.owner, own = me, SimpleNamespace(is_open=True, epoch=self.made)
            try:
                yield own
            finally:
                own.is_open = False
                self.owner = "" if self.owner == me else self.owner

        try:
            recording = SimpleNamespace(success=self.success)
            yield SimpleNamespace(client_id=me, state=state, control=control, recording=recording)
        finally:
            await self.may_leave.wait()


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    """A gateway."""
    made = World()
    monkeypatch.setattr(owning.aio, "connect", made.connect)
    return made


async def turns(count: int = 20) -> None:
    """Let everything go on for a while."""
    for _ in range(count):
        await asyncio.sleep(0)


def test_a_page_that_goes_while_it_asks_again_owns_nothing_afterwards(world: World) -> None:
    """A wait for the end of the first try, cancelled, begins no second one."""

    async def story() -> None:
        page = Owning(None, "page")
        assert await page.carry_out(Acquire(id=1)) == {"owner": True, "epoch": 1}
        world.owner = "somebody else"
        world.may_leave.clear()
        again = asyncio.create_task(page.carry_out(Acquire(id=2, take="mine")))
        await turns()
        again.cancel()
        await turns()
        world.may_leave.set()
        await page.lose()
        await asyncio.wait({again})
        await turns()
        assert again.cancelled() and world.owner == "somebody else" and not page.is_owner

    asyncio.run(story())


def test_what_a_page_gives_back_is_not_what_it_takes_meanwhile(world: World) -> None:
    """The end of the first ownership leaves the second one alone: else nobody would watch over that."""

    async def story() -> None:
        page = Owning(None, "page")
        await page.carry_out(Acquire(id=1))
        world.may_leave.clear()
        back = asyncio.create_task(page.carry_out(Release(id=2)))
        await turns()
        again = asyncio.create_task(page.carry_out(Acquire(id=3)))
        await turns()
        world.may_leave.set()
        await asyncio.gather(back, again)
        await turns()
        assert page.is_owner and world.owner == "client 2"
        await page.lose()
        assert not world.owner

    asyncio.run(story())


def test_a_page_from_which_the_robot_was_taken_is_not_told_that_it_owns_it(world: World) -> None:
    """It is asked anew, and refused like anybody; with a reason it gets it."""

    async def story() -> None:
        page = Owning(None, "page")
        await page.carry_out(Acquire(id=1))
        assert await page.carry_out(Acquire(id=2)) == {"owner": True, "epoch": 1} and world.made == 1
        world.owner = "somebody else"
        with pytest.raises(LeaseError, match="somebody else"):
            await page.carry_out(Acquire(id=3))
        with pytest.raises(LeaseError):
            await page.carry_out(Hold(id=4))
        assert await page.carry_out(Acquire(id=5, take="mine")) == {"owner": True, "epoch": 3}
        await page.lose()
        assert not world.owner

    asyncio.run(story())


def test_episodes_are_the_owner_s_to_judge(world: World) -> None:
    """The recorder is told, and its answer is the reply's."""

    async def story() -> None:
        page = Owning(None, "page")
        verdict = Episode(id=1, event="success", text="well done")
        with pytest.raises(LeaseError):
            await page.carry_out(verdict)
        await page.carry_out(Acquire(id=2))
        assert (await page.carry_out(verdict))["episode"] == 3 and world.told == "well done"
        await page.lose()

    asyncio.run(story())
