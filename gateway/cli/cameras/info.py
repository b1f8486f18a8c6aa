"""`ta2 video info`: what a recording holds, for people and, as JSON, for scripts. Nothing is decoded.

What stands in the file comes from the file, what happened on the way from the index beside it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from gateway.cli.terminal.ending import ExitStatus
from gateway.errors import Code, GatewayError, failure
from gateway.process.growing import is_growing
from gateway.video.decoding.libav import av
from gateway.video.recording.container import SUFFIXES, TROUBLE, ticks_of
from gateway.video.recording.index import Index, index_path, read_index
from gateway.video.recording.measures import Arrival, Stretch, Timing, arrival_of, stretches, timing_of

__all__ = ["Info", "info_of", "show_info"]

SHOWN = 10
"""So many damaged stretches have a line each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Info:
    """What a recording holds.

    Attributes:
        file: The recording.
        container: Its format.
        codec: Of its pictures.
        width: [pixels].
        height: [pixels].
        size_bytes: Of the file [bytes].
        bitrate_mbps: Mean [Mbit/s].
        timing: When its pictures stand.
        key_pictures: Of these, pictures that decoding can begin with.
        is_growing: Whether it is still being recorded.
        index: Its index; None when there is none, and nothing of what follows is known.
        robot: Where it came from; empty when anybody's pictures were taken.
        started: When its first picture arrived, ISO 8601, UTC.
        senders: How many there were: more than one, and a sender began anew.
        arrival: How the pictures arrived.
        damaged: Pictures that are not clean.
        stretches: Where they are.
        missing: Pictures of the stream, between its first and its last, of which nothing arrived.
        dropped: Pictures that arrived and that the recorder could not take.
        ended: Why it ended; empty when the recorder was killed, or goes on.
    """

    file: Path
    container: str
    codec: str
    width: int
    height: int
    size_bytes: int
    bitrate_mbps: float
    timing: Timing
    key_pictures: int
    is_growing: bool
    index: Path | None
    robot: str = ""
    started: str = ""
    senders: int = 0
    arrival: Arrival | None = None
    damaged: int = 0
    stretches: tuple[Stretch, ...] = ()
    missing: int = 0
    dropped: int = 0
    ended: str = ""


def info_of(recording: Path) -> Info:
    """Look into a recording.

    Args:
        recording: Its file, or that of a view that was split off.

    Raises:
        Rejected: BAD_REQUEST, there is none, or it cannot be read.
    """
    try:
        with recording.open("rb") as file:
            grows = is_growing(file)
        with av.open(str(recording)) as container:
            stream = container.streams.video[0]
            codec, width, height = stream.codec_context.name, stream.width, stream.height
            pts, keys = [], 0
            try:
                for packet in container.demux(stream):
                    if packet.pts is not None and packet.time_base is not None:
                        pts.append(ticks_of(packet.pts, packet.time_base))
                        keys += packet.is_keyframe
            except av.InvalidDataError:  # here it was cut off
                pass
        index = read_index(index_path(recording)) if index_path(recording).exists() else None
    except (*TROUBLE, IndexError) as error:  # without a stream, the latter
        raise _refused(recording, error) from error
    if not pts:
        raise _refused(recording, ValueError("there is no picture in it"))
    pts.sort()
    timing, size = timing_of(pts), recording.stat().st_size
    info = Info(
        file=recording,
        container=SUFFIXES.get(recording.suffix.lower(), recording.suffix),
        codec=codec,
        width=width,
        height=height,
        size_bytes=size,
        bitrate_mbps=size * 8e-6 / timing.duration_s if timing.duration_s else 0.0,
        timing=timing,
        key_pictures=keys,
        is_growing=grows,
        index=None,
    )
    return info if index is None else _with_index(info, index, set(pts))


def _with_index(info: Info, index: Index, pts: set[int]) -> Info:
    pictures = [picture for picture in index.pictures if picture.pts in pts]  # of a killed recorder, more are named
    dropped = sum(dropped.count for dropped in index.dropped)
    numbers = pictures[-1].seq - pictures[0].seq + 1 if pictures else 0
    return replace(
        info,
        index=index_path(info.file),
        robot="" if index.header is None else index.header.robot,
        started="" if index.header is None else index.header.started,
        senders=len({picture.life for picture in pictures}),
        arrival=arrival_of(pictures),
        damaged=sum(not picture.clean for picture in pictures),
        stretches=stretches(pictures),
        missing=max(0, numbers - len(pictures) - dropped),
        dropped=dropped,
        ended="" if index.end is None else index.end.why,
    )


def show_info(recording: Path, *, as_json: bool) -> ExitStatus:
    """Print it.

    Raises:
        Rejected: BAD_REQUEST, there is none, or it cannot be read.
    """
    info = info_of(recording)
    print(json.dumps(asdict(info), indent=2, default=str) if as_json else "\n".join(lines(info)))
    return ExitStatus.OK


def lines(info: Info) -> Iterator[str]:
    """Yield what a person reads."""
    timing = info.timing
    grows = ", still being recorded" if info.is_growing else ""
    yield _row("file", f"{info.file}, {info.size_bytes / 1e6:.1f} MB{grows}")
    yield _row("pictures", f"{timing.pictures} of {info.width} x {info.height}, {info.key_pictures} key pictures")
    yield _row("coded", f"{info.codec} in {info.container}, {info.bitrate_mbps:.1f} Mbit/s")
    yield _row("duration", f"{timing.duration_s:.3f} s, {timing.fps:.3f} fps measured")
    yield _row(
        "intervals",
        f"usually {timing.interval_p50_ms:.2f} ms, p99 {timing.interval_p99_ms:.2f}, at most {timing.interval_max_ms:.2f}, "
        f"jitter {timing.jitter_ms:.3f}",
    )
    if info.index is None:
        yield _row("damage", "unknown: there is no index beside it")
        return
    yield _row("from", f"{info.robot or 'anybody'}, {info.started}{_again(info.senders)}")
    if info.arrival is not None:
        yield _row(
            "arrival",
            f"jitter {info.arrival.jitter_ms:.2f} ms, p99 {info.arrival.spread_ms:.1f} ms behind the quickest",
        )
    yield _row("missing", f"{info.missing} of which nothing arrived, {info.dropped} that the recorder had to drop")
    yield _row("damage", f"{info.damaged} of {timing.pictures} pictures" if info.damaged else "none")
    for stretch in info.stretches[:SHOWN]:
        yield _row(
            "",
            f"{stretch.first_s:.3f} to {stretch.last_s:.3f} s: {stretch.pictures}, {stretch.lost_packets} packets lost",
        )
    if len(info.stretches) > SHOWN:
        yield _row("", f"and {len(info.stretches) - SHOWN} more stretches: --json lists all")
    if not info.is_growing:
        yield _row("ended", info.ended or "the recorder was killed; what is above is what it left")


def _again(senders: int) -> str:
    return f", began anew {senders - 1} times" if senders > 1 else ""


def _row(name: str, value: str) -> str:
    return f"{name:<10} {value}"


def _refused(recording: Path, error: Exception) -> GatewayError:
    hint = "name a file that `ta2 video record` or `ta2 video split` wrote"
    return failure(Code.BAD_REQUEST, f"{recording} cannot be read: {error}", field="file", hint=hint)
