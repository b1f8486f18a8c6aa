"""An episode of a dataset while it is built: its tables, its task and where it comes from; kept in a file between steps."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
import numpy.typing as npt

from gateway.dataset.stats import Stats, of_table
from gateway.dataset.videos import VideoFacts

__all__ = ["INTEGERS", "EpisodeFacts", "WholeEpisode", "load_episode", "numbered", "store_episode", "video_files"]

INTEGERS: Final = ("frame_index", "episode_index", "index", "task_index")


class EpisodeFacts(msgspec.Struct, frozen=True, kw_only=True):
    """What is known of an episode beside its rows.

    Attributes:
        bag: Name of the bag's folder.
        number: Of the episode in the bag, from 1.
        begin_ns: Of its first row [ns since 1970, recording host].
        rows: How many.
        task: What is shown, in words.
        outcome: `success`, `failure`, or empty.
        covered: Per feature and part, the share of rows with a value, 0..1.
        sources: Per feature and part, the topic; empty where nothing of it was recorded.
        videos: By camera; empty without pictures.
    """

    bag: str
    number: int
    begin_ns: int
    rows: int
    task: str
    outcome: str
    covered: dict[str, tuple[float, ...]]
    sources: dict[str, tuple[str, ...]]
    videos: dict[str, VideoFacts] = {}


@dataclass(frozen=True, slots=True, kw_only=True)
class WholeEpisode:
    """An episode as a dataset takes it: columns but for `INTEGERS`, and by camera the file and where it begins there [s]."""

    task: str
    tables: dict[str, npt.NDArray[np.generic]]
    videos: dict[str, tuple[Path, float]]
    video_stats: dict[str, Stats]


def video_files(file: Path, cameras: Iterable[str]) -> dict[str, Path]:
    """Return where the videos of an episode are whose tables are in a file."""
    return {camera: file.with_suffix(f".{camera}.mp4") for camera in cameras}


def store_episode(file: Path, tables: dict[str, npt.NDArray[np.float32]]) -> None:
    """Write the tables of an episode."""
    np.savez(file, **tables)  # type: ignore[arg-type]  # its stub takes any table for `allow_pickle`


def load_episode(facts: EpisodeFacts, file: Path) -> WholeEpisode:
    """Return an episode with its tables, which are in a file."""
    with np.load(file) as stored:
        tables = {name: stored[name] for name in stored.files}
    videos = {camera: (path, 0.0) for camera, path in video_files(file, facts.videos).items()}
    stats = {camera: one.as_stats for camera, one in facts.videos.items()}
    return WholeEpisode(task=facts.task, tables=tables, videos=videos, video_stats=stats)


def numbered(
    tables: dict[str, npt.NDArray[np.generic]], fps: float, episode: int, first: int, task: int
) -> tuple[dict[str, npt.NDArray[np.generic]], dict[str, Stats]]:
    """Return all columns of an episode, LeRobot's own included, and the statistics of each.

    Args:
        tables: Its features; times among them stay as they are.
        fps: Rows per second: the times in a dataset are row / fps, exactly.
        episode: Its number in the dataset, from 0.
        first: Number of its first row in the dataset.
        task: Number of its task.
    """
    rows = len(next(iter(tables.values())))
    frames = np.arange(rows, dtype=np.int64)
    whole: dict[str, npt.NDArray[np.generic]] = {
        **tables,
        "timestamp": tables.get("timestamp", (frames / fps).astype(np.float32)),
        "frame_index": frames,
        "episode_index": np.full(rows, episode, dtype=np.int64),
        "index": frames + first,
        "task_index": np.full(rows, task, dtype=np.int64),
    }
    return whole, {name: of_table(table) for name, table in whole.items()}
