"""The newest frame, for as many readers as like: one reference is put in place of another, and all who wait are woken.

Readers hold no lock while they use a frame; a slow one delays nobody and misses what was replaced meanwhile.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from gateway.video.decoding.frame import Frame
from gateway.video.errors import VideoCode, VideoError

__all__ = ["Newest", "Pace"]


class Newest:
    """Holds the newest frame."""

    def __init__(self) -> None:
        self._change = threading.Condition()
        self.frame: Frame | None = None
        """The newest frame; None before the first."""
        self._error: BaseException | None = None
        self.is_open = True
        """Whether more may come."""
        self._listeners: tuple[Callable[[], None], ...] = ()

    def publish(self, frame: Frame) -> None:
        """Put a frame in place of the one before."""
        with self._change:
            self.frame = frame
            self._change.notify_all()
        self._tell()

    def open(self) -> None:
        """Let frames come, again."""
        with self._change:
            self.is_open, self._error = True, None

    def close(self, error: BaseException | None = None) -> None:
        """Let no more come; whoever waits is told.

        Args:
            error: What ended it; it is raised where frames are waited for.
        """
        with self._change:
            self.is_open = False
            self._error = self._error or error
            self._change.notify_all()
        self._tell()

    def peek(self, after_seq: int) -> Frame | None:
        """Return the newest frame if it is newer than another one.

        Raises:
            VideoError: DECODER_FAILED or RECEIVER_FAILED, what ended it.
        """
        if (error := self._error) is not None:
            raise _failure(error) from error
        frame = self.frame
        return frame if frame is not None and frame.seq > after_seq else None

    def wait(self, after_seq: int, timeout_s: float) -> Frame | None:
        """Return the newest frame that is newer than another one; None when none comes in time, or no more will come.

        Args:
            after_seq: Of the other one; -1 takes any.
            timeout_s: Longest wait [s].

        Raises:
            VideoError: DECODER_FAILED or RECEIVER_FAILED, what ended it.
        """
        deadline = time.monotonic() + timeout_s
        with self._change:
            while (frame := self.peek(after_seq)) is None and self.is_open:
                rest_s = deadline - time.monotonic()
                if rest_s <= 0:
                    return None
                self._change.wait(min(rest_s, threading.TIMEOUT_MAX))
            return frame

    def pause(self, seconds: float) -> bool:
        """Wait for a time [s]; return whether frames may still come after it."""
        deadline = time.monotonic() + seconds
        with self._change:
            while self.is_open and (rest_s := deadline - time.monotonic()) > 0:
                self._change.wait(rest_s)
            return self.is_open

    @contextmanager
    def listening(self, listener: Callable[[], None]) -> Iterator[None]:
        """Call a function after each change for the time of a block, from the thread that made it."""
        with self._change:
            self._listeners = (*self._listeners, listener)
        try:
            yield
        finally:
            with self._change:
                self._listeners = tuple(other for other in self._listeners if other is not listener)

    def _tell(self) -> None:
        for listener in self._listeners:
            listener()


class Pace:
    """When the next frame is due, for a reader that wants no more than so many a second.

    Args:
        max_rate: The highest rate [Hz]; None for as they come.

    Raises:
        ValueError: It is no positive number.
    """

    def __init__(self, max_rate: float | None) -> None:
        if max_rate is not None and not (math.isfinite(max_rate) and max_rate > 0):
            raise ValueError(f"max_rate is {max_rate} Hz: a positive number is needed, or None for as they come")
        self._period_ns = 0 if max_rate is None else round(1e9 / max_rate)
        self._due_ns: int | None = None

    def rest_s(self, now_ns: int) -> float:
        """Return how long to wait before the next frame is taken [s]."""
        return 0.0 if self._due_ns is None else max(0, self._due_ns - now_ns) / 1e9

    def taken(self, now_ns: int) -> None:
        """Take note of a frame; who was late is not given more at once afterwards."""
        due_ns = now_ns if self._due_ns is None else self._due_ns
        self._due_ns = max(due_ns + self._period_ns, now_ns)


def _failure(error: BaseException) -> VideoError:
    if isinstance(error, VideoError):
        return VideoError(error.code, error.message, error.hint)
    return VideoError(
        VideoCode.DECODER_FAILED,
        f"the thread that decodes ended: {error!r}",
        "start again; report the message if it comes back",
    )
