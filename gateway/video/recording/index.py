"""The index beside a recording: when every picture came, and which are damaged. JSON lines, written as they come.

```
take.mkv         the pictures as the robot sent them
take.mkv.jsonl   a header, then a line per picture (and per loss), then how it ended
```

A recorder that was killed leaves an index without its end, perhaps with half a line, a power cut one with rubbish there: what
is whole is read.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from gateway.video.hevc.access_unit import CLOCK_HZ

__all__ = ["Dropped", "End", "Header", "Index", "IndexWriter", "Line", "Picture", "index_path", "read_index"]


class Header(msgspec.Struct, frozen=True, kw_only=True, tag="header", tag_field="line"):
    """What was recorded, and by whom.

    Attributes:
        version: Of this format.
        file: Name of the recording.
        robot: Address the pictures came from; empty when anybody's were taken.
        ssrc: Of the first sender (RFC 3550 section 5.1).
        started: When the first picture arrived, ISO 8601, UTC.
        started_wall_ns: The same since 1970 [ns].
        started_ns: The same, monotonic, of the recording host [ns].
        clock_hz: Ticks per second of `pts` and `rtp_time`.
        codec: Of the pictures.
        width: [pixels].
        height: [pixels].
        versions: Of the software, by name.
    """

    version: int = 1
    file: str
    robot: str
    ssrc: int
    started: str
    started_wall_ns: int
    started_ns: int
    clock_hz: int = CLOCK_HZ
    codec: str = "hevc"
    width: int
    height: int
    versions: dict[str, str]


class Picture(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, tag="picture", tag_field="line"):
    """One picture in the recording.

    Attributes:
        n: Counts pictures of the recording, from 0.
        pts: Where it stands in it [ticks].
        seq: Counts pictures of the stream; a gap is pictures of which nothing arrived or that were dropped.
        rtp_time: RTP timestamp, unwrapped [ticks].
        life: Counts senders.
        ssrc: Of its sender.
        arrival_ns: When its first packet arrived, monotonic [ns].
        arrival_wall_ns: The same since 1970 [ns].
        size: [bytes].
        irap: Whether decoding can begin here.
        intact: Whether all of its own packets arrived.
        clean: Whether, besides, nothing that it is predicted from is damaged or missing.
        lost: Ranges of RTP sequence numbers (first, last) that were lost in it or since the one before.
    """

    n: int
    pts: int
    seq: int
    rtp_time: int
    life: int
    ssrc: int
    arrival_ns: int
    arrival_wall_ns: int
    size: int
    irap: bool = False
    intact: bool = True
    clean: bool = True
    lost: tuple[tuple[int, int], ...] = ()


class Dropped(msgspec.Struct, frozen=True, kw_only=True, tag="dropped", tag_field="line"):
    """Pictures that arrived and are not in the recording.

    Attributes:
        count: How many.
        why: In words.
    """

    count: int
    why: str


class End(msgspec.Struct, frozen=True, kw_only=True, tag="end", tag_field="line"):
    """How the recording ended.

    Attributes:
        why: In words.
        pictures: How many it holds.
        dropped: How many arrived after it began and are not in it.
    """

    why: str
    pictures: int
    dropped: int


Line = Header | Picture | Dropped | End
ENCODER: Final = msgspec.json.Encoder()
DECODER: Final = msgspec.json.Decoder(Line)


class Index(msgspec.Struct, frozen=True, kw_only=True):
    """A whole index, as read.

    Attributes:
        header: None when the recorder was killed before it wrote one.
        pictures: All that it names; of a killed recorder the last ones may be missing in the recording.
        dropped: Losses of the recorder itself.
        end: None when the recorder was killed, or still records.
    """

    header: Header | None
    pictures: tuple[Picture, ...]
    dropped: tuple[Dropped, ...]
    end: End | None


def index_path(recording: Path) -> Path:
    """Return where a recording's index is."""
    return recording.with_name(recording.name + ".jsonl")


class IndexWriter:
    """Writes an index, each line at once.

    Args:
        path: Of the index; there must be no such file.

    Raises:
        OSError: The file exists, or cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)

    def write(self, line: Line) -> None:
        """Append a line.

        Raises:
            OSError: It cannot be written.
        """
        self._file.write(ENCODER.encode(line) + b"\n")

    def close(self) -> None:
        """Close it."""
        self._file.close()


def read_index(path: Path) -> Index:
    """Read an index; half a line at its end is left out, and what a power cut made of its last lines.

    Raises:
        FileNotFoundError: There is none.
        ValueError: A line is no line of an index, and the first one or one before others; the message says which.
    """
    header, end = None, None
    pictures, dropped = [], []
    for line in _lines(path):
        if isinstance(line, Header):
            header = line
        elif isinstance(line, Picture):
            pictures.append(line)
        elif isinstance(line, Dropped):
            dropped.append(line)
        else:
            end = line
    return Index(header=header, pictures=tuple(pictures), dropped=tuple(dropped), end=end)


def _lines(path: Path) -> Iterator[Line]:
    *whole, _half = path.read_bytes().split(b"\n")
    for number, text in enumerate(whole, 1):
        try:
            yield DECODER.decode(text)
        except ValueError as error:
            if number > 1 and not any(map(_is_line, whole[number:])):
                return  # torn here
            raise ValueError(f"{path}:{number} is no line of a recording's index: {error}") from None


def _is_line(text: bytes) -> bool:
    try:
        DECODER.decode(text)
    except ValueError:
        return False
    return True
