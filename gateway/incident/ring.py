"""The ring on disk and what is kept of it. Of one thread, which may wait for the disk.

    FOLDER/ring/NUMBER.box      pieces of some seconds, each of which begins with the engine's state; the oldest are let go
    FOLDER/kept/NAME/           an incident: the pieces around it, and `incident.json`
    FOLDER/events.jsonl         what was told, see `event_log.py`

Folders have mode 0700, files 0600. A piece is one line of JSON, then blocks: four bytes of length, and records under zlib.
A piece that is written no more when its process dies is as good as what reached it: reading ends at the last whole block.
Pieces that are complete, and incidents, are forced onto the disk: a power cut takes the last piece at most.
"""

from __future__ import annotations

import contextlib
import errno
import io
import itertools
import json
import os
import re
import shutil
import time
import zlib
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from gateway.incident.folders import NEW_FILE, own_folder
from gateway.incident.freezing import Unpickler
from gateway.incident.records import Start, Tick

__all__ = ["KEPT_BYTES", "KEPT_INCIDENTS", "RING_NS", "SUFFIX", "Piece", "Ring", "folder_of", "piece", "records"]

S = 1_000_000_000
RING_NS = 64 * S
"""What lies at least behind the newest record [ns]: a minute before what it is kept for, which happens 3 s later."""
RING_BYTES = 96 * 2**20
"""Largest ring; it reaches back less far where this does not suffice. Ten samples a tick take 0.3 MB/s before zlib."""
KEPT_INCIDENTS = 20
KEPT_BYTES = 512 * 2**20
"""So many incidents, and so much of them together, are kept; those that are not grave are let go first, then those of a clock
that was ahead, then the oldest; the newest last."""
SPARE_BYTES = 256 * 2**20
"""Nothing is written where the disk would have less than this left."""
BLOCK_BYTES = 64 * 2**20
"""A block is never so large; what says so is no block."""
SUFFIX = ".box"
ALL = "incidents"
"""Folder of all robots' black boxes."""


def folder_of(state_file: Path) -> Path:
    """Return the folder of a robot's black box, beside its state file."""
    return state_file.parent / ALL / state_file.stem


class Piece(NamedTuple):
    """A piece on disk.

    Attributes:
        path: Its file.
        header: Who wrote it, and when: `wall_ns` and `mono_ns` are the same moment.
    """

    path: Path
    header: Mapping[str, object]


def piece(path: Path) -> Piece:
    """Return a piece's header.

    Raises:
        OSError: It cannot be read.
        ValueError: It is no piece.
    """
    with path.open("rb") as file:
        header = json.loads(file.readline(65536))
    if not isinstance(header, dict) or not isinstance(header.get("form"), int):
        raise ValueError(f"{path.name} is no piece of a black box")
    return Piece(path, header)


def records(path: Path) -> Iterator[Start | Tick]:
    """Yield what a piece has, in its order, up to where its writing ended.

    Raises:
        OSError: It cannot be read.
        ValueError: Something else is in it.
    """
    with path.open("rb") as file:
        file.readline(65536)
        while len(head := file.read(4)) == 4:
            length = int.from_bytes(head, "big")
            block = file.read(length) if length <= BLOCK_BYTES else b""
            if len(block) < length or not length:
                return
            try:
                unpacking = zlib.decompressobj()
                content = io.BytesIO(unpacking.decompress(block, BLOCK_BYTES))
                if not unpacking.eof:
                    raise ValueError("a block is larger than any that is written, or cut")
                reading, end = Unpickler(content), len(content.getbuffer())
                while content.tell() < end:
                    record = reading.load()
                    if not isinstance(record, (Start, Tick)):
                        raise TypeError(f"{type(record).__name__} is no record")
                    yield record
            except Exception as error:  # whatever a file of somebody else's does to our values
                raise ValueError(f"{path.name}: {error}") from error


class Ring:
    """Pieces of the last minute, and incidents.

    Args:
        folder: Of one robot.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._ring, self._kept = folder / "ring", folder / "kept"
        self._pieces: deque[tuple[Path, int]] = deque()
        self._number = 0
        self._file: io.FileIO | None = None
        self.spare_bytes = SPARE_BYTES

    def open(self) -> Path | None:
        """Make the folders; return the incident that is kept of a process that ended without a word, if one did.

        Raises:
            OSError: They cannot be made.
        """
        self._own()
        for half in self._kept.glob(".*"):
            shutil.rmtree(half, ignore_errors=True)
        left = sorted(self._ring.glob(f"*{SUFFIX}"))
        found = None
        if left:
            self._pieces.extend((path, 0) for path in left)
            self._number = max((int(path.stem) for path in left if path.stem.isdecimal()), default=0)
            found = self.keep([("DIED", "the gateway's process ended without a word", 0)])
            self.clear()
        return found

    def _own(self) -> None:
        for folder in (self.folder.parent, self.folder, self._ring, self._kept)[self.folder.parent.name != ALL :]:
            own_folder(folder)

    def begin(self, header: Mapping[str, object], now_ns: int) -> None:
        """Begin a piece, at a monotonic time [ns].

        Raises:
            OSError: It cannot be written.
        """
        self.close()
        self._own()
        self._number += 1
        path = self._ring / f"{self._number:06d}{SUFFIX}"
        path.unlink(missing_ok=True)
        self._file = io.FileIO(os.open(path, NEW_FILE, 0o600), "w")
        self._pieces.append((path, now_ns))
        while len(self._pieces) > 2 and self._pieces[1][1] < now_ns - RING_NS:
            self._let_go()
        try:
            self._all(f"{json.dumps(dict(header))}\n".encode())
        except OSError:
            self.close()
            self._pieces.pop()[0].unlink(missing_ok=True)
            raise

    def write(self, packed: bytes) -> None:
        """Append records, as one block.

        Raises:
            OSError: The disk refuses, or has little left.
        """
        if self._file is None or not packed:
            return
        block = zlib.compress(packed, 1)
        self._all(len(block).to_bytes(4, "big") + block)
        while len(self._pieces) > 1 and _size(path for path, _ in self._pieces) > RING_BYTES:
            self._let_go()

    @property
    def is_full(self) -> bool:
        """Whether the present piece alone is as large as the ring may be: it can be followed only by a new one."""
        return self._file is not None and self._file.tell() > RING_BYTES

    def _all(self, content: bytes) -> None:
        if self._file is None:
            return
        if shutil.disk_usage(self._ring).free < self.spare_bytes:
            raise OSError(28, "little room is left on the disk")
        rest = memoryview(content)
        while rest:
            rest = rest[self._file.write(rest) or 0 :]

    def keep(self, causes: Sequence[tuple[str, str, int]], *, is_grave: bool = True) -> Path:
        """Keep what is in the ring now as an incident; return its folder, which is gone again where graver ones take the room.

        Args:
            causes: Code, message and monotonic time [ns] of what it is kept for, the first one first.
            is_grave: Whether something was latched, or a process died.

        Raises:
            OSError: It cannot be written.
        """
        second = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
        name = f"{second}-{re.sub(r'[^A-Z_]', '_', causes[0][0])}"
        names = itertools.chain((name,), (f"{name}-{number}" for number in itertools.count(2)))
        target = next(path for path in map(self._kept.joinpath, names) if not path.exists())
        half = self._kept / f".{name}"
        self._own()
        half.mkdir(mode=0o700)
        try:
            for number, (path, _) in enumerate(self._pieces):
                place = half / f"{number:02d}{SUFFIX}"
                if number < len(self._pieces) - 1 or self._file is None:  # else it is still being written
                    with contextlib.suppress(OSError):  # some file systems have none
                        os.link(path, place)
                if not place.exists():
                    try:
                        source = path.open("rb")
                    except FileNotFoundError:  # somebody deleted it: the others have what happened since, or before
                        continue
                    with source, open(os.open(place, NEW_FILE, 0o600), "wb") as copy:
                        shutil.copyfileobj(source, copy)
            note = [{"code": code, "message": message, "at_ns": at_ns} for code, message, at_ns in causes]
            head = {"form": 1, "kept": time.time_ns(), "is_grave": is_grave}
            text = json.dumps(head | {"causes": note}, ensure_ascii=False, indent=1)
            with open(os.open(half / "incident.json", NEW_FILE, 0o600), "w", encoding="utf-8") as file:
                file.write(text)
            for path in (*half.iterdir(), half):
                _sync(path)
            half.rename(target)
            _sync(self._kept)
        except OSError:
            shutil.rmtree(half, ignore_errors=True)
            raise
        kept = [path for path in self._kept.iterdir() if path.is_dir() and not path.name.startswith(".")]
        kept.sort(key=lambda at: (_is_grave(at), at.name[: len(second)] <= second, at == target, at.name))
        while len(kept) > 1 and (
            len(kept) > KEPT_INCIDENTS or _size(p for k in kept for p in k.iterdir()) > KEPT_BYTES
        ):
            shutil.rmtree(kept.pop(0), ignore_errors=True)
        return target

    def close(self) -> None:
        """Close the present piece."""
        if self._file is not None:
            file, self._file = self._file, None
            with file, contextlib.suppress(OSError):  # the piece has what reached the disk
                os.fsync(file.fileno())

    def clear(self) -> None:
        """Let all pieces go; incidents stay."""
        while self._pieces:
            self._let_go()

    def _let_go(self) -> None:
        self._pieces.popleft()[0].unlink(missing_ok=True)


def _is_grave(kept: Path) -> bool:
    try:
        return json.loads((kept / "incident.json").read_bytes())["is_grave"] is not False
    except (OSError, ValueError, LookupError, TypeError):  # one that does not say so may be
        return True


def _sync(path: Path) -> None:
    """Force a file, or the names in a folder, onto the disk, where its file system can."""
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno != errno.EINVAL:
            raise
    finally:
        os.close(handle)


def _size(paths: Iterator[Path]) -> int:
    return sum(path.stat().st_size for path in paths if path.exists())
