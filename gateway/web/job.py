"""A job: a command of `ta2` that only looks, as a process of its own, for all pages; its JSON is what they see.

Rules
    * Whoever asks is answered at once, and looks for the result later: a browser's connections stay free for a stop.
    * One of a kind runs at a time, behind the gateway (nice), and no longer than its time: then it is killed.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
from typing import Any

import msgspec
from msgspec.structs import replace

__all__ = ["Job", "JobSeen"]

NICE = 10
MOST_S = 60.0
"""How long it may take [s]."""


class JobSeen(msgspec.Struct, frozen=True, kw_only=True):
    """Whether it runs, what it said as JSON the last time (None before, and when it failed), and why it failed."""

    is_running: bool
    report: dict[str, Any] | None
    error: str


class Job:
    """A command that may be run: program and arguments."""

    def __init__(self, *command: str) -> None:
        self._command = command
        self._running: asyncio.Task[None] | None = None
        self.seen = JobSeen(is_running=False, report=None, error="")
        """How it is now."""

    def begin(self) -> None:
        """Run it, unless it runs."""
        if not self.seen.is_running:
            self.seen = replace(self.seen, is_running=True)
            self._running = asyncio.create_task(self._run())

    async def end(self) -> None:
        """Kill what runs."""
        if self._running is not None:
            self._running.cancel()
            await asyncio.wait({self._running})

    async def _run(self) -> None:
        report, error = None, "it was ended"
        try:
            said = msgspec.json.decode(await self._said(), type=dict[str, Any])
            failed = said.get("error")
            report, error = (said, "") if failed is None else (None, f"{failed['message']} -> {failed['hint']}")
        except asyncio.TimeoutError:
            error = f"it took more than {MOST_S:g} s, and was killed"
        except (msgspec.MsgspecError, OSError) as wrong:
            error = f"it said nothing that can be read: {wrong}"
        finally:
            self.seen = JobSeen(is_running=False, report=report, error=error)

    async def _said(self) -> bytes:
        pipe, nothing = asyncio.subprocess.PIPE, asyncio.subprocess.DEVNULL
        process = await asyncio.create_subprocess_exec(*self._command, stdin=nothing, stdout=pipe, stderr=nothing)
        try:
            with contextlib.suppress(OSError):  # it has ended already
                os.setpriority(os.PRIO_PROCESS, process.pid, max(NICE, os.getpriority(os.PRIO_PROCESS, 0)))
            return (await asyncio.wait_for(process.communicate(), MOST_S))[0]
        finally:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
