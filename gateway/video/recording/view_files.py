"""The six views as files of their own: crops of the decoded composite, encoded side by side, each with the composite's times.

The crops are libavfilter's: it moves pointers into the composite and copies nothing. Encoders take turns on as many
threads as there are cores; while they work, the caller may decode the next picture.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

from gateway.errors import Code, failure
from gateway.video.decoding.libav import av
from gateway.video.decoding.views import VIEWS, pixel_box
from gateway.video.hevc.access_unit import CLOCK_HZ
from gateway.video.recording.coding import Coding

__all__ = ["ViewFiles", "view_paths"]

NOMINAL_HZ = 45
"""Pictures per second (§5.1), for players that ask the header; the pictures' own times are exact."""
TICK: Final = Fraction(1, CLOCK_HZ)
EIGHT_BIT: Final = ("yuv420p", "yuvj420p")
"""Pixel formats that the encoders take as they are; others are converted."""


def view_paths(folder: Path, views: Sequence[str]) -> dict[str, Path]:
    """Return each view's file, all of them free to be written.

    Raises:
        Rejected: BAD_REQUEST, there is no such view, or a file of that name is there.
    """
    unknown = [view for view in views if view not in VIEWS]
    if unknown or not views:
        message, hint = f"no view {', '.join(unknown) or 'at all'} to split off", f"there are {', '.join(VIEWS)}"
        raise failure(Code.BAD_REQUEST, message, field="views", hint=hint)
    paths = {view: folder / f"{view}.mp4" for view in views}
    for path in paths.values():
        if path.exists():
            hint = "name another folder with --out, or move it away: recordings are never overwritten"
            raise failure(Code.BAD_REQUEST, f"{path} is there", field="file", hint=hint)
    return paths


class ViewFiles:
    """Writes views into files."""

    def __init__(self, paths: dict[str, Path], coding: Coding, prepare: Callable[[], None] = lambda: None) -> None:
        self._paths = paths
        self._coding = coding
        self._pool = ThreadPoolExecutor(min(len(paths), os.cpu_count() or 1), "video-encoder", prepare)
        self._crops: _Crops | None = None
        self._views: list[_ViewFile] = []
        self._running: list[Future[None]] = []

    def write(self, picture: av.VideoFrame, pts: int) -> bool:
        """Append the next picture's views; return whether it has the size of the first one, else it is left out.

        Returns while they are being encoded.

        Args:
            picture: The composite, decoded; not changed by anybody from now on.
            pts: Where it stands [ticks of CLOCK_HZ].

        Raises:
            OSError: A file of a picture before could not be written.
        """
        if self._crops is None:
            self._crops = _Crops(picture, list(self._paths))
            for view, path in self._paths.items():
                x0, y0, x1, y1 = _even_box(view, picture.width, picture.height)
                self._views.append(_ViewFile(path, self._coding, picture, self._crops.format, x1 - x0, y1 - y0))
        if not self._crops.fits(picture):
            return False
        picture.pts, picture.time_base = pts, TICK
        crops = self._crops.cut(picture)
        self._wait()
        self._running = [self._pool.submit(view.write, crop) for view, crop in zip(self._views, crops, strict=True)]
        return True

    def close(self) -> None:
        """End the files; what was written is playable.

        Raises:
            OSError: A file could not be written to its end.
        """
        try:
            self._wait()
            self._running = [self._pool.submit(view.close) for view in self._views]
            self._wait()
        finally:
            self._pool.shutdown()

    def _wait(self) -> None:
        running, self._running = self._running, []
        errors = [error for error in (future.exception() for future in running) if error is not None]
        if errors:
            raise errors[0]


class _Crops:
    """Cuts views out of pictures of one size."""

    def __init__(self, first: av.VideoFrame, views: Sequence[str]) -> None:
        from av.filter import Graph

        self._size = first.width, first.height, first.format.name
        self.format = first.format.name if first.format.name in EIGHT_BIT else "yuv420p"
        graph = Graph()
        source = graph.add_buffer(width=first.width, height=first.height, format=first.format, time_base=TICK)
        split: Any = graph.add("split", str(len(views)))
        source.link_to(split)
        self._graph, self._source, self._sinks = graph, source, []
        for number, view in enumerate(views):
            x0, y0, x1, y1 = _even_box(view, first.width, first.height)
            crop = graph.add("crop", f"{x1 - x0}:{y1 - y0}:{x0}:{y0}")
            layout, sink = graph.add("format", self.format), graph.add("buffersink")
            split.link_to(crop, number, 0)
            crop.link_to(layout)
            layout.link_to(sink)
            self._sinks.append(sink)
        graph.configure()

    def fits(self, picture: av.VideoFrame) -> bool:
        return self._size == (picture.width, picture.height, picture.format.name)

    def cut(self, picture: av.VideoFrame) -> list[Any]:
        self._source.push(picture)
        return [sink.pull() for sink in self._sinks]


class _ViewFile:
    """One view's file."""

    def __init__(self, path: Path, coding: Coding, first: av.VideoFrame, layout: str, width: int, height: int) -> None:
        self._file = av.open(str(path), "w", format="mp4", options={"video_track_timescale": str(CLOCK_HZ)})
        stream: Any = self._file.add_stream(coding.encoder, rate=NOMINAL_HZ, options=coding.options)
        stream.width, stream.height, stream.pix_fmt = width, height, layout
        context = stream.codec_context
        context.time_base = TICK
        context.color_range, context.colorspace = first.color_range, first.colorspace
        self._stream = stream

    def write(self, crop: Any) -> None:  # noqa: ANN401  libavfilter's frames have no type in the wheel
        crop.pict_type = 0  # the encoder's own choice, not the robot's
        self._file.mux(self._stream.encode(crop))

    def close(self) -> None:
        try:
            self._file.mux(self._stream.encode(None))
        finally:
            self._file.close()


def _even_box(view: str, width: int, height: int) -> tuple[int, int, int, int]:
    """Return a view's box on the grid of the colour samples, which are half as dense; the robot's boxes are on it."""
    x0, y0, x1, y1 = (value // 2 * 2 for value in pixel_box(view, width, height))
    return x0, y0, x1, y1
