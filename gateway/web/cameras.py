"""The cameras for a page: one receiver and one decoder for all who look, each view as JPEG pictures (motion JPEG).

Rules
    * Nothing is received while nobody looks: the pictures' port is free for `ta2 record --video` and programs.
    * The newest picture counts: who reads slowly skips some, and holds nobody up.
    * A browser opens six connections to a server, and a stop needs one: no more than four are for pictures.
    * An answer outlives pictures that do not come, the first ones, too: a robot that starts anew is shown without a word of
      the page. Why none come stands on `/api/video`, and how old the newest one is.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
import math
from collections.abc import AsyncIterator, Callable
from typing import TYPE_CHECKING

from gateway.errors import Code, failure
from gateway.video import COMPOSITE, VIEWS, AsyncVideo, VideoError
from gateway.video.receiving.source import robot_address
from gateway.web.messages import BOUNDARY, CamerasSeen

if TYPE_CHECKING:
    from gateway.video import Frame

__all__ = ["Cameras"]

RATE_HZ = 12.0
WIDTH = 640
QUALITY = 70
MOST_LOOKING = 4
NAMES = (*VIEWS, COMPOSITE)


class Cameras:
    """Receives while anybody looks.

    Args:
        endpoint: Gives the robot's endpoint, for pictures from elsewhere are refused; empty while it is unknown.
        port: UDP port of the pictures (manual §2.6.3).
    """

    def __init__(self, endpoint: Callable[[], str], port: int) -> None:
        self._endpoint = endpoint
        self._port = port
        self._lock = asyncio.Lock()
        self._video: AsyncVideo | None = None
        self._stack = contextlib.AsyncExitStack()
        self._looking = 0

    def seen(self) -> CamerasSeen:
        """Return how they are seen now."""
        if self._video is None:
            return CamerasSeen(views=NAMES, is_receiving=False, age_s=None, rate_hz=0.0, why=())
        latest, health = self._video.latest, self._video.health
        why = tuple(f"{finding.code.value}: {finding.message} -> {finding.hint}" for finding in self._video.why())
        age_s = None if latest is None else latest.age
        return CamerasSeen(views=NAMES, is_receiving=True, age_s=age_s, rate_hz=health.reading.fps, why=why)

    def require(self, view: str) -> None:
        """Refuse what is none of the views.

        Raises:
            Rejected: BAD_REQUEST, with those that there are.
        """
        if view not in NAMES:
            hint = f"one of {', '.join(NAMES)}"
            raise failure(Code.BAD_REQUEST, f"there is no view {view!r}", field="view", hint=hint)

    async def pictures(self, view: str) -> AsyncIterator[bytes]:
        """Yield parts of a multipart answer, a picture each; before them nothing, at once: the answer begins, and may end.

        Args:
            view: One of the views.

        Raises:
            GatewayError: The port is taken, the robot's address cannot be found, or too many look already.
        """
        video = await self._begin()
        try:
            yield b""  # whoever goes before the first picture is missed from here on
            with contextlib.suppress(VideoError):  # one of its threads has failed: why() says so
                async for frame in video.frames(max_rate=RATE_HZ, timeout=math.inf):
                    picture = await asyncio.to_thread(_jpeg, frame, view)
                    yield b"--" + BOUNDARY.encode() + b"\r\nContent-Type: image/jpeg\r\n\r\n" + picture + b"\r\n"
        finally:
            await asyncio.shield(self._end())  # a page that is closed cancels this

    async def _begin(self) -> AsyncVideo:
        async with self._lock:
            if self._looking >= MOST_LOOKING:
                raise failure(Code.BAD_REQUEST, f"{MOST_LOOKING} views are looked at already", hint="hide one")
            if self._video is None:
                try:
                    address = await asyncio.to_thread(robot_address, self._endpoint(), None)  # a name may take seconds
                    self._video = await self._stack.enter_async_context(AsyncVideo(address, port=self._port))
                except VideoError as error:
                    raise failure(Code.BAD_REQUEST, str(error), hint="see `ta2 video check`") from error
            self._looking += 1
            return self._video

    async def _end(self) -> None:
        async with self._lock:
            self._looking -= 1
            if not self._looking:
                self._video = None
                await self._stack.aclose()


def _jpeg(frame: Frame, view: str) -> bytes:
    from PIL import Image

    image = Image.fromarray(frame[view])
    image.thumbnail((WIDTH, WIDTH))
    out = io.BytesIO()
    image.save(out, "JPEG", quality=QUALITY)
    return out.getvalue()
