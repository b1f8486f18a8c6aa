"""What all pages look through: one connection to the gateway, its newest state as JSON, its notices, and what was counted.

Rules
    * However many look, the gateway has one client more, and each state is encoded once.
    * The newest state counts: who reads slowly skips states. Of notices the latest are kept, and a gap shows in their numbers.
    * A gateway that is away is said so to all, and looked for again.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import Counter, deque

import msgspec

from gateway.api.protocol import Info, Notice, Snapshot
from gateway.api.recorder_protocol import RecordingState
from gateway.client import aio
from gateway.errors import GatewayError
from gateway.web.body import Body

__all__ = ["Viewer"]

_log = logging.getLogger(__name__)

RATE_HZ = 10.0
RETRY_S = 0.5
RECORDER_S = 1.0
CONNECT_S = 2.0
SILENT_S = 1.0
"""Without a new state for so long the gateway counts as away [s]."""
KEPT_NOTICES = 200


class Viewer:
    """Looks at a gateway for as long as `run` runs.

    Args:
        target: Where the gateway is; None finds its socket.
    """

    def __init__(self, target: str | None) -> None:
        self._target = target
        self._news = asyncio.Event()
        self.body: Body | None = None
        """Tells where the body is; None for nobody."""
        self.recording: RecordingState | None = None
        """How the recording is that goes on; None while nobody records."""
        self.robot: aio.Robot | None = None
        """The connection, also while the gateway is away; None before it was there once."""
        self.info: Info | None = None
        self.view: Snapshot | None = None
        """The newest state; None while the gateway is away."""
        self.state: bytes = msgspec.json.encode({"type": "gone"})
        """The same as the message that pages get."""
        self.number = 0
        """Rises with each state."""
        self.notices: deque[tuple[int, bytes]] = deque(maxlen=KEPT_NOTICES)
        """The latest notices as messages for pages, each with its number, from 1 on."""
        self.counted: Counter[tuple[str, str]] = Counter()
        """How many notices came, by code and level."""

    async def news(self) -> None:
        """Wait until there is something new."""
        await self._news.wait()

    def _tell(self) -> None:
        told, self._news = self._news, asyncio.Event()
        told.set()

    async def run(self) -> None:
        """Look until it is cancelled."""
        while True:
            try:
                async with aio.connect(self._target, name="ta2 web", timeout_s=CONNECT_S) as robot:
                    self.robot = robot
                    parts = [
                        asyncio.create_task(part) for part in (self._see(robot), self._hear(robot), self._ask(robot))
                    ]
                    try:
                        await asyncio.gather(*parts)
                    finally:
                        for part in parts:
                            part.cancel()
            except GatewayError:  # looked for again
                pass
            except Exception:  # noqa: BLE001  whatever it was: an old state must not stand there as the newest
                _log.exception("looking at the gateway failed; it is looked for again")
            self._show(None)
            await asyncio.sleep(RETRY_S)

    async def _see(self, robot: aio.Robot) -> None:
        while True:
            try:
                self.info = await robot.info()
                async for state in robot.states(max_rate=RATE_HZ, timeout=SILENT_S):
                    if state.age < SILENT_S:  # the first is what was heard last, from whoever may be dead since
                        self._show(state.view)
            except GatewayError:  # away, silent, or another one meanwhile
                self._show(None)
            await asyncio.sleep(RETRY_S)  # also where there is nothing to wait for: nobody else would get a turn

    def _show(self, view: Snapshot | None) -> None:
        if view is None and self.view is None:
            return
        self.view = view
        self.number += 1
        message: dict[str, object] = {"type": "gone"}
        if view is not None:
            body = None if self.body is None else self.body.seen(view)
            message = {"type": "state", "info": self.info, "state": view, "body": body, "recording": self.recording}
        self.state = msgspec.json.encode(message)
        self._tell()

    async def _ask(self, robot: aio.Robot) -> None:
        while True:
            try:
                self.recording = await robot.recording.state()
            except GatewayError:  # nobody records, or the recorder does not answer
                self.recording = None
            await asyncio.sleep(RECORDER_S)

    async def _hear(self, robot: aio.Robot) -> None:
        while True:
            with contextlib.suppress(GatewayError):
                async for notice in robot.events(timeout=None):
                    self._note(notice)
            await asyncio.sleep(RETRY_S)

    def _note(self, notice: Notice) -> None:
        self.counted[notice.code, notice.level] += 1
        number = self.notices[-1][0] + 1 if self.notices else 1
        self.notices.append((number, msgspec.json.encode({"type": "notice", "number": number, "notice": notice})))
        self._tell()
