"""Splits a recording into the six views of the manual (§5.2), each a file of its own with the recording's exact times.

```
take.mkv, take.mkv.jsonl   ->   take/head_right_eye.mp4 ... take/left_wrist_right_eye.mp4, take/damaged.json
```

A recording that is still being written is followed until it ends.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from gateway.errors import Code, GatewayError, failure
from gateway.process.growing import Growing
from gateway.video.decoding.libav import Flags, av
from gateway.video.decoding.views import VIEWS
from gateway.video.hevc.access_unit import CLOCK_HZ
from gateway.video.recording.coding import Coding
from gateway.video.recording.container import TROUBLE, ticks_of
from gateway.video.recording.index import index_path, read_index
from gateway.video.recording.view_files import ViewFiles, view_paths

__all__ = ["DAMAGED", "Damaged", "Split", "Splitter", "decoded_pictures", "split_folder"]

DAMAGED = "damaged.json"
"""Beside the views: which of their pictures are damaged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Damaged:
    """A picture to be careful with.

    Attributes:
        pts: Where it stands, in all files [ticks of CLOCK_HZ].
        time_s: The same [s].
        is_intact: Whether it only refers to one that is damaged.
        is_there: Whether it could be decoded at all.
        lost: Ranges of RTP sequence numbers that were lost in it or before it.
    """

    pts: int
    time_s: float
    is_intact: bool
    is_there: bool
    lost: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Split:
    """What came of it.

    Attributes:
        recording: Which one.
        files: Of each view.
        pictures: In each file.
        left_out: Pictures of another size than the first.
        duration_s: From the first picture to the last [s].
        damaged: Pictures to be careful with; None when the recording has no index, so that nobody knows.
        is_whole: Whether it reached the end.
    """

    recording: Path
    files: dict[str, Path]
    pictures: int
    left_out: int
    duration_s: float
    damaged: tuple[Damaged, ...] | None
    is_whole: bool


def split_folder(recording: Path) -> Path:
    """Return the folder that a recording is split into unless another is named."""
    return recording.with_suffix("")


class Splitter:
    """Splits one recording.

    The folder is made if need be; `prepare` is called first in each thread that computes.

    Raises:
        Rejected: BAD_REQUEST, there is no such recording or view, or a file is in the way.
    """

    def __init__(
        self,
        recording: Path,
        folder: Path,
        views: Sequence[str] = VIEWS,
        coding: Coding | None = None,
        prepare: Callable[[], None] = lambda: None,
    ) -> None:
        self._recording = recording
        self._folder = folder
        self._paths = view_paths(folder, views)
        self._coding = coding or Coding()
        self._prepare = prepare
        self._end = threading.Event()
        self._written: list[int] = []
        self._sound: set[int] = set()
        self._left_out = 0
        if not recording.is_file():
            raise _refused(recording, "is no recording: there is no such file", "`ta2 video record` makes one")

    @property
    def position_ticks(self) -> int:
        """Where the newest picture that was split stands [ticks of CLOCK_HZ]; -1 before the first."""
        return self._written[-1] if self._written else -1

    @property
    def pictures(self) -> int:
        """How many have been split."""
        return len(self._written)

    def cancel(self) -> None:
        """End soon, from any thread or signal handler: the files end well, with what is in them."""
        self._end.set()

    def run(self) -> Split:
        """Split it; return when the recording has ended and all is written.

        Raises:
            Rejected: BAD_REQUEST, it cannot be decoded, or a file cannot be written.
        """
        self._prepare()
        self._folder.mkdir(parents=True, exist_ok=True)
        files = ViewFiles(self._paths, self._coding, self._prepare)
        try:
            try:
                for picture, pts in decoded_pictures(self._recording, self._end.is_set, with_corrupt=True):
                    if not picture.is_corrupt:
                        self._sound.add(pts)
                    if files.write(picture, pts):
                        self._written.append(pts)
                    else:
                        self._left_out += 1
                    if self._end.is_set():
                        break
            finally:
                files.close()
            if not self._written:
                raise ValueError("no picture of it can be decoded")
        except TROUBLE as error:
            raise _refused(
                self._recording, f"cannot be split into {self._folder}: {error}", "look at `ta2 video info`"
            ) from error
        split = self._outcome()
        (self._folder / DAMAGED).write_text(json.dumps(asdict(split), indent=1, default=str) + "\n")
        return split

    def _outcome(self) -> Split:
        is_whole = not self._end.is_set()
        try:
            index = read_index(index_path(self._recording)).pictures
            there = set(self._written)
            damaged: tuple[Damaged, ...] | None = tuple(
                Damaged(
                    pts=one.pts,
                    time_s=round(one.pts / CLOCK_HZ, 6),
                    is_intact=one.intact,
                    is_there=one.pts in there,
                    lost=one.lost,
                )
                for one in index
                if (is_whole or one.pts <= self.position_ticks) and not (one.clean and one.pts in self._sound)
            )
        except FileNotFoundError:
            damaged = None
        return Split(
            recording=self._recording,
            files=self._paths,
            pictures=self.pictures,
            left_out=self._left_out,
            duration_s=max(self.position_ticks - self._written[0], 0) / CLOCK_HZ if self._written else 0.0,
            damaged=damaged,
            is_whole=is_whole,
        )


def decoded_pictures(
    recording: Path, is_cancelled: Callable[[], bool] = lambda: False, *, with_corrupt: bool = False
) -> Generator[tuple[av.VideoFrame, int], None, None]:
    """Yield what can be decoded of a recording, each with where it stands [ticks of CLOCK_HZ]; one that grows to its end.

    Args:
        recording: Its file.
        is_cancelled: Whether to wait no longer for it to grow.
        with_corrupt: Whether pictures come that are predicted from one that is missing, too. Without, none comes from there
            to the next key picture, and where none follows none to the end.

    Raises:
        OSError, av.FFmpegError: It cannot be read.
    """
    file = Growing(recording, is_cancelled)
    try:
        with av.open(file, "r") as container, _flushed(container) as stream:
            if with_corrupt:
                stream.codec_context.flags |= Flags.output_corrupt
            for packet in _readable(container.demux(stream)):
                for picture in _decodable(stream, packet):
                    if picture.pts is not None and picture.time_base is not None:
                        yield picture, ticks_of(picture.pts, picture.time_base)
    finally:
        file.close()


@contextmanager
def _flushed(container: Any) -> Iterator[Any]:  # noqa: ANN401  its type differs between releases of the wheel
    """Return the stream of a recording, and leave no decoder with pictures in it: dropping such a one can hang for ever."""
    stream = container.streams.video[0]
    stream.thread_type = "AUTO"
    try:
        yield stream
    finally:
        stream.codec_context.flush_buffers()


def _readable(packets: Iterator[av.Packet[Any]]) -> Iterator[av.Packet[Any] | None]:
    """Yield packets to the end, or to where the file was cut off, and None for what the decoder still holds."""
    try:
        yield from packets
    except av.InvalidDataError:
        yield None


def _decodable(stream: Any, packet: av.Packet[Any] | None) -> list[av.VideoFrame]:  # noqa: ANN401  as above
    """Return what a packet gives; nothing when it is damaged beyond decoding."""
    try:
        return list(stream.codec_context.decode(packet))
    except av.InvalidDataError:
        return []


def _refused(path: Path, message: str, hint: str) -> GatewayError:
    return failure(Code.BAD_REQUEST, f"{path} {message}", field="file", hint=hint)
