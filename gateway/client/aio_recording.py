"""`robot.recording` under asyncio: the twin of `recording`, which documents what each method does."""

from __future__ import annotations

import asyncio

from gateway.api.recorder_protocol import RecorderAsk, RecordingState
from gateway.client.connection.recorder import ask_recorder

__all__ = ["Recording"]


class Recording:
    """The recording of this robot by `ta2 record` on this host. As `client.recording.Recording`."""

    def __init__(self, address: str) -> None:
        self._address = address

    async def _ask(self, ask: RecorderAsk, task: str = "", text: str = "") -> RecordingState:
        return await asyncio.to_thread(ask_recorder, self._address, ask, task, text)

    async def state(self) -> RecordingState:
        """Return how it is: its bag, the newest episode, and whether that goes on."""
        return await self._ask("status")

    async def start(self, task: str = "") -> RecordingState:
        """Begin an episode."""
        return await self._ask("start", task=task)

    async def stop(self) -> RecordingState:
        """End the episode."""
        return await self._ask("stop")

    async def mark(self, text: str = "") -> RecordingState:
        """Mark this instant of the episode, with a text."""
        return await self._ask("mark", text=text)

    async def success(self, text: str = "") -> RecordingState:
        """Judge the newest episode, and end it if it goes on."""
        return await self._ask("success", text=text)

    async def failure(self, text: str = "") -> RecordingState:
        """As `success`: what was to be shown was not."""
        return await self._ask("failure", text=text)

    async def discard(self, text: str = "") -> RecordingState:
        """As `success`: the episode is not to be used."""
        return await self._ask("discard", text=text)
