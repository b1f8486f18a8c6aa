"""A recording that is read while it is written: at its end the reader waits for more, until the writer is gone.

The writer holds a lock on the file (`flock`), which the system takes back when its process ends, however it ends.
"""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO

__all__ = ["Growing", "claim", "is_growing"]

POLL_S = 0.05


def claim(file: IO[bytes]) -> None:
    """Mark a file as being written by this process, for as long as it holds it open.

    A file system without locks lets it be: its recordings are only followed when they are complete.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return


def is_growing(file: IO[bytes]) -> bool:
    """Return whether somebody writes this file."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    fcntl.flock(file, fcntl.LOCK_UN)
    return False


class Growing:
    """A file for libavformat to read, which ends where its writer ended it.

    Args:
        path: Of the recording.
        is_cancelled: Asked while it waits; when true, the file ends here.

    Raises:
        OSError: There is none, or it cannot be read.
    """

    def __init__(self, path: Path, is_cancelled: Callable[[], bool] = lambda: False) -> None:
        self._file = path.open("rb", buffering=0)
        self._is_cancelled = is_cancelled
        self.name = os.fspath(path)

    @property
    def is_growing(self) -> bool:
        """Whether somebody writes it."""
        return is_growing(self._file)

    def read(self, size: int) -> bytes:
        """Return what is there, waiting for it while somebody writes; nothing at the end."""
        while not self._is_cancelled():
            was_growing = self.is_growing  # first: what is written between the two is still read
            data = self._file.read(size)
            if data or not was_growing:
                return data
            time.sleep(POLL_S)
        return b""

    def close(self) -> None:
        """Close it."""
        self._file.close()
