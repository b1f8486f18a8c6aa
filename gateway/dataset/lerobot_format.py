"""LeRobot's two formats, v2.1 (openpi, LeRobot 0.3) and v3.0 (LeRobot from 0.4 on), from episodes that were built.

Both hold the same rows. v2.1 has a file for each episode, v3.0 many episodes in one. Layouts: LeRobot's public documentation.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from gateway.dataset.episode import INTEGERS, WholeEpisode, numbered
from gateway.dataset.layout import Layout
from gateway.dataset.lerobot_videos import VIDEO_MB, JoinedVideo, video_feature
from gateway.dataset.parquet import columns, pyarrow, write
from gateway.dataset.stats import Stats, merged, quantiles
from gateway.dataset.videos import VideoFacts

__all__ = ["CHUNK", "DATA_BYTES", "FORMATS", "Format", "features_of", "write_dataset"]

Format = Literal["v2.1", "v3.0"]
FORMATS: Final[tuple[Format, ...]] = ("v2.1", "v3.0")
CHUNK: Final = 1000
"""Files in a folder."""
DATA_MB: Final = 100
DATA_BYTES: Final = DATA_MB * 1024**2
"""A file of v3.0 holds no more of data, before compression [bytes]."""
V21_DATA: Final = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
V21_VIDEO: Final = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
V30_DATA: Final = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
V30_VIDEO: Final = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
V30_EPISODES: Final = "meta/episodes/chunk-000/file-000.parquet"

Columns = dict[str, npt.NDArray[np.generic]]


def write_dataset(
    folder: Path,
    version: Format,
    features: Mapping[str, Any],
    episodes: Iterable[WholeEpisode],
    fps: float,
    on_progress: Callable[[int], None] = lambda count: None,
    robot_type: str | None = "teleavatar",
) -> None:
    """Write a dataset.

    The folder exists, and there is at least one episode. Features and type of the robot are those of `info.json`.

    Raises:
        OSError: A file cannot be read or written.
        ValueError: A video cannot be cut where an episode begins.
    """
    tasks: dict[str, int] = {}
    cameras = [name for name, feature in features.items() if feature["dtype"] == "video"]
    writer = _V21(folder) if version == "v2.1" else _V30(folder, cameras, fps)
    count = first = 0
    for count, episode in enumerate(episodes, 1):
        whole, stats = numbered(episode.tables, fps, count - 1, first, tasks.setdefault(episode.task, len(tasks)))
        writer.add(count - 1, episode, whole, stats | episode.video_stats)
        first += len(whole["index"])
        on_progress(count)
    writer.finish(list(tasks))
    info = {
        "codebase_version": version,
        "robot_type": robot_type,
        "total_episodes": count,
        "total_frames": first,
        "total_tasks": len(tasks),
        "chunks_size": CHUNK,
        "fps": int(fps) if float(fps).is_integer() else fps,
        "splits": {"train": f"0:{count}"},
        **writer.info(count, len(cameras)),
        "features": dict(features),
    }
    _write_json(folder / "meta/info.json", info)


def features_of(layout: Layout, cameras: Mapping[str, VideoFacts], fps: float) -> dict[str, Any]:
    """Return the `features` of `info.json`: each vector, LeRobot's own columns, and each camera."""
    named: dict[str, Any] = {
        feature.name: {"dtype": "float32", "shape": [len(feature.names)], "names": list(feature.names)}
        for feature in layout.feature
    }
    own = {"timestamp": "float32", **dict.fromkeys(INTEGERS, "int64")}
    named |= {name: {"dtype": dtype, "shape": [1], "names": None} for name, dtype in own.items()}
    return named | {name: video_feature(one, fps) for name, one in cameras.items()}


class _V21:
    """A file of rows for each episode; what is known of episodes as JSON lines."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._episodes: list[dict[str, Any]] = []
        self._stats: list[dict[str, Any]] = []

    def add(self, number: int, episode: WholeEpisode, whole: Columns, stats: Mapping[str, Stats]) -> None:
        path = V21_DATA.format(episode_chunk=number // CHUNK, episode_index=number)
        write(columns(whole), self._folder / path)
        for name, (video, _) in episode.videos.items():
            place = V21_VIDEO.format(episode_chunk=number // CHUNK, episode_index=number, video_key=name)
            (self._folder / place).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(video, self._folder / place)
        self._episodes.append({"episode_index": number, "tasks": [episode.task], "length": len(whole["index"])})
        self._stats.append({"episode_index": number, "stats": _as_lists(stats)})

    def finish(self, tasks: Sequence[str]) -> None:
        lines = [{"task_index": number, "task": task} for number, task in enumerate(tasks)]
        for name, rows in (("tasks", lines), ("episodes", self._episodes), ("episodes_stats", self._stats)):
            path = self._folder / f"meta/{name}.jsonl"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("".join(json.dumps(row, ensure_ascii=False) + "\n" for row in rows), encoding="utf-8")

    def info(self, episodes: int, cameras: int) -> dict[str, Any]:
        chunks = -(-episodes // CHUNK)
        return {
            "total_videos": episodes * cameras,
            "total_chunks": chunks,
            "data_path": V21_DATA,
            "video_path": V21_VIDEO,
        }


class _V30:
    """Many episodes in a file of rows; what is known of episodes as a table."""

    def __init__(self, folder: Path, cameras: Iterable[str], fps: float) -> None:
        self._folder = folder
        self._videos = {name: JoinedVideo(folder, V30_VIDEO, name, CHUNK, fps) for name in cameras}
        self._waiting: list[Columns] = []
        self._size_bytes = 0
        self._file = 0
        self._rows: list[dict[str, Any]] = []
        self._stats: list[Mapping[str, Stats]] = []
        self._all: dict[str, list[npt.NDArray[np.generic]]] = {}

    def add(self, number: int, episode: WholeEpisode, whole: Columns, stats: Mapping[str, Stats]) -> None:
        size_bytes = sum(table.nbytes for table in whole.values())
        if self._waiting and self._size_bytes + size_bytes > DATA_BYTES:
            self._close_file()
        self._waiting.append(whole)
        self._size_bytes += size_bytes
        self._stats.append(stats)
        for name, table in whole.items():
            self._all.setdefault(name, []).append(table)
        first, rows = int(whole["index"].flat[0]), len(whole["index"])
        self._rows.append(
            {
                "episode_index": number,
                "tasks": [episode.task],
                "length": rows,
                "data/chunk_index": self._file // CHUNK,
                "data/file_index": self._file % CHUNK,
                "dataset_from_index": first,
                "dataset_to_index": first + rows,
                **{
                    f"videos/{name}/{what}": value
                    for name, (video, begin_s) in episode.videos.items()
                    for what, value in self._videos[name].add(video, begin_s, rows).items()
                },
                **{
                    f"stats/{name}/{what}": values.tolist()
                    for name, one in _with_quantiles(stats, {key: [table] for key, table in whole.items()}).items()
                    for what, values in one.items()
                },
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
            }
        )

    def _close_file(self) -> None:
        joined = {name: np.concatenate([whole[name] for whole in self._waiting]) for name in self._waiting[0]}
        path = V30_DATA.format(chunk_index=self._file // CHUNK, file_index=self._file % CHUNK)
        write(columns(joined), self._folder / path)
        self._waiting, self._size_bytes, self._file = [], 0, self._file + 1

    def finish(self, tasks: Sequence[str]) -> None:
        self._close_file()
        for video in self._videos.values():
            video.close()
        pa = pyarrow("pyarrow")
        write(pa.Table.from_pylist(self._rows), self._folder / V30_EPISODES)
        table = pa.table({"task_index": pa.array(range(len(tasks)), pa.int64()), "task": list(tasks)})
        write(table, self._folder / "meta/tasks.parquet", index="task")
        every = {name: merged([stats[name] for stats in self._stats]) for name in self._stats[0]}
        _write_json(self._folder / "meta/stats.json", _as_lists(_with_quantiles(every, self._all)))

    def info(self, episodes: int, cameras: int) -> dict[str, Any]:
        del episodes, cameras
        return {
            "data_files_size_in_mb": DATA_MB,
            "video_files_size_in_mb": VIDEO_MB,
            "data_path": V30_DATA,
            "video_path": V30_VIDEO,
        }


def _with_quantiles(
    stats: Mapping[str, Stats], tables: Mapping[str, Sequence[npt.NDArray[np.generic]]]
) -> dict[str, Stats]:
    return {name: one | quantiles(tables[name]) if name in tables else one for name, one in stats.items()}


def _as_lists(stats: Mapping[str, Stats]) -> dict[str, dict[str, list[float] | list[int]]]:
    return {
        name: {what: [int(values[0])] if what == "count" else values.tolist() for what, values in one.items()}
        for name, one in stats.items()
    }


def _write_json(path: Path, value: Any) -> None:  # noqa: ANN401
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value, indent=4, ensure_ascii=False) + "\n", encoding="utf-8")
