"""Encoded pictures for the sender: made as they are needed, or a loop that was encoded once and is kept in a file.

A loop costs nothing to play; encoding full-size pictures at 45 Hz takes several cores. A loop's counters begin again
with it. Films are files of a user's cache folder: what is missing, of another version or damaged is encoded again.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import tempfile
import zlib
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from gateway.sim.camera.composite import Size
from gateway.sim.camera.hevc import Coding, Hevc
from gateway.sim.camera.picture import VERSION
from gateway.sim.camera.rig import Rig

__all__ = ["Coded", "Film", "Interrupted", "live"]

_MAGIC: Final = b"TA2FILM1"


class Interrupted(RuntimeError):
    """Nobody wants the film any more."""


class Coded(NamedTuple):
    """A picture to be sent.

    Attributes:
        counter: In its pixels.
        data: Its access unit, an annex B byte stream.
    """

    counter: int
    data: bytes


def live(coding: Coding, rig: Rig, first: int = 0) -> Iterator[Coded]:
    """Yield pictures for ever, shot and encoded when they are asked for.

    Triggers that a camera misses are left out.

    Raises:
        EncoderMissing: If PyAV, or x265 in it, is not installed.
    """
    encoder = Hevc(coding)
    taken: deque[int] = deque()  # of pictures that the encoder has not given back yet
    for counter in itertools.count(first):
        picture = rig.shoot(counter)
        if picture is None:
            continue
        taken.append(counter)
        yield from (Coded(taken.popleft(), data) for data in encoder.encode(picture))


class Film:
    """A loop of encoded pictures.

    Args:
        pictures: In order; the first one is a key frame with parameter sets.
    """

    def __init__(self, pictures: Sequence[Coded]) -> None:
        self.pictures = tuple(pictures)

    @classmethod
    def of(
        cls,
        coding: Coding,
        count: int,
        *,
        seed: int = 0,
        folder: Path | None = None,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> Film:
        """Return a film of the test cameras, from the cache where it is there.

        `count` is rounded up to whole groups of pictures. A film that cannot be written to the folder is not kept;
        without a folder none is.

        Raises:
            EncoderMissing: If it must be encoded and PyAV, or x265 in it, is not installed.
            Interrupted: If `should_stop` says so.
        """
        count = -(-count // coding.gop) * coding.gop
        path = None if folder is None else folder / _file_name(coding, count, seed)
        kept = None if path is None else _read(path)
        if kept is not None:
            return cls(kept)
        film = cls(_encoded(coding, count, seed, should_stop))
        if path is not None:
            _write(path, film.pictures)
        return film

    @staticmethod
    def is_kept(coding: Coding, count: int, seed: int, folder: Path) -> bool:
        """Return whether there is a file for a film."""
        return (folder / _file_name(coding, -(-count // coding.gop) * coding.gop, seed)).exists()

    def play(self, first: int = 0) -> Iterator[Coded]:
        """Yield its pictures for ever.

        Args:
            first: Index of the picture to begin with, which need not be a key frame.
        """
        for index in itertools.count(first):
            yield self.pictures[index % len(self.pictures)]


def _encoded(coding: Coding, count: int, seed: int, should_stop: Callable[[], bool]) -> list[Coded]:
    rig = Rig(Size(coding.width, coding.height), coding.rate_hz, seed)
    pictures = live(coding, rig)
    film: list[Coded] = []
    while len(film) < count:
        if should_stop():
            raise Interrupted(f"{len(film)} of {count} pictures were encoded")
        film.append(next(pictures))
    return film


def _file_name(coding: Coding, count: int, seed: int) -> str:
    """Return a name that is another one for every other film."""
    words = json.dumps([VERSION, coding.words(), count, seed], sort_keys=True)
    return f"film-{coding.width}x{coding.height}-{hashlib.sha256(words.encode()).hexdigest()[:16]}.bin"


def _read(path: Path) -> list[Coded] | None:
    """Return the pictures of a file; None when it is not there or not whole."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    try:
        magic, checksum, line, data = content[:8], content[8:12], *content[12:].split(b"\n", 1)
        if magic != _MAGIC or zlib.crc32(content[12:]) != int.from_bytes(checksum, "big"):
            return None
        sizes = json.loads(line)
    except ValueError:  # cut short
        return None
    pictures, begin = [], 0
    for counter, size in sizes:
        pictures.append(Coded(counter, data[begin : begin + size]))
        begin += size
    return pictures


def _write(path: Path, pictures: Sequence[Coded]) -> None:
    """Write a file whole or not at all."""
    line = json.dumps([[picture.counter, len(picture.data)] for picture in pictures]).encode()
    body = b"\n".join([line, b"".join(picture.data for picture in pictures)])
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent) as place:
            new = Path(place) / path.name
            new.write_bytes(_MAGIC + zlib.crc32(body).to_bytes(4, "big") + body)
            new.replace(path)
    except OSError:  # a cache that cannot be written to is no cache
        return
