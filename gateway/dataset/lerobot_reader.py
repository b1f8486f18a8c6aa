"""A dataset that is read, in either of LeRobot's formats: what is written down about it, and its episodes in order."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gateway.dataset.lerobot_format import FORMATS, V30_EPISODES
from gateway.dataset.parquet import pyarrow, read
from gateway.dataset.series import Floats
from gateway.errors import Code, Refusal, failure, to_exception

__all__ = ["Dataset", "EpisodeRead", "labels_of", "names_of"]


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeRead:
    """An episode as it lies in a dataset.

    Attributes:
        number: From 0.
        rows: How many, as is written down.
        tasks: In words, as is written down.
        columns: Vectors, shape (n, dimensions), and numbers, shape (n,).
        stats: Per feature and statistic, as is written down.
        videos: By feature, the file and where the episode begins in it [s].
    """

    number: int
    rows: int
    tasks: tuple[str, ...]
    columns: dict[str, npt.NDArray[Any]]
    stats: dict[str, dict[str, Floats]]
    videos: dict[str, tuple[Path, float]]


def names_of(feature: Mapping[str, Any]) -> list[str]:
    """Return the names of a feature's dimensions; LeRobot's own robots map: `{"motors": [..]}`, or each to its place."""
    names = feature.get("names") or ()
    if not isinstance(names, dict):
        return list(map(str, names))
    return [str(name) for key, part in names.items() for name in (part if isinstance(part, list) else [key])]


def labels_of(feature: Mapping[str, Any], size: int, number: str = "{}") -> list[str]:
    """Return what to call each of so many dimensions: its name, or its number where there are not as many names."""
    names = names_of(feature)
    return names if len(names) == size else [number.format(n) for n in range(size)]


class Dataset:
    """An existing dataset.

    Args:
        folder: The one with `meta/info.json`.

    Raises:
        Rejected: BAD_REQUEST, it is none, or none of these formats; pyarrow is not installed.
    """

    def __init__(self, folder: Path) -> None:
        pyarrow("pyarrow")
        self.folder = folder
        try:
            self.info: dict[str, Any] = json.loads((folder / "meta/info.json").read_text(encoding="utf-8"))
            self.version = str(self.info["codebase_version"])
            self.fps = float(self.info["fps"])
            self.features: dict[str, dict[str, Any]] = dict(self.info["features"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            why = error.strerror if isinstance(error, OSError) else repr(error)
            message, hint = f"{folder} is no dataset of LeRobot: meta/info.json: {why}", "name the folder of a dataset"
            raise failure(Code.BAD_REQUEST, message, field="dataset", hint=hint) from error
        if self.version not in FORMATS:
            message = f"{folder} is of LeRobot's format {self.version}"
            refusal = Refusal(
                code=Code.BAD_REQUEST, message=message, field="dataset", value=self.version, bound=" or ".join(FORMATS)
            )
            raise to_exception(refusal)

    @property
    def cameras(self) -> list[str]:
        """Features that are videos."""
        return [name for name, feature in self.features.items() if feature["dtype"] == "video"]

    def tasks(self) -> dict[int, str]:
        """Return the tasks by their number.

        Raises:
            Exception: Whatever says that they cannot be read.
        """
        if self.version == "v2.1":
            return {row["task_index"]: row["task"] for row in self._lines("tasks")}
        table = read(self.folder / "meta/tasks.parquet").to_pydict()
        label = next(name for name in table if name != "task_index")
        return dict(zip(table["task_index"], table[label], strict=True))

    def total_stats(self) -> dict[str, dict[str, Floats]]:
        """Return the statistics of the whole dataset; none in v2.1, which keeps none.

        Raises:
            Exception: Whatever says that they cannot be read.
        """
        if self.version == "v2.1":
            return {}
        return _as_stats(json.loads((self.folder / "meta/stats.json").read_text(encoding="utf-8")))

    def episodes(self, only: Collection[int] | None = None) -> Iterator[EpisodeRead]:
        """Yield the episodes in order, or only those of some numbers.

        Raises:
            Exception: Whatever says that what comes next cannot be read.
        """
        yield from self._episodes_v21(only) if self.version == "v2.1" else self._episodes_v30(only)

    def readable(self, only: Collection[int] | None = None) -> Iterator[EpisodeRead]:
        """Yield the same as `episodes`.

        Raises:
            Rejected: BAD_REQUEST, what comes next cannot be read.
        """
        try:
            yield from self.episodes(only)
        except Exception as error:  # files of others: whatever a reader meets says that they cannot be read
            message, hint = f"{self.folder} cannot be read: {error!r}", "`ta2 dataset check` says what is wrong with it"
            raise failure(Code.BAD_REQUEST, message, field="dataset", hint=hint) from error

    def _lines(self, name: str) -> list[dict[str, Any]]:
        text = (self.folder / f"meta/{name}.jsonl").read_text(encoding="utf-8")
        return [json.loads(line) for line in text.splitlines() if line.strip()]

    def _episodes_v21(self, only: Collection[int] | None) -> Iterator[EpisodeRead]:
        stats = {row["episode_index"]: row["stats"] for row in self._lines("episodes_stats")}
        for row in self._lines("episodes"):
            number = row["episode_index"]
            if only is not None and number not in only:
                continue
            place = {"episode_chunk": number // self.info["chunks_size"], "episode_index": number}
            table = read(self.folder / self.info["data_path"].format(**place))
            videos = {
                name: (self.folder / self.info["video_path"].format(**place, video_key=name), 0.0)
                for name in self.cameras
            }
            yield self._episode(number, row["length"], row["tasks"], table, stats.get(number, {}), videos)

    def _episodes_v30(self, only: Collection[int] | None) -> Iterator[EpisodeRead]:
        opened: tuple[int, int] | None = None
        table: Any = None
        begin = 0
        for row in _pages(self.folder / V30_EPISODES):
            place = row["data/chunk_index"], row["data/file_index"]
            if place != opened:
                path = self.info["data_path"].format(chunk_index=place[0], file_index=place[1])
                opened, table, begin = place, read(self.folder / path), row["dataset_from_index"]
            if only is not None and row["episode_index"] not in only:
                continue
            stats: dict[str, dict[str, Any]] = {}
            for name, value in row.items():
                if name.startswith("stats/"):
                    _, feature, what = name.split("/", 2)
                    stats.setdefault(feature, {})[what] = value
            first = row["dataset_from_index"] - begin
            part = table.slice(first, row["dataset_to_index"] - row["dataset_from_index"])
            videos = {}
            for name in self.cameras:
                place = row[f"videos/{name}/chunk_index"], row[f"videos/{name}/file_index"]
                path = self.info["video_path"].format(video_key=name, chunk_index=place[0], file_index=place[1])
                videos[name] = (self.folder / path, float(row[f"videos/{name}/from_timestamp"]))
            yield self._episode(row["episode_index"], row["length"], row["tasks"], part, stats, videos)

    def _episode(
        self,
        number: int,
        rows: int,
        tasks: list[str],
        table: Any,  # noqa: ANN401
        stats: Mapping[str, Mapping[str, Any]],
        videos: dict[str, tuple[Path, float]],
    ) -> EpisodeRead:
        return EpisodeRead(
            number=number,
            rows=rows,
            tasks=tuple(tasks),
            columns={name: _array(table.column(name)) for name in table.column_names},
            stats=_as_stats(stats),
            videos=videos,
        )


def _pages(first: Path) -> list[dict[str, Any]]:
    """Return the rows of all files of a folder of folders: LeRobot writes more than one when there are many episodes."""
    files = sorted(first.parent.parent.glob("chunk-*/file-*.parquet")) or [first]
    return [row for file in files for row in read(file).to_pylist()]


def _array(column: Any) -> npt.NDArray[Any]:  # noqa: ANN401
    joined = column.combine_chunks()
    if not hasattr(joined.type, "list_size"):
        rows = joined.to_pylist()
        return (
            np.array(rows, dtype=np.float64)
            if rows and isinstance(rows[0], list)
            else joined.to_numpy(zero_copy_only=False)
        )
    return np.asarray(joined.flatten().to_numpy(zero_copy_only=False)).reshape(len(joined), joined.type.list_size)


def _as_stats(stats: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Floats]]:
    return {
        name: {what: np.asarray(values, dtype=np.float64) for what, values in one.items()}
        for name, one in stats.items()
    }
