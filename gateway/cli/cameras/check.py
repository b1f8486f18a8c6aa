"""`ta2 video check`: the video part of the manual's acceptance (§2.7.2), point by point, and why a point fails.

1. The first picture comes within 10 s.
2. Packets and pictures become more, every second for 10 s.
3. Six views are written, each with all the pictures.
4. The rate is measured.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from gateway.cli.cameras.info import Info, info_of
from gateway.cli.cameras.record import opened
from gateway.cli.terminal.ending import ExitStatus
from gateway.cli.terminal.progress import Teller, teller
from gateway.errors import GatewayError
from gateway.video.decoding.views import VIEWS
from gateway.video.recording.coding import Coding
from gateway.video.recording.split import Splitter

if TYPE_CHECKING:
    from gateway.video.recording.recorder import Recorder
    from gateway.video.video import Video

__all__ = ["NOMINAL_FPS", "Point", "Report", "check", "examined"]

NOMINAL_FPS = 45.0
"""What the robot sends, about (§5.1) [1/s]."""
FPS_TOLERANCE = 0.1
"""A measured rate that is further off is told; the manual sets no bound, so that no point fails by it (choice)."""
LOOK_S = 0.1
NO_IDEA = "nothing is known to be wrong: wait longer with --timeout"
NO_BEGINNING = "no picture came that a recording can begin with: an intact key picture with its parameter sets"


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One of the manual's points.

    Attributes:
        name: Of the point.
        ok: Whether it is met.
        found: What was found.
        why: What is wrong, and what to do; empty when it is met.
    """

    name: str
    ok: bool
    found: str
    why: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """What was found.

    Attributes:
        ok: Whether all points are met.
        points: Each of them.
        first_s: When the first picture was there, after the start [s]; None when none came.
        fps: Measured, by the sender's clock [1/s]; None when nothing was recorded.
        frames: Decoded.
        decoder: What decoded them.
        counts: What came and what was lost, by kind.
        findings: What is wrong with the stream, the worst first, whether or not a point fails by it.
        recording: What was recorded; None without.
        folder: Where recording and views are; None when they were not to be kept.
    """

    ok: bool
    points: tuple[Point, ...]
    first_s: float | None
    fps: float | None
    frames: int
    decoder: str
    counts: dict[str, int]
    findings: tuple[str, ...]
    recording: Info | None
    folder: Path | None


def check(video: Video, *, seconds: float, first_s: float, folder: Path | None, as_json: bool) -> ExitStatus:
    """Check the stream; return whether all points are met.

    Args:
        video: Not started yet.
        seconds: For how long packets and pictures are watched [s].
        first_s: Longest wait for the first picture [s].
        folder: For recording and views; None keeps nothing.
        as_json: Whether to print the report as JSON.

    Raises:
        Rejected: BAD_REQUEST, a file is in the way, or cannot be written.
        VideoError: The port is taken, or a thread failed.
    """
    report = examined(video, seconds=seconds, first_s=first_s, folder=folder)
    print(json.dumps(asdict(report), indent=2, default=str) if as_json else "\n".join(lines(report)))
    return ExitStatus.OK if report.ok else ExitStatus.REFUSED


def examined(video: Video, *, seconds: float, first_s: float, folder: Path | None) -> Report:
    """Return what is found; arguments and errors as of `check`."""
    with teller() as tell, _place(folder) as place:
        return _checked(video, seconds, first_s, place, tell, is_kept=folder is not None)


@contextmanager
def _place(folder: Path | None) -> Iterator[Path]:
    if folder is not None:
        yield folder
        return
    with tempfile.TemporaryDirectory(prefix="ta2-video-") as place:
        yield Path(place)


def _checked(video: Video, seconds: float, first_s: float, folder: Path, tell: Teller, *, is_kept: bool) -> Report:
    recorder = opened(folder / "check.mkv", video.receiver.settings)
    try:
        with video, recorder.taking(video.receiver):
            came_s = _first(video, first_s, tell)
            points = [_first_point(video, came_s, first_s)]
            points.append(_watched(video, seconds, tell, has_come=came_s is not None))
            findings, health = _words(video), video.health
    finally:
        recorder.stop()
    info = info_of(recorder.path) if recorder.counts.pictures else None
    points += [_split_point(recorder, folder, tell), _rate_point(info, findings)]
    return Report(
        ok=all(point.ok for point in points),
        points=tuple(points),
        first_s=came_s,
        fps=None if info is None else info.timing.fps,
        frames=health.reading.frames,
        decoder=health.decoder,
        counts=asdict(health.counts),
        findings=findings,
        recording=info,
        folder=folder if is_kept else None,
    )


def _first(video: Video, first_s: float, tell: Teller) -> float | None:
    """Return when the first picture was there [s]; None when none came in time."""
    began = time.monotonic()
    while (passed_s := time.monotonic() - began) < first_s:
        tell.advance("wait", passed_s / first_s, "for the first picture")
        if video.wait_frame(timeout=min(LOOK_S, first_s)) is not None:
            return time.monotonic() - began
    return None


def _first_point(video: Video, came_s: float | None, first_s: float) -> Point:
    name = f"first picture within {first_s:g} s"
    if came_s is not None:
        return Point(name=name, ok=True, found=f"after {came_s:.2f} s")
    packets = video.counts.packets
    return Point(
        name=name, ok=False, found=f"none; {packets} packets of the stream came", why=_words(video) or (NO_IDEA,)
    )


def _watched(video: Video, seconds: float, tell: Teller, *, has_come: bool) -> Point:
    """Return whether packets and pictures became more in each second."""
    name = f"packets and pictures become more, each second for {seconds:g} s"
    if not has_come:
        return Point(name=name, ok=False, found="not watched", why=("no picture came to begin with",))
    began = time.monotonic()
    samples = [_sample(video)]
    count = max(1, int(seconds))
    for number in range(1, count + 1):
        end = began + seconds * number / count
        while (rest_s := end - time.monotonic()) > 0:
            tell.advance(
                "watch",
                (number - rest_s * count / seconds) / count,
                f"{samples[-1][0]} packets, {samples[-1][1]} pictures",
            )
            time.sleep(min(LOOK_S, rest_s))
        samples.append(_sample(video))
    packets, frames = (samples[-1][n] - samples[0][n] for n in (0, 1))
    stuck = [
        f"no {what} in second {second}"
        for second, (before, after) in enumerate(pairwise(samples), 1)
        for what, old, new in zip(("packets", "pictures"), before, after, strict=True)
        if new <= old
    ]
    return Point(
        name=name,
        ok=not stuck,
        found=f"{packets} packets, {frames} pictures",
        why=(*stuck[:3], *_words(video)) if stuck else (),
    )


def _sample(video: Video) -> tuple[int, int]:
    return video.counts.packets, video.health.reading.frames


def _split_point(recorder: Recorder, folder: Path, tell: Teller) -> Point:
    name = f"{len(VIEWS)} views are written"
    counts = recorder.counts
    if not counts.pictures:
        return Point(name=name, ok=False, found="nothing was recorded", why=(recorder.error or NO_BEGINNING,))
    tell.advance("split", None, f"{counts.pictures} pictures")
    try:
        split = Splitter(recorder.path, folder, coding=Coding(is_live=True)).run()
        held = {view: info_of(path).timing.pictures for view, path in split.files.items()}
    except GatewayError as error:
        return Point(name=name, ok=False, found="none", why=(error.message, error.hint))
    short = [
        f"{view} has {count} pictures of {split.pictures}" for view, count in held.items() if count != split.pictures
    ]
    found = f"{len(held)} files, {split.pictures} pictures each"
    why = tuple(short) or ((recorder.error,) if recorder.error else ())
    return Point(name=name, ok=not why and split.pictures > 0, found=found, why=why)


def _rate_point(info: Info | None, findings: tuple[str, ...]) -> Point:
    name = "the rate is measured"
    if info is None or info.timing.pictures < 2:
        return Point(name=name, ok=False, found="too few pictures were recorded", why=findings[:1] or (NO_BEGINNING,))
    fps = info.timing.fps
    off = abs(fps / NOMINAL_FPS - 1) > FPS_TOLERANCE
    note = f", not about {NOMINAL_FPS:g} (§5.1)" if off else ""
    span_s = info.timing.duration_s
    return Point(name=name, ok=True, found=f"{fps:.2f} fps over {span_s:.1f} s{note}")


def _words(video: Video) -> tuple[str, ...]:
    return tuple(f"{finding.code}: {finding.message} -> {finding.hint}" for finding in video.why())


def lines(report: Report) -> Iterator[str]:
    """Yield what a person reads."""
    for point in report.points:
        yield f"{'ok  ' if point.ok else 'FAIL'} {point.name}: {point.found}"
        for why in point.why:
            yield f"       {why}"
    told = {why for point in report.points for why in point.why}
    for finding in report.findings:
        if finding not in told:
            yield f"note {finding}"
    if report.folder is not None:
        yield f"     recording and views: {report.folder}"
