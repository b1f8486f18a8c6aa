"""The one way to start a thread: none ends unasked without the owner of the process hearing of it.

Rules
    * Whatever ends it counts: an error, a panic of a compiled part (a BaseException, as zenoh's are), and a return that
      nobody asked for.
    * The trace goes to the log at once. The owner of the process looks for what was lost (`take_lost`) in his own time:
      nothing of his runs in a thread that is ending, and nothing waits for one that has ended.
    * A process may be a user's, who never looks: what must be known there is told by `on_lost`.
    * What is needed until the process has ended, such as who answers stops, is begun anew, once.
"""

from __future__ import annotations

import logging
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable

from msgspec import Struct

__all__ = ["Lost", "supervised", "take_lost"]

_log = logging.getLogger(__name__)

MAX_LOST = 64
DEEPEST = 20
"""So many of the innermost calls are told."""


class Lost(Struct, frozen=True, kw_only=True):
    """A thread that ended unasked.

    Attributes:
        name: Of the thread.
        why: What ended it, in a few words.
        trace: The trace; empty when it returned.
        at_ns: When [ns].
    """

    name: str
    why: str
    trace: str
    at_ns: int

    def __str__(self) -> str:
        """Return one sentence."""
        return f"the thread {self.name} ended unasked: {self.why}"


_lost: deque[Lost] = deque(maxlen=MAX_LOST)


def take_lost() -> list[Lost]:
    """Return the threads of this process that were lost since the last call. Never waits."""
    return [_lost.popleft() for _ in range(len(_lost))]


def supervised(
    work: Callable[[], object],
    name: str,
    *,
    may_return: Callable[[], bool] = lambda: True,
    again: bool = False,
    on_lost: Callable[[Lost], object] = _lost.append,
    daemon: bool = True,
) -> threading.Thread:
    """Return a thread that is not started yet, and whose unexpected end is told.

    Args:
        work: What it does.
        name: Of the thread.
        may_return: Whether the work may return now, asked when it has: true of work that comes to an end by itself.
        again: Whether the work is begun anew when it was lost, once.
        on_lost: Called in the thread when it was lost.
        daemon: Whether the process may end without it.
    """

    def run() -> None:
        for _ in range(1 + again):
            lost = _end_of(work, name, may_return)
            if lost is None:
                return
            on_lost(lost)

    return threading.Thread(target=run, name=name, daemon=daemon)


def _end_of(work: Callable[[], object], name: str, may_return: Callable[[], bool]) -> Lost | None:
    """Do the work; return how it was lost, None when it ended as it should."""
    why, trace = "it returned", ""
    try:
        work()
        if may_return():
            return None
    except BaseException as error:  # noqa: BLE001  a panic is none of Python's own errors, and must be told like them
        why, trace = (
            "".join(traceback.format_exception_only(type(error), error)).strip(),
            traceback.format_exc(-DEEPEST),
        )
    lost = Lost(name=name, why=why, trace=trace, at_ns=time.monotonic_ns())
    _log.critical("%s\n%s", lost, trace)
    return lost
