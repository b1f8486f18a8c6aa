"""Splits a recording while it is made, in threads that leave the processor to everything else.

It reads the file that is being written, so that falling behind costs nothing: what is not split when the recording ends
is split then. Nothing is dropped, and neither the receiver nor the recorder knows of it.
"""

from __future__ import annotations

import contextlib
import os
import threading

from gateway.process.threads import supervised
from gateway.video.hevc.access_unit import CLOCK_HZ
from gateway.video.recording.split import Split, Splitter

__all__ = ["BEHIND_S", "LiveSplit", "be_nice"]

BEHIND_S = 5.0
"""A split that is further behind does not keep up [s]: fragments reach the file up to a second late."""
NICENESS = 10


def be_nice() -> None:
    """Leave the processor to others, in this thread and those it starts (Linux gives each thread a priority of its own)."""
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)


class LiveSplit:
    """Runs a split beside a recording.

    Args:
        splitter: Made with `prepare=be_nice`.
    """

    def __init__(self, splitter: Splitter) -> None:
        self._splitter = splitter
        self._thread = supervised(self._run, "video-split")
        self._over = threading.Event()  # not `join`: Ctrl-C in it makes Python 3.11 believe that the thread has ended
        self._split: Split | None = None
        self._error: Exception | None = None

    def start(self) -> None:
        """Begin, once there is a first picture in the recording."""
        self._thread.start()

    @property
    def has_begun(self) -> bool:
        """Whether it was started."""
        return self._thread.ident is not None

    @property
    def is_over(self) -> bool:
        """Whether nothing more will happen."""
        return self._over.is_set()

    @property
    def position_s(self) -> float:
        """How far it is in the recording [s]."""
        return max(self._splitter.position_ticks, 0) / CLOCK_HZ

    def cancel(self) -> None:
        """End soon; the files end well, with what is in them."""
        self._splitter.cancel()

    def wait(self, timeout_s: float) -> bool:
        """Wait for its end for some time [s]; return whether it is over."""
        return self._over.wait(timeout_s)

    def outcome(self) -> Split:
        """Return what came of it, when it is over.

        Raises:
            Rejected: BAD_REQUEST, it could not be split.
        """
        if self._error is not None:
            raise self._error
        assert self._split is not None
        return self._split

    def _run(self) -> None:
        try:
            self._split = self._splitter.run()
        except Exception as error:  # noqa: BLE001  of another thread, which `outcome` raises there
            self._error = error
        finally:
            self._over.set()
