"""Coded pictures from the receiving thread to one who takes them: a queue that never makes the receiver wait."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Protocol

from gateway.process.threads import supervised
from gateway.video.errors import VideoCode, VideoError
from gateway.video.hevc.access_unit import AccessUnit

__all__ = ["AccessUnits", "CallbackTap", "Tap"]


class AccessUnits(Protocol):
    """Where a decoder thread takes its pictures from: a `Tap`, a `Receiver`, or a list in a test."""

    def take(self, timeout_s: float) -> AccessUnit | None:
        """Return the next coded picture; None when none comes in time, or no more will come.

        Compare it with the one before by `AccessUnit.follows`: pictures are dropped on purpose, too.

        Args:
            timeout_s: Longest wait [s].

        Raises:
            VideoError: RECEIVER_FAILED: receiving ended by an error.
        """

    @property
    def is_over(self) -> bool:
        """Whether no more will come: the receiver was stopped, and all that came before has been taken."""


class Backlog(Protocol):
    """How pictures wait; see `backlog`."""

    def __len__(self) -> int: ...

    def put(self, unit: AccessUnit) -> None: ...

    def take(self, now_ns: int) -> AccessUnit | None: ...


class Tap:
    """A queue of coded pictures for one taker."""

    def __init__(self, backlog: Backlog) -> None:
        self._backlog = backlog
        self._change = threading.Condition()
        self._is_closed = False
        self._error: BaseException | None = None

    @property
    def is_over(self) -> bool:
        """Whether no more will come: the receiver was stopped, and all that came before was taken. A failure `take` raises."""
        with self._change:
            return self._is_closed and not len(self._backlog) and self._error is None

    def put(self, unit: AccessUnit) -> None:
        """Hand a picture over; never waits for the taker."""
        with self._change:
            if not self._is_closed:
                self._backlog.put(unit)
                self._change.notify()

    def take(self, timeout_s: float) -> AccessUnit | None:
        """Return the next coded picture; None when none comes in time, or no more will come.

        Args:
            timeout_s: Longest wait [s].

        Raises:
            VideoError: RECEIVER_FAILED: receiving ended by an error.
        """
        deadline_ns = time.monotonic_ns() + int(timeout_s * 1e9)
        with self._change:
            while True:
                now_ns = time.monotonic_ns()
                if (unit := self._backlog.take(now_ns)) is not None:
                    return unit
                if self._error is not None:
                    raise VideoError(
                        VideoCode.RECEIVER_FAILED,
                        f"receiving the video ended: {self._error!r}",
                        "start the receiver again; report the message if it comes back",
                    ) from self._error
                if self._is_closed or now_ns >= deadline_ns:
                    return None
                self._change.wait((deadline_ns - now_ns) / 1e9)

    def close(self, error: BaseException | None = None) -> None:
        """Let no more come; what waits can still be taken.

        Args:
            error: What ended receiving; `take` raises it.
        """
        with self._change:
            self._is_closed = True
            self._error = self._error or error
            self._change.notify_all()


class CallbackTap:
    """Calls a function with each coded picture, in a thread of its own: a slow one delays nobody.

    Pictures wait for it; when there are too many, the newest are dropped up to the next one that decoding can begin with.
    An error of the function ends it, and is raised by `close`.
    """

    def __init__(
        self, tap: Tap, callback: Callable[[AccessUnit], object], name: str, leave: Callable[[Tap], None]
    ) -> None:
        self.name = name
        self._tap = tap
        self._callback = callback
        self._leave = leave
        self.error: BaseException | None = None
        """What ended it; None while nothing has."""
        self._thread = supervised(self._run, f"video-{name}")
        self._thread.start()

    def __enter__(self) -> CallbackTap:
        """Return it."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def close(self, timeout_s: float = 10.0) -> None:
        """Let no more come, and wait until the function has had all that came.

        Args:
            timeout_s: Longest wait for it [s].

        Raises:
            VideoError: TAKER_FAILED: the function raised an error, or it does not end.
        """
        self._leave(self._tap)
        self._tap.close()
        self._thread.join(timeout_s)
        if self.error is None and self._thread.is_alive():
            self.error = TimeoutError(f"it has not ended after {timeout_s} s")
        if self.error is not None:
            raise VideoError(
                VideoCode.TAKER_FAILED,
                f"{self.name} of the video ended: {self.error!r}",
                "see the error; what it had been given before stands",
            ) from self.error

    def _run(self) -> None:
        try:
            while not self._tap.is_over:
                if (unit := self._tap.take(timeout_s=1.0)) is not None:
                    self._callback(unit)
        except BaseException as error:
            self.error = error
            raise
        finally:
            self._leave(self._tap)
            self._tap.close()
