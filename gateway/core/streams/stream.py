"""What every stream to the robot has in common: its topic, its grid, whether it runs, and the frame that is due.

A stream decides *what* to send and *when*; whether it may be sent is the gate's word, and whether it runs is the body's.
"""

from __future__ import annotations

from collections import deque
from typing import Protocol

from gateway.core.messages.outputs import Frame
from gateway.messages.snapshot import StreamView

__all__ = ["SentLog", "Stream"]

S = 1_000_000_000
RATE_WINDOW_NS = 2 * S
"""Sent rates are measured over this [ns]."""
GAP_WINDOW_NS = 10 * S
"""The worst gap is the worst of this long [ns]."""
FORGET_NS = S // 4
"""What is older than the window is kept this much longer at most [ns], until somebody asks: not each frame sweeps."""


class Stream(Protocol):
    """A command stream on its own absolute grid.

    Attributes:
        topic: ROS name of the command topic.
        log: What was sent, as seen by the outside.
    """

    topic: str
    log: SentLog

    @property
    def running(self) -> bool:
        """Whether frames are being sent."""
        ...

    def next_due_ns(self) -> int | None:
        """Return the next instant at which a frame is due [ns]; None when the stream is off."""
        ...

    def frame(self, now_ns: int) -> Frame | None:
        """Return the frame that is due now, or None. Advances the stream by one nominal period when it returns one."""
        ...


class SentLog:
    """Counts, rate and gaps of one stream: what left the gate, measured at the tick."""

    def __init__(self) -> None:
        self.sent = 0
        """Frames sent since the start of the daemon."""
        self.last_ns: int | None = None
        """When the last frame left [ns]; None while the stream is off."""
        self.is_anew = False
        """Whether the next frame is a start although none was missing before it."""
        self._times: deque[int] = deque()
        self._gaps: deque[tuple[int, int]] = deque()

    def note(self, now_ns: int) -> None:
        """Record a frame that left now."""
        if self.last_ns is not None:
            gap_ns = now_ns - self.last_ns
            while self._gaps and self._gaps[-1][1] <= gap_ns:
                self._gaps.pop()
            self._gaps.append((now_ns, gap_ns))
        self.last_ns = now_ns
        self.is_anew = False
        self.sent += 1
        self._times.append(now_ns)
        if now_ns - self._times[0] > RATE_WINDOW_NS + FORGET_NS:
            self._forget(now_ns)

    def end(self) -> None:
        """The stream went silent on purpose: the silence is no gap, and no part of the next rate."""
        self.last_ns = None
        self._times.clear()

    def begin_anew(self) -> None:
        """The next frame is a start, in its time."""
        self.is_anew = True

    def _forget(self, now_ns: int) -> None:
        while self._times and now_ns - self._times[0] > RATE_WINDOW_NS:
            self._times.popleft()
        while self._gaps and now_ns - self._gaps[0][0] > GAP_WINDOW_NS:
            self._gaps.popleft()

    def worst_gap(self, now_ns: int) -> tuple[int, int] | None:
        """Return the worst gap of the last 10 s as (when it ended, how long it was) [ns]; None before the second frame."""
        self._forget(now_ns)
        return self._gaps[0] if self._gaps else None

    def view(self, now_ns: int) -> StreamView:
        """Return the stream's figures at `now_ns`."""
        self._forget(now_ns)
        span_ns = self._times[-1] - self._times[0] if len(self._times) > 1 else 0
        rate_hz = (len(self._times) - 1) * S / span_ns if span_ns else 0.0
        return StreamView(
            running=self.last_ns is not None,
            sent=self.sent,
            rate_hz=rate_hz,
            worst_gap_ns=self._gaps[0][1] if self._gaps else 0,
        )
