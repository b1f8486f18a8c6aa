"""Records while it is received: a thread that takes coded pictures from a bounded queue and writes them.

Rules
    * The receiver never waits: when the disk cannot follow, pictures are dropped, counted and told.
    * A full disk, or one that fails, ends the recording well and in words; live video goes on.
    * Nothing is decoded or encoded: about a hundredth of a core.
"""

from __future__ import annotations

import errno
import shutil
import threading
from pathlib import Path
from queue import SimpleQueue
from typing import Final

from gateway.process.threads import supervised
from gateway.video.hevc.access_unit import CLOCK_HZ, AccessUnit
from gateway.video.recording.container import TROUBLE
from gateway.video.recording.take import Counts, Take

__all__ = ["LEAST_FREE_BYTES", "QUEUE_UNITS", "Recorder"]

QUEUE_UNITS = 450
"""Pictures that wait for a slow disk: 10 s at 45 fps, some 25 MB at 20 Mbit/s."""
LEAST_FREE_BYTES = 100_000_000
"""A recording ends before the disk has less: the host needs some, and so does the file's own end."""
LOOK_EVERY = 45
"""Pictures from one look at the disk's free space to the next."""
STOP_S = 10.0
"""What waits in the queue is written within this, or the disk hangs [s]."""
TOO_SLOW: Final = "the disk was too slow, the queue was full"


class Recorder:
    """Records what it is given; itself the tap of a receiver, callable from any one thread.

    Args:
        path: Of the recording, .mkv or .mp4; there must be no such file.
        robot: Address that pictures are taken from; empty for anybody's.
        queue_units: Pictures that may wait for the disk.
        least_free_bytes: The recording ends before the disk has less [bytes].

    Raises:
        Rejected: BAD_REQUEST, no format goes by such a name.
        OSError: The file exists, or cannot be written.
    """

    def __init__(
        self,
        path: Path,
        robot: str = "",
        *,
        queue_units: int = QUEUE_UNITS,
        least_free_bytes: int = LEAST_FREE_BYTES,
    ) -> None:
        self._take = Take(path, robot)
        self._queue: SimpleQueue[tuple[AccessUnit, int] | None] = SimpleQueue()
        self._queue_units = queue_units
        self._least_free_bytes = least_free_bytes
        self._dropped = 0  # since the last one that found room
        self._until_look = 0
        self._is_open = True
        self._over = threading.Event()
        self._thread = supervised(self._run, "video-recorder")
        self.error = ""
        """Why the recording ended by itself; empty while it goes on, and when it was ended."""

    def __enter__(self) -> Recorder:
        """Begin."""
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        """End it well."""
        self.stop()

    def start(self) -> None:
        """Begin to write what comes."""
        self._thread.start()

    def __call__(self, unit: AccessUnit) -> None:
        """Take a picture; never waits."""
        if not self._is_open:
            return
        if self._queue.qsize() >= self._queue_units:
            self._dropped += 1
            return
        self._queue.put((unit, self._dropped))
        self._dropped = 0

    @property
    def counts(self) -> Counts:
        """How far it is."""
        return self._take.counts

    @property
    def path(self) -> Path:
        """Of the recording."""
        return self._take.path

    def stop(self, timeout_s: float = STOP_S) -> bool:
        """Write what waits, and end the recording; return whether the disk let it.

        Args:
            timeout_s: Longest wait for the disk [s].
        """
        self._is_open = False
        if self._thread.ident is None:  # never started
            self._take.end("nothing was recorded")
            return True
        self._queue.put(None)
        if not self._over.wait(
            timeout_s
        ):  # not `join`: Ctrl-C in it makes Python 3.11 believe that the thread has ended
            self.error = f"the disk has not answered for {timeout_s:g} s: what {self.path} holds by now is readable"
        return not self.error

    def _run(self) -> None:
        try:
            self._record()
        finally:
            self._is_open = False
            self._over.set()

    def _record(self) -> None:
        why = "it was ended"
        try:
            while (item := self._queue.get()) is not None:
                self._write(*item)
            if self._dropped:
                self._take.drop(self._dropped, TOO_SLOW)
        except TROUBLE as error:
            self.error = why = self._in_words(error)
        self._is_open = False
        try:
            self._take.end(why)
        except TROUBLE as error:
            self.error = self.error or self._in_words(error)

    def _write(self, unit: AccessUnit, dropped: int) -> None:
        if dropped:
            self._take.drop(dropped, TOO_SLOW)
        if self._until_look == 0:
            self._until_look = LOOK_EVERY
            if shutil.disk_usage(self.path.parent).free < self._least_free_bytes:
                raise OSError(errno.ENOSPC, "less than the host needs is free")
        self._until_look -= 1
        self._take.write(unit)

    def _in_words(self, error: Exception) -> str:
        counts = self.counts
        held = f"{counts.pictures} pictures ({max(counts.newest_pts, 0) / CLOCK_HZ:.1f} s) are in it"
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            free_mb = shutil.disk_usage(self.path.parent).free / 1e6
            what = f"no room for {self.path}: {free_mb:.0f} MB are free there; free some, or record elsewhere"
        else:
            what = f"{self.path} cannot be written: {error}"
        return f"the recording has ended, {held}: {what}"
