"""`ta2 video split`: the six views of a recording as files, with a progress bar; Ctrl-C ends it with what it has."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from gateway.cli.terminal.ending import ExitStatus
from gateway.cli.terminal.progress import Teller, teller
from gateway.video.hevc.access_unit import CLOCK_HZ
from gateway.video.recording.coding import Coding
from gateway.video.recording.index import index_path, read_index
from gateway.video.recording.live_split import LiveSplit
from gateway.video.recording.split import DAMAGED, Split, Splitter, split_folder

__all__ = ["show_split"]

LOOK_S = 0.2


def show_split(
    recording: Path, folder: Path | None, views: Sequence[str], coding: Coding, *, as_json: bool
) -> ExitStatus:
    """Split a recording, and say what came of it.

    A recording that is still being written is followed to its end; without a folder the views go beside it.

    Raises:
        Rejected: BAD_REQUEST, there is no such recording or view, a file is in the way, or it cannot be decoded.
        KeyboardInterrupt: It was ended; the files hold what had been split.
    """
    split = LiveSplit(Splitter(recording, folder or split_folder(recording), views, coding))
    with teller() as tell:
        split.start()
        try:
            _follow(split, _length_s(recording), tell)
        except KeyboardInterrupt:
            split.cancel()
            split.wait(60.0)
            tell.say(f"ended at {split.position_s:.1f} s; what was split until then is playable")
            raise
    outcome = split.outcome()
    print(json.dumps(asdict(outcome), indent=2, default=str) if as_json else _line(outcome))
    return ExitStatus.OK


def _follow(split: LiveSplit, length_s: float | None, tell: Teller) -> None:
    began = time.monotonic()
    while not split.wait(LOOK_S):
        at_s = split.position_s
        speed = at_s / (time.monotonic() - began)
        of = "" if length_s is None else f" of {length_s:.1f}"
        tell.advance(
            "split",
            None if length_s is None else min(at_s / length_s, 1.0),
            f"{at_s:.1f}{of} s, {speed:.1f} x real time",
        )


def _length_s(recording: Path) -> float | None:
    """Return how long it is, as its index says; None when nobody knows, or it goes on."""
    try:
        index = read_index(index_path(recording))
    except (OSError, ValueError):
        return None
    return index.pictures[-1].pts / CLOCK_HZ or None if index.end is not None and index.pictures else None


def _line(split: Split) -> str:
    folder = next(iter(split.files.values())).parent
    if split.damaged is None:
        damaged = "damage unknown: the recording has no index"
    else:
        damaged = f"{len(split.damaged)} damaged, listed in {DAMAGED}" if split.damaged else "none damaged"
    left_out = f", {split.left_out} of another size left out" if split.left_out else ""
    return f"{folder}: {len(split.files)} views, {split.pictures} pictures each, {split.duration_s:.3f} s, {damaged}{left_out}"
