"""What a person sees while a command owns the robot: live bars on a terminal, plain lines elsewhere. On standard error.

Says what it is told and decides nothing.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskID, TextColumn

__all__ = ["Teller", "dispensable_teller", "teller"]

STEP = 0.25
"""Without a terminal, progress is told whenever so much more of it is behind."""


class Teller(Protocol):
    """Somebody to tell."""

    def say(self, text: str) -> None:
        """Say a sentence that stays to be read."""

    def advance(self, phase: str, progress: float | None, detail: str) -> None:
        """Show how far a phase is, 0..1; None while nobody can know."""


REFRESHED_S = 0.25
"""How often bars are drawn anew that no thread of Rich's draws [s]."""


@contextmanager
def teller(*, has_thread: bool = True) -> Iterator[Teller]:
    """Return whoever fits standard error, for the time of a block.

    Args:
        has_thread: Whether a thread draws: its spinner turns while nobody tells anything.
    """
    if not sys.stderr.isatty():
        yield _Lines()
        return
    columns = (SpinnerColumn(), TextColumn("{task.description:<8}"), BarColumn(30), TextColumn("{task.fields[detail]}"))
    console = Console(stderr=True, highlight=False)
    with Progress(*columns, console=console, auto_refresh=has_thread) as progress:
        yield _Bars(progress)


@contextmanager
def dispensable_teller() -> Iterator[Teller]:
    """Return the same for a block that goes on when standard error is gone: what is then said goes nowhere.

    Without a thread, which would meet the error by itself, and cost as much as the writing of what a robot says.
    """
    shown = ExitStack()
    tell = _Dispensable(None)
    with suppress(OSError):
        tell = _Dispensable(shown.enter_context(teller(has_thread=False)))
    try:
        yield tell
    finally:
        with suppress(OSError):
            shown.close()


class _Dispensable:
    def __init__(self, tell: Teller | None) -> None:
        self._tell = tell

    def say(self, text: str) -> None:
        self._do(lambda tell: tell.say(text))

    def advance(self, phase: str, progress: float | None, detail: str) -> None:
        self._do(lambda tell: tell.advance(phase, progress, detail))

    def _do(self, deed: Callable[[Teller], None]) -> None:
        try:
            if self._tell is not None:
                deed(self._tell)
        except OSError:
            self._tell = None


class _Lines:
    def __init__(self) -> None:
        self._told: dict[str, int] = {}

    def say(self, text: str) -> None:
        print(f"{text}\n", end="", file=sys.stderr, flush=True)  # in one: Ctrl-C comes before or behind a line

    def advance(self, phase: str, progress: float | None, detail: str) -> None:
        step = 0 if progress is None else int(progress / STEP)
        if self._told.get(phase) != step:
            self._told[phase] = step
            self.say(f"{phase}: {detail}")


class _Bars:
    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._tasks: dict[str, TaskID] = {}
        self._drawn_s = 0.0

    def say(self, text: str) -> None:
        self._progress.console.print(text, markup=False, soft_wrap=True)

    def advance(self, phase: str, progress: float | None, detail: str) -> None:
        if phase not in self._tasks:
            self._tasks[phase] = self._progress.add_task(phase, total=None, detail=detail)
        total = None if progress is None else 1.0
        self._progress.update(self._tasks[phase], total=total, completed=progress or 0.0, detail=detail)
        if not self._progress.live.auto_refresh and (now_s := time.monotonic()) >= self._drawn_s + REFRESHED_S:
            self._drawn_s = now_s
            self._progress.refresh()
