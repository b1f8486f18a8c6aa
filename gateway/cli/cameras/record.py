"""`ta2 video record`: the robot's pictures into a file, as they come; with `--split` into the six views as well.

Ends after a time, with Ctrl-C or SIGTERM, or when the disk is full; always well. A second Ctrl-C ends a split that goes on.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path

from gateway.cli.terminal.ending import ExitStatus, Interrupted
from gateway.cli.terminal.progress import Teller, teller
from gateway.errors import Code, GatewayError, failure
from gateway.video.errors import VideoCode, VideoTimeout
from gateway.video.hevc.access_unit import CLOCK_HZ
from gateway.video.receiving.receiver import Receiver, ReceiverSettings
from gateway.video.recording.coding import Coding
from gateway.video.recording.live_split import BEHIND_S, LiveSplit, be_nice
from gateway.video.recording.recorder import Recorder
from gateway.video.recording.split import Split, Splitter, split_folder

__all__ = ["Recorded", "default_path", "opened", "record"]

LOOK_S = 0.2
"""Progress is shown so often [s]."""
STALL_S = 3.0
"""When no picture comes for so long, it is said [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """What came of it.

    Attributes:
        ok: Whether it ended as it was asked to.
        file: The recording.
        pictures: In it.
        duration_s: From the first to the last [s].
        fps: Measured, by the sender's clock [1/s].
        size_bytes: Of its pictures [bytes].
        damaged: Pictures that are not clean.
        dropped: Pictures that the disk was too slow for.
        error: Why it ended by itself, or could not be split; empty when all went well.
        split: What came of the split; None without one.
    """

    ok: bool
    file: Path
    pictures: int
    duration_s: float
    fps: float
    size_bytes: int
    damaged: int
    dropped: int
    error: str
    split: Split | None


def default_path() -> Path:
    """Return where a recording goes that nobody has named: the current folder, by the time of now."""
    return Path(datetime.now().astimezone().strftime("ta2-%Y%m%d-%H%M%S.mkv"))


def record(
    settings: ReceiverSettings,
    path: Path,
    *,
    seconds: float | None,
    first_s: float,
    is_split: bool,
    as_json: bool,
) -> ExitStatus:
    """Record until told to stop.

    Without `seconds` it goes on until Ctrl-C; `first_s` is the longest wait for the first picture [s].

    Raises:
        Rejected: BAD_REQUEST, a file is in the way, or cannot be written.
        VideoError: The port is taken.
        VideoTimeout: No picture came that a recording can begin with.
    """
    with teller() as tell:
        recorder = opened(path, settings)
        ended: Interrupted | None = None
        live = None
        try:
            if is_split:
                splitter = Splitter(path, split_folder(path), coding=Coding(is_live=True), prepare=be_nice)
                live = LiveSplit(splitter)
            with Receiver(settings) as receiver, recorder.taking(receiver):
                ended = _until_interrupted(lambda: _follow(receiver, recorder, live, tell, seconds, first_s))
        finally:
            recorder.stop()
        split, trouble = None, recorder.error
        if live is not None and live.has_begun:
            if ended is not None:
                live.cancel()
            split, trouble = _finished(live, recorder, tell)
    counts = recorder.counts
    duration_s = max(counts.newest_pts, 0) / CLOCK_HZ
    recorded = Recorded(
        ok=not trouble and counts.pictures > 0,
        file=path,
        pictures=counts.pictures,
        duration_s=duration_s,
        fps=(counts.pictures - 1) / duration_s if duration_s else 0.0,
        size_bytes=counts.size,
        damaged=counts.damaged,
        dropped=counts.dropped,
        error=trouble,
        split=split,
    )
    _show(recorded, as_json=as_json)
    if ended is not None:
        raise ended
    return ExitStatus.OK if recorded.ok else ExitStatus.REFUSED


def opened(path: Path, settings: ReceiverSettings) -> Recorder:
    """Return a recorder that has claimed its file.

    Raises:
        Rejected: BAD_REQUEST, the file is there, or cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return Recorder(path, settings.source or "")
    except OSError as error:
        hint = "name another file with --out; recordings are never overwritten"
        message = f"{path} cannot be written: {error.strerror or error}"
        raise failure(Code.BAD_REQUEST, message, field="file", hint=hint) from error


def _until_interrupted(follow: Callable[[], None]) -> Interrupted | None:
    """Carry it out; return the signal that ended it, unless that was Ctrl-C, which is how a recording is ended."""
    try:
        follow()
    except Interrupted as end:
        return end
    except KeyboardInterrupt:
        pass
    return None


def _follow(
    receiver: Receiver, recorder: Recorder, live: LiveSplit | None, tell: Teller, seconds: float | None, first_s: float
) -> None:
    """Show how far the recording is, until it has its length or ends by itself."""
    began = rose = time.monotonic()
    is_behind, held = False, 0
    while not recorder.error:
        counts = recorder.counts
        now_s = max(counts.newest_pts, 0) / CLOCK_HZ
        if counts.pictures > held:
            held, rose = counts.pictures, time.monotonic()
        elif held and time.monotonic() - rose > STALL_S:
            rose = math.inf  # until pictures come again
            words = [f"{finding.message} -> {finding.hint}" for finding in receiver.why()[:1]]
            tell.say(f"no picture for {STALL_S:g} s; the recording goes on with the next one: {' '.join(words)}")
        if not counts.pictures:
            if time.monotonic() - began > first_s:
                raise _silence(receiver, recorder, first_s)
            tell.advance("record", None, "waiting for a picture to begin with")
        elif seconds is not None and now_s >= seconds:
            return
        else:
            text = f"{now_s:.1f} s, {counts.pictures} pictures, {counts.size / 1e6:.1f} MB, {counts.damaged} damaged"
            tell.advance("record", None if seconds is None else now_s / seconds, text)
        if live is not None and counts.pictures:
            if not live.has_begun:
                live.start()
            behind_s = now_s - live.position_s
            tell.advance("split", None, f"{behind_s:.1f} s behind")
            if behind_s > BEHIND_S and not is_behind:
                is_behind = True
                tell.say(
                    "this machine splits more slowly than it records: the rest is split afterwards, nothing is lost"
                )
        time.sleep(LOOK_S)


def _silence(receiver: Receiver, recorder: Recorder, first_s: float) -> VideoTimeout:
    findings, skipped = receiver.why(), recorder.counts.skipped
    what = f"no picture came in {first_s:g} s that a recording can begin with"
    if findings:
        return VideoTimeout(findings[0].code, f"{what}: {findings[0].message}", findings[0].hint)
    if skipped:
        hint = "wait longer with --timeout: the robot sends one at times, or when its video is started anew"
        return VideoTimeout(
            VideoCode.NO_KEYFRAME, f"{what}: none of {skipped} pictures was an intact key picture", hint
        )
    return VideoTimeout(VideoCode.NO_PACKETS, what, "see `ta2 video check`, and wait longer with --timeout")


def _finished(live: LiveSplit, recorder: Recorder, tell: Teller) -> tuple[Split | None, str]:
    """Wait for a split to end; a further Ctrl-C or SIGTERM ends it where it is. Return it, and what went wrong."""
    end_s = max(recorder.counts.newest_pts, 1) / CLOCK_HZ
    with _cancelling(live, tell, recorder.path):
        while not live.wait(LOOK_S):
            rest_s = max(0.0, end_s - live.position_s)
            tell.advance("split", live.position_s / end_s, f"{rest_s:.1f} s to go; Ctrl-C ends it here")
    try:
        return live.outcome(), recorder.error
    except GatewayError as error:
        return None, f"{recorder.error}{' and ' if recorder.error else ''}{error.message}"


@contextmanager
def _cancelling(live: LiveSplit, tell: Teller, path: Path) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        live.cancel()
        tell.say(f"the split ends at {live.position_s:.1f} s; all of it: ta2 video split {path} --out FOLDER")
        while not live.wait(LOOK_S):
            pass


def _show(recorded: Recorded, *, as_json: bool) -> None:
    if as_json:
        print(json.dumps(asdict(recorded), indent=2, default=str))
    elif recorded.pictures:
        print(
            f"{recorded.file}: {recorded.duration_s:.3f} s, {recorded.pictures} pictures at {recorded.fps:.2f} fps, "
            f"{recorded.size_bytes / 1e6:.1f} MB, {recorded.damaged} damaged, {recorded.dropped} dropped"
        )
        if recorded.split is not None:
            split = recorded.split
            print(
                f"{next(iter(split.files.values())).parent}: {len(split.files)} views, {split.pictures} pictures each"
            )
    if recorded.error:
        print(recorded.error, file=sys.stderr)
    elif not recorded.pictures:
        print("nothing was recorded", file=sys.stderr)
