"""When each picture was handed to the network: a table in a file, which a test or benchmark on the same host reads.

The receiver finds the counter in the pixels and looks it up: both read the same monotonic clock, so the difference is
the latency. A file in /dev/shm costs no disk. A counter that comes again, as in a loop, has the time of its latest.
"""

from __future__ import annotations

import mmap
from pathlib import Path
from typing import Final, NamedTuple

__all__ = ["HandOver", "HandOvers"]

_MAGIC: Final = 0x5441_3248_4F31  # "TA2HO1"
_HEADER, _FIELDS = 4, 4  # 64-bit words
_WORD: Final = 8


class HandOver(NamedTuple):
    """One picture's.

    Attributes:
        sent_ns: When its first packet was handed over, monotonic [ns].
        rtp_timestamp: 32 bits [ticks of 90 kHz].
        ssrc: Of the sender.
    """

    sent_ns: int
    rtp_timestamp: int
    ssrc: int


class HandOvers:
    """The table: the sender writes, anybody reads.

    Args:
        path: Of the file.
        slots: So many of the newest counters are remembered; None to read a table that is there.

    Raises:
        ValueError: If the file is no such table, or there is no slot.
        OSError: If it cannot be made or opened.
    """

    def __init__(self, path: Path, slots: int | None = None) -> None:
        if slots is not None:
            if slots < 1:
                raise ValueError(f"{slots} slots: at least one is needed")
            path.write_bytes(bytes(_WORD * (_HEADER + slots * _FIELDS)))
        if path.stat().st_size < _WORD * _HEADER or path.stat().st_size % _WORD:
            raise ValueError(f"{path} is no table of hand-overs")
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), 0)
        self._words = memoryview(self._map).cast("q")
        if slots is not None:
            self._words[1] = slots
            self._words[0] = _MAGIC
        elif self._words[0] != _MAGIC:
            self.close()
            raise ValueError(f"{path} is no table of hand-overs")
        self._slots = self._words[1]

    def note(self, counter: int, handed: HandOver) -> None:
        """Remember when a picture was handed over."""
        place = _HEADER + counter % self._slots * _FIELDS
        self._words[place] = -1  # a reader in between finds nothing
        self._words[place + 1], self._words[place + 2], self._words[place + 3] = handed
        self._words[place] = counter
        self._words[2] += 1

    def find(self, counter: int) -> HandOver | None:
        """Return a picture's latest hand-over; None when there was none, or it was too long ago."""
        place = _HEADER + counter % self._slots * _FIELDS
        words = self._words[place : place + _FIELDS].tolist()
        if words[0] != counter or self._words[place] != counter or not words[1]:
            return None
        return HandOver(*words[1:])

    @property
    def count(self) -> int:
        """Pictures handed over so far."""
        return self._words[2]

    def close(self) -> None:
        """Let go of the file, which stays."""
        self._words.release()
        self._map.close()

    def __enter__(self) -> HandOvers:
        """Return the table."""
        return self

    def __exit__(self, *_: object) -> None:
        """Let go of the file."""
        self.close()
