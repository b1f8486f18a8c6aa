"""Judges the videos of a dataset: every picture of every file is decoded, stands where its row says, and has a row."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from gateway.dataset.lerobot_reader import EpisodeRead
from gateway.dataset.series import Floats

__all__ = ["VideoCheck"]

TOLERANCE_S: Final = 1e-4
"""LeRobot takes the picture nearest to a row's time, and raises when it is further away [s]."""


class VideoCheck:
    """Decodes the files of one dataset, one after the other.

    Args:
        features: Of `info.json`.
        fps: Rows per second.
        has_own_files: Whether each episode has files of its own.
    """

    def __init__(self, features: Mapping[str, Mapping[str, Any]], fps: float, has_own_files: bool) -> None:
        self._features = features
        self._fps = fps
        self._has_own_files = has_own_files
        self._decoded: dict[str, tuple[Path, Floats, tuple[int, int]]] = {}
        """Per feature the file that was decoded last, the times of its pictures [s], and their height and width."""

    def faults(self, episode: EpisodeRead, rows: int) -> list[tuple[str, str]]:
        """Return what is wrong with an episode's videos: feature, and what it is."""
        return [(name, fault) for name in episode.videos for fault in self._of(name, episode, rows)]

    def _of(self, name: str, episode: EpisodeRead, rows: int) -> list[str]:
        path, begin_s = episode.videos[name]
        try:
            if name not in self._decoded or self._decoded[name][0] != path:
                self._decoded[name] = (path, *_decode(path))
        except Exception as error:  # noqa: BLE001  files of others: whatever a decoder meets is the finding
            return [f"{path.name} cannot be decoded: {error}"]
        _, times_s, size = self._decoded[name]
        found = []
        shape = self._features[name]["shape"]
        if list(size) != list(shape[:2]):
            found.append(f"pictures are {size[1]} x {size[0]}, written down is {shape[1]} x {shape[0]}")
        wanted = begin_s + np.arange(rows) / self._fps
        if not len(times_s):
            return [*found, f"{path.name} has no picture"]
        if self._has_own_files and len(times_s) > rows:
            found.append(f"{len(times_s)} pictures for {rows} rows")
        nearest = times_s[np.clip(np.searchsorted(times_s, wanted - 0.5 / self._fps), 0, len(times_s) - 1)]
        off = np.abs(nearest - wanted)
        if off.max() > TOLERANCE_S:
            row = int(np.argmax(off > TOLERANCE_S))
            found.append(f"no picture for row {row}: the nearest is {off[row] * 1e3:.2f} ms away")
        return found


def _decode(path: Path) -> tuple[Floats, tuple[int, int]]:
    import av

    with av.open(str(path)) as file:
        stream = file.streams.video[0]
        stream.thread_type = "AUTO"
        times = [picture.time for picture in file.decode(stream) if picture.time is not None]
        return np.array(sorted(times)), (stream.height, stream.width)
