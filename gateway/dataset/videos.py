"""Videos of episodes: the views of a recording of the robot's cameras, a picture for each row, encoded for training.

    take.mkv, take.mkv.jsonl, rows -> episode-0000.head_camera.mp4 ...

Of the pictures the last one counts that had arrived by a row's time and is not damaged. What cannot be decoded is found while
it is decoded: a hole that is longer than `STALE_NS` breaks that off, and rows are chosen anew of what can be. Libraries: PyAV,
through `gateway.video`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import numpy.typing as npt

from gateway.dataset.series import Instants
from gateway.dataset.stats import Stats
from gateway.errors import Code, GatewayError, failure
from gateway.recording.bag_writer import needed

__all__ = [
    "IMAGES",
    "STALE_NS",
    "PicturesMissing",
    "VideoFacts",
    "VideoSource",
    "decodable",
    "video_source",
    "write_videos",
]

IMAGES: Final = "observation.images."
STALE_NS: Final = 200_000_000
"""A picture that is older is none: a camera sends nine in that time (manual §5.1)."""
GOP: Final = 2
"""Every second picture stands alone, as LeRobot has it: a training loads rows in any order."""
LEAST_SAMPLES: Final = 100
THINNED: Final = 4
"""Of so many pixels in each direction one counts for statistics."""


class PicturesMissing(Exception):
    """Rows have no picture: so many cannot be decoded that the newest one is too old."""


class VideoFacts(msgspec.Struct, frozen=True, kw_only=True):
    """What is known of an episode's video: size [pixels], and statistics per colour, 0..1."""

    height: int
    width: int
    stats: dict[str, list[float]]

    @property
    def as_stats(self) -> Stats:
        """Statistics as LeRobot has them: shape (3, 1, 1), and how many pictures they are of."""
        return {
            name: np.array(values) if name == "count" else np.array(values).reshape(3, 1, 1)
            for name, values in self.stats.items()
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoSource:
    """A recording of the cameras.

    Attributes:
        path: Of its file, or of a bag.
        times_ns: When each undamaged picture arrived [ns since 1970, recording host], ascending.
        pts: Where each stands [ticks]; in a bag, which message of its topic it is.
        views: Which view of it each camera is.
        topic: Of a bag; empty for a file.
        decoded: Yields what can be decoded, and where each stands.
    """

    path: Path
    times_ns: Instants
    pts: Instants
    views: Mapping[str, str]
    topic: str = ""
    decoded: Callable[[], Generator[tuple[Any, int], None, None]]


def video_source(path: Path, views: Mapping[str, str]) -> VideoSource:
    """Return a recording of `ta2 video record`.

    Raises:
        Rejected: BAD_REQUEST, it has no index, which tells when its pictures came, or no undamaged picture.
    """
    needed("av", "video")
    from gateway.video.recording.index import index_path, read_index
    from gateway.video.recording.split import decoded_pictures

    try:
        pictures = [picture for picture in read_index(index_path(path)).pictures if picture.clean]
    except (OSError, ValueError) as error:
        raise _refused(f"{path} has no index that can be read: {error}", "record with `ta2 video record`") from error
    if not pictures:
        raise _refused(f"{path} has no undamaged picture", "look at `ta2 video info`")
    times = np.array([picture.arrival_wall_ns for picture in pictures], dtype=np.int64)
    is_new = np.append(True, np.maximum.accumulate(times)[:-1] < times[1:])
    pts = np.array([picture.pts for picture in pictures], dtype=np.int64)
    return VideoSource(
        path=path, times_ns=times[is_new], pts=pts[is_new], views=views, decoded=partial(decoded_pictures, path)
    )


def decodable(source: VideoSource) -> VideoSource:
    """Return what of a recording can be decoded, by decoding all of it.

    Raises:
        Rejected: BAD_REQUEST, nothing can, or it cannot be read to its end.
    """
    from gateway.video.recording.container import TROUBLE

    try:
        is_there = np.isin(source.pts, [pts for _, pts in source.decoded()])
    except TROUBLE as error:
        raise _unusable(source, error) from error
    if not is_there.any():
        raise _unusable(source, "no picture of it can be decoded")
    return replace(source, times_ns=source.times_ns[is_there], pts=source.pts[is_there])


def write_videos(
    source: VideoSource,
    episodes: Sequence[tuple[Instants, Mapping[str, Path]]],
    fps: float,
    on_progress: Callable[[float], None] = lambda share: None,
) -> list[dict[str, VideoFacts]]:
    """Write the videos of episodes.

    Episodes are in order of time: the times of their rows [ns], each with a picture, and each camera's file.

    Returns:
        What is known of each episode's videos, by camera.

    Raises:
        PicturesMissing: Too many cannot be decoded: choose rows by what `decodable` leaves.
        Rejected: BAD_REQUEST, the recording cannot be read, or a file cannot be written.
    """
    from gateway.video.hevc.access_unit import CLOCK_HZ
    from gateway.video.recording.coding import Coding
    from gateway.video.recording.container import TROUBLE
    from gateway.video.recording.view_files import ViewFiles

    pictures, found, written, views = _Pictures(source), [], 0, source.views
    coding = Coding(gop=GOP, threads=1, is_repeatable=True)
    total = sum(len(times_ns) for times_ns, _ in episodes)
    try:
        for times_ns, files in episodes:
            chosen = source.pts[np.searchsorted(source.times_ns, times_ns, side="right") - 1]
            sampled = _sampled(len(times_ns))
            sums = {camera: _Sums() for camera in views}
            out = ViewFiles({view: files[camera] for camera, view in views.items()}, coding)
            try:
                for row, (pts, at_ns) in enumerate(zip(chosen.tolist(), times_ns.tolist(), strict=True)):
                    picture = pictures.at(pts, at_ns)
                    if not out.write(picture, round(row * CLOCK_HZ / fps)):
                        raise ValueError(f"a picture is of another size than the first one: {picture}")
                    if row in sampled:
                        _add(sums, views, picture)
                    written += 1
                    if written % 50 == 0:
                        on_progress(written / total)
            finally:
                out.close()
            found.append({camera: sums[camera].facts() for camera in views})
    except (*TROUBLE, ValueError) as error:
        raise _unusable(source, error) from error
    finally:
        pictures.close()
    on_progress(1.0)
    return found


class _Pictures:
    """Decodes forwards, and gives the undamaged picture at a place, or the last before it that can be decoded."""

    def __init__(self, source: VideoSource) -> None:
        self._times_ns = dict(zip(source.pts.tolist(), source.times_ns.tolist(), strict=True))
        self._decoded = source.decoded()
        self._current: tuple[Any, int] = (None, -1)
        self._next: tuple[Any, int] | None = self._current  # before the first

    def at(self, pts: int, at_ns: int) -> Any:  # noqa: ANN401  a frame of PyAV's, of either of its releases
        while self._next is not None and self._next[1] <= pts:
            self._current = self._next
            self._next = next((one for one in self._decoded if one[1] in self._times_ns), None)
        picture, place = self._current
        if picture is None or at_ns - self._times_ns[place] > STALE_NS:
            raise PicturesMissing
        return picture

    def close(self) -> None:
        self._decoded.close()


@dataclass(slots=True)
class _Sums:
    """Of pictures, per colour: how many, size, least, most, sum of values and of squares."""

    count: int = 0
    pixels: int = 0
    height: int = 0
    width: int = 0
    least: Any = 1.0
    most: Any = 0.0
    total: Any = 0.0
    squares: Any = 0.0

    def add(self, view: npt.NDArray[np.uint8]) -> None:
        self.height, self.width = view.shape[:2]
        values = view[::THINNED, ::THINNED].reshape(-1, 3) / 255.0
        self.count, self.pixels = self.count + 1, self.pixels + len(values)
        self.least, self.most = np.minimum(self.least, values.min(axis=0)), np.maximum(self.most, values.max(axis=0))
        self.total, self.squares = self.total + values.sum(axis=0), self.squares + (values**2).sum(axis=0)

    def facts(self) -> VideoFacts:
        mean = self.total / self.pixels
        std = np.sqrt(np.maximum(self.squares / self.pixels - mean**2, 0.0))
        stats = {"min": self.least, "max": self.most, "mean": mean, "std": std}
        return VideoFacts(
            height=self.height,
            width=self.width,
            stats={name: values.tolist() for name, values in stats.items()} | {"count": [float(self.count)]},
        )


def _add(sums: Mapping[str, _Sums], views: Mapping[str, str], picture: Any) -> None:  # noqa: ANN401
    from gateway.video.decoding.views import view_of

    composite = picture.to_ndarray(format="rgb24")
    for camera, one in sums.items():
        one.add(view_of(composite, views[camera]))


def _sampled(rows: int) -> set[int]:
    """Return which rows' pictures count for statistics: evenly spread, LeRobot's number."""
    count = min(rows, max(LEAST_SAMPLES, round(rows**0.75)))
    return set(np.linspace(0, rows - 1, count).round().astype(int).tolist())


def _unusable(source: VideoSource, why: object) -> GatewayError:
    return _refused(f"{source.path} cannot be used: {why}", "look at `ta2 video info`")


def _refused(message: str, hint: str) -> GatewayError:
    return failure(Code.BAD_REQUEST, message, field="video", hint=hint)
