"""`Video` for asyncio: the same threads behind it, and nothing that blocks the event loop."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Callable
from typing import Any

from gateway.video.decoding.frame import Frame
from gateway.video.decoding.newest import Pace
from gateway.video.receiving.diagnosis import Finding
from gateway.video.receiving.health import Health
from gateway.video.video import Video

__all__ = ["AsyncVideo"]


class AsyncVideo:
    """Receives while its block lasts.

    ```
    async with AsyncVideo(source="192.168.1.100") as video:
        async for frame in video.frames(max_rate=10): ...
    ```

    Args:
        source: See `Video`.
        settings: See `Video`.
    """

    def __init__(self, source: str | None, **settings: Any) -> None:  # noqa: ANN401  those of Video, which checks them
        self.video = Video(source, **settings)
        self._listening = contextlib.ExitStack()
        self._waiting: set[asyncio.Future[None]] = set()

    async def __aenter__(self) -> AsyncVideo:
        """Start it."""
        loop = asyncio.get_running_loop()

        def wake() -> None:
            with contextlib.suppress(RuntimeError):  # the loop has been closed meanwhile
                loop.call_soon_threadsafe(self._wake)

        self._listening.enter_context(self.video.newest.listening(wake))
        try:
            await _whole(self.video.start)
        except BaseException:
            await self.__aexit__()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        """Stop it; whoever waits for frames is told."""
        try:
            await _whole(self.video.stop)
        finally:
            self._listening.close()

    @property
    def latest(self) -> Frame | None:
        """The newest frame, however old it is; None before the first. Its RGB is made where it is first looked at."""
        return self.video.latest

    @property
    def health(self) -> Health:
        """Return rates, latencies and counters of now."""
        return self.video.health

    def why(self) -> tuple[Finding, ...]:
        """Return what is wrong now, in words, the worst first; empty when nothing is."""
        return self.video.why()

    async def wait_frame(self, after_seq: int = -1, timeout: float = 5.0) -> Frame | None:
        """Return the newest frame that is newer than another one, its RGB made in another thread. As `Video.wait_frame`."""
        deadline = time.monotonic() + timeout
        newest = self.video.newest
        while (frame := newest.peek(after_seq)) is None and newest.is_open:
            if not await self._change(deadline - time.monotonic()):
                frame = newest.peek(after_seq)
                break
        if frame is not None:
            await asyncio.to_thread(frame.source.array)
        return frame

    async def frames(self, max_rate: float | None = None, timeout: float = 5.0) -> AsyncIterator[Frame]:
        """Yield each new frame, the newest when several came meanwhile. As `Video.frames`."""
        pace, seq = Pace(max_rate), -1
        while True:
            if rest_s := pace.rest_s(time.monotonic_ns()):
                await asyncio.sleep(rest_s)
            frame = await self.wait_frame(seq, timeout)
            if frame is None:
                if not self.video.newest.is_open:
                    return
                raise self.video.silence(timeout)
            pace.taken(time.monotonic_ns())
            seq = frame.seq
            yield frame

    async def _change(self, timeout_s: float) -> bool:
        """Wait for the next change; return whether it came in time.

        None is missed: it wakes through the event loop, which runs nothing between a look at the frame and this.
        """
        change = asyncio.get_running_loop().create_future()
        self._waiting.add(change)
        try:
            await asyncio.wait_for(change, max(0.0, timeout_s))
        except asyncio.TimeoutError:
            return False
        finally:
            self._waiting.discard(change)
        return True

    def _wake(self) -> None:
        for change in self._waiting:
            if not change.done():
                change.set_result(None)


async def _whole(work: Callable[[], None]) -> None:
    """Do it in another thread; a cancellation waits for its end: the thread goes on, and the port must be given back."""
    doing = asyncio.get_running_loop().run_in_executor(None, work)
    try:
        await asyncio.shield(doing)
    except asyncio.CancelledError:
        while not doing.done():
            with contextlib.suppress(asyncio.CancelledError):
                await asyncio.wait([doing])
        raise
