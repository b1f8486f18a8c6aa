"""Records while it is received: coded pictures are written in the thread of the receiver's tap that they wait in.

Rules
    * The receiver never waits: when the disk cannot follow, pictures are dropped there, counted and told.
    * A full disk, or one that fails, ends the recording well and in words; live video goes on.
    * Nothing is decoded or encoded: about a hundredth of a core.
"""

from __future__ import annotations

import errno
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

from gateway.process.threads import supervised
from gateway.video.errors import VideoError
from gateway.video.hevc.access_unit import CLOCK_HZ, AccessUnit
from gateway.video.recording.container import TROUBLE
from gateway.video.recording.take import Counts, Take

if TYPE_CHECKING:
    from gateway.video.receiving.receiver import Receiver

__all__ = ["LEAST_FREE_BYTES", "Recorder"]

LEAST_FREE_BYTES = 100_000_000
"""A recording ends before the disk has less: the host needs some, and so does the file's own end."""
LOOK_EVERY = 45
"""Pictures from one look at the disk's free space to the next."""
STOP_S = 10.0
"""What waits is written within this, or the disk hangs or is too slow [s]."""
TOO_SLOW: Final = "the disk was too slow, the queue was full"


class Recorder:
    """Records what it is given, from any one thread at a time; itself the function of a receiver's tap.

    Args:
        path: Of the recording, .mkv or .mp4; there must be no such file.
        robot: Address that pictures are taken from; empty for anybody's.
        least_free_bytes: The recording ends before the disk has less [bytes].

    Raises:
        Rejected: BAD_REQUEST, no format goes by such a name.
        OSError: The file exists, or cannot be written.
    """

    def __init__(self, path: Path, robot: str = "", *, least_free_bytes: int = LEAST_FREE_BYTES) -> None:
        self._take = Take(path, robot)
        self._least_free_bytes = least_free_bytes
        self._receiver: Receiver | None = None
        self._dropped = 0  # by the receiver, as far as noted
        self._next_seq = 0
        self._until_look = 0
        self._is_open = True
        self._has_ended = False
        self._writing = threading.Lock()
        self.error = ""
        """Why the recording ended by itself; empty while it goes on, and when it was ended."""

    def __enter__(self) -> Recorder:
        """Return it."""
        return self

    def __exit__(self, *_: object) -> None:
        """End it well."""
        self.stop()

    @contextmanager
    def taking(self, receiver: Receiver) -> Iterator[None]:
        """Record what a receiver gets; at the end what waits is written, and trouble is told in `error`.

        The receiver must have been started.
        """
        self._receiver, self._dropped = receiver, receiver.counts.recorder_dropped
        tap = receiver.tap(self, name="recorder")
        try:
            yield
        finally:
            try:
                tap.close(STOP_S)
            except VideoError as error:
                self.error = self.error or str(error)

    def __call__(self, unit: AccessUnit) -> None:
        """Write a picture; returns when it is written."""
        with self._writing:
            if not self._is_open:
                return
            try:
                self._write(unit)
            except TROUBLE as error:
                self._is_open, self.error = False, self._in_words(error)
                self._end(self.error)

    @property
    def counts(self) -> Counts:
        """How far it is."""
        return self._take.counts

    @property
    def path(self) -> Path:
        """Of the recording."""
        return self._take.path

    def stop(self, timeout_s: float = STOP_S) -> bool:
        """End the recording; return whether the disk let it.

        Args:
            timeout_s: Longest wait for the disk [s].
        """
        self._is_open = False
        over = threading.Event()

        def end() -> None:
            try:
                with self._writing:
                    self._end("it was ended")
            finally:
                over.set()

        supervised(end, "video-recorder").start()
        if not over.wait(timeout_s):  # not `join`: Ctrl-C in it makes Python 3.11 believe that the thread has ended
            self.error = f"the disk has not answered for {timeout_s:g} s: what {self.path} holds by now is readable"
        return not self.error

    def _end(self, why: str) -> None:
        if self._has_ended:
            return
        self._has_ended = True
        try:
            try:
                self._note_dropped()
            finally:
                self._take.end(why)
        except TROUBLE as error:
            self.error = self.error or self._in_words(error)

    def _write(self, unit: AccessUnit) -> None:
        if unit.seq != self._next_seq:
            self._note_dropped()
        self._next_seq = unit.seq + 1
        if self._until_look == 0:
            self._until_look = LOOK_EVERY
            if shutil.disk_usage(self.path.parent).free < self._least_free_bytes:
                raise OSError(errno.ENOSPC, "less than the host needs is free")
        self._until_look -= 1
        self._take.write(unit)

    def _note_dropped(self) -> None:
        """Note what the receiver has dropped since; it knows of the newest first, so that this may come a little early."""
        if self._receiver is None or not self.counts.pictures:
            return
        dropped = self._receiver.counts.recorder_dropped
        if dropped > self._dropped:
            self._take.drop(dropped - self._dropped, TOO_SLOW)
        self._dropped = dropped

    def _in_words(self, error: Exception) -> str:
        counts = self.counts
        held = f"{counts.pictures} pictures ({max(counts.newest_pts, 0) / CLOCK_HZ:.1f} s) are in it"
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            free_mb = shutil.disk_usage(self.path.parent).free / 1e6
            what = f"no room for {self.path}: {free_mb:.0f} MB are free there; free some, or record elsewhere"
        else:
            what = f"{self.path} cannot be written: {error}"
        return f"the recording has ended, {held}: {what}"
