"""Videos as LeRobot keeps them: one file for each episode and camera (v2.1), or many episodes in one (v3.0, by remux)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import Any, Final

from gateway.dataset.videos import VideoFacts
from gateway.recording.bag_writer import needed

__all__ = ["VIDEO_MB", "JoinedVideo", "episode_pictures", "video_feature"]

VIDEO_MB: Final = 200
"""A file of v3.0 is not continued when it is larger."""
CLOCK_HZ: Final = 90_000


def video_feature(facts: VideoFacts, fps: float) -> dict[str, Any]:
    """Return the entry of a camera among the `features` of `info.json`."""
    return {
        "dtype": "video",
        "shape": [facts.height, facts.width, 3],
        "names": ["height", "width", "channels"],
        "info": {
            "video.height": facts.height,
            "video.width": facts.width,
            "video.codec": "h264",
            "video.pix_fmt": "yuv420p",
            "video.is_depth_map": False,
            "video.fps": int(fps) if float(fps).is_integer() else fps,
            "video.channels": 3,
            "has_audio": False,
        },
    }


class JoinedVideo:
    """The videos of one camera, one after the other in files that are not too large. Libraries: PyAV.

    `pattern` is of the files' paths in the folder, with `video_key`, `chunk_index` and `file_index`.
    """

    def __init__(self, folder: Path, pattern: str, camera: str, chunk: int, fps: float) -> None:
        self._folder, self._pattern, self._camera, self._chunk, self._fps = folder, pattern, camera, chunk, fps
        self._file = -1
        self._out: Any = None
        self._stream: Any = None
        self._like: tuple[Any, ...] = ()
        self._rows = self._size_bytes = 0

    def add(self, path: Path, begin_s: float, rows: int) -> Mapping[str, float]:
        """Append an episode's video, and return where it is: chunk, file, begin and end in it [s].

        Raises:
            OSError: A file cannot be read or written.
            ValueError: The picture at its begin does not stand alone.
        """
        with _opened(path) as source:
            stream = source.streams.video[0]
            context = stream.codec_context
            like = (context.width, context.height, bytes(context.extradata or b""))
            if self._out is None or like != self._like or self._size_bytes > VIDEO_MB * 1024**2:
                self._begin(stream, like)
            begin = Fraction(self._rows) / Fraction(self._fps)
            for packet in _packets(source, stream, begin_s, rows, self._fps):
                shift = round(begin / packet.time_base) - round(Fraction(begin_s) / packet.time_base)
                packet.pts, packet.dts = packet.pts + shift, (packet.pts if packet.dts is None else packet.dts) + shift
                packet.stream = self._stream
                self._size_bytes += packet.size
                self._out.mux(packet)
        self._rows += rows
        return {
            "chunk_index": self._file // self._chunk,
            "file_index": self._file % self._chunk,
            "from_timestamp": float(begin),
            "to_timestamp": float(Fraction(self._rows) / Fraction(self._fps)),
        }

    def _begin(self, stream: Any, like: tuple[Any, ...]) -> None:  # noqa: ANN401
        import av

        self.close()
        self._file += 1
        name = self._pattern.format(
            video_key=self._camera, chunk_index=self._file // self._chunk, file_index=self._file % self._chunk
        )
        path = self._folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        self._out = av.open(str(path), "w", format="mp4", options={"video_track_timescale": str(CLOCK_HZ)})
        self._stream = self._out.add_stream_from_template(stream)
        self._like, self._rows, self._size_bytes = like, 0, 0

    def close(self) -> None:
        """End the file that is being written, if any."""
        if self._out is not None:
            self._out.close()
            self._out = None


def episode_pictures(path: Path, begin_s: float, rows: int, fps: float) -> Iterator[Any]:
    """Yield an episode's pictures, decoded, in order: PyAV's frames.

    Raises:
        OSError: The file cannot be read.
        ValueError: The picture at its begin does not stand alone.
    """
    with _opened(path) as source:
        stream = source.streams.video[0]
        for packet in chain(_packets(source, stream, begin_s, rows, fps), [None]):
            yield from stream.codec_context.decode(packet)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a video; what FFmpeg says against it is an OSError."""
    av = needed("av", "video")
    try:
        with av.open(str(path)) as source:
            yield source
    except av.FFmpegError as error:
        raise OSError(f"{path}: {error}") from error


def _packets(source: Any, stream: Any, begin_s: float, rows: int, fps: float) -> Iterator[Any]:  # noqa: ANN401
    """Yield an episode's packets; the others of the file are of other episodes."""
    begin, half = Fraction(begin_s), 1 / Fraction(fps) / 2
    first, last = begin - half, begin + rows / Fraction(fps) - half
    source.seek(max(0, round(begin / stream.time_base)), stream=stream)
    is_begun = False
    for packet in source.demux(stream):
        if packet.dts is not None and packet.dts * stream.time_base >= last:
            return
        if packet.pts is not None and first <= packet.pts * stream.time_base < last:
            if not (is_begun or packet.is_keyframe):
                raise ValueError(
                    f"{source.name}: the picture at {begin_s:.3f} s does not stand alone: nothing is cut there"
                )
            is_begun = True
            yield packet
