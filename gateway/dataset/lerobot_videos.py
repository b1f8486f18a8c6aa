"""Videos as LeRobot keeps them: one file for each episode and camera (v2.1), or many episodes in one (v3.0, by remux)."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

from gateway.dataset.videos import VideoFacts

__all__ = ["VIDEO_MB", "JoinedVideo", "video_feature"]

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

    Args:
        folder: Of the dataset.
        pattern: Of the files' paths in it, with `video_key`, `chunk_index` and `file_index`.
        camera: Key of the camera's feature.
        chunk: Files in a folder.
        fps: Rows per second.
    """

    def __init__(self, folder: Path, pattern: str, camera: str, chunk: int, fps: float) -> None:
        self._folder, self._pattern, self._camera, self._chunk, self._fps = folder, pattern, camera, chunk, fps
        self._file = -1
        self._out: Any = None
        self._stream: Any = None
        self._like: tuple[Any, ...] = ()
        self._rows = self._size_bytes = 0

    def add(self, path: Path, rows: int) -> Mapping[str, float]:
        """Append an episode's video, and return where it is: chunk, file, begin and end in it [s]."""
        import av

        with av.open(str(path)) as source:
            stream = source.streams.video[0]
            context = stream.codec_context
            like = (context.width, context.height, bytes(context.extradata or b""))
            if self._out is None or like != self._like or self._size_bytes > VIDEO_MB * 1024**2:
                self._begin(stream, like)
            begin = Fraction(self._rows) / Fraction(self._fps)
            for packet in source.demux(stream):
                if packet.pts is None:
                    continue
                shift = round(begin / packet.time_base)
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
