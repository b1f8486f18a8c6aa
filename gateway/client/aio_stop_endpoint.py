"""`async with robot.stop_endpoint() as endpoint`: watching over the robot, in the client for asyncio."""

from __future__ import annotations

from gateway.client.asking.attendance import Attendance
from gateway.client.awaiting import run

__all__ = ["StopEndpoint"]


class StopEndpoint(Attendance):
    """A stop endpoint: while it is registered and not heard, nothing moves. Made by `Robot.stop_endpoint`.

    An `async with` block that ends normally leaves in order. One that is left by an exception, cancellation included, does
    not: the robot is held as soon as its period is over, or this client closes.
    """

    async def register(self) -> StopEndpoint:
        """Promise to be heard; what `async with` does.

        Raises:
            Rejected: OUT_OF_RANGE, the period.
            NotReady: TOO_MANY_ENDPOINTS; the message names them.
        """
        await run(self._session, self._register())
        return self

    async def leave(self) -> None:
        """Take the promise back: what goes on goes on. Does nothing when it was not registered."""
        await run(self._session, self._leave())

    async def __aenter__(self) -> StopEndpoint:
        return await self.register()

    async def __aexit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            await self.leave()
