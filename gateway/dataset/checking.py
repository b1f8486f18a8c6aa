"""Judges a dataset: are the counts true, are times exact, is every number one, do the statistics fit, does anything jump.

LeRobot checks some of this when it loads a dataset, most of it never; training on what is wrong fails without a word.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from gateway.dataset.lerobot_reader import Dataset, EpisodeRead, labels_of
from gateway.dataset.series import Floats
from gateway.dataset.stats import Stats, merged, of_table
from gateway.dataset.video_check import VideoCheck

__all__ = ["CheckedDataset", "DatasetFinding", "check_dataset"]

TOLERANCE_S: Final = 1e-4
"""LeRobot 0.3 refuses a dataset whose times are further off the grid [s] (its `check_timestamps_sync`)."""
JUMP_SHARE: Final = 0.25
"""A step of more than this part of all that a dimension does in an episode is a jump, if it is"""
JUMP_TIMES: Final = 10.0
"""so much larger than most of its steps."""
STEPS: Final = 0.9
"""Most."""
RELATIVE: Final = 1e-4
"""Statistics may differ by this from what is recomputed, relative to the size of the numbers."""
SINGLE: Final = float(np.finfo(np.float32).eps)
"""LeRobot adds up an episode's rows, and their squares, one by one in single precision: with n rows of at most x, its means may
be off by n of these times x/4, its variances by n times x² (measured: half and a third of that, where all rows are equal)."""
LEAST_SPAN: Final = 1e-3
"""What moves by less stands still [rad, m, N·m]."""
FEW_ROWS: Final = 30
SUMMED: Final = ("min", "max", "mean", "std")


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetFinding:
    """Something that is not as it should be: how bad, where (episode, feature), and what."""

    level: Literal["error", "warning"]
    where: str
    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedDataset:
    """What came of it: format, episodes and rows read, and findings, the worst first."""

    version: str
    episodes: int
    rows: int
    findings: list[DatasetFinding] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """Whether there is no error."""
        return not any(finding.level == "error" for finding in self.findings)


def check_dataset(dataset: Dataset, on_progress: Callable[[float], None] = lambda share: None) -> CheckedDataset:
    """Read a dataset and judge it.

    Args:
        dataset: It.
        on_progress: Called now and then with the part that was read, 0..1.
    """
    findings: list[DatasetFinding] = []
    episodes = rows = 0
    every: dict[str, list[Stats]] = {}
    expected = max(1, int(dataset.info.get("total_episodes", 1)))
    tasks: dict[int, str] = {}
    used: set[str] = set()
    videos = VideoCheck(dataset.features, dataset.fps, has_own_files=dataset.version == "v2.1")
    try:
        tasks = dataset.tasks()
        for episode in dataset.episodes():
            findings += _of_episode(dataset, episode, tasks, episodes, rows)
            length = len(next(iter(episode.columns.values()), ()))
            findings += [
                _error(f"episode {episode.number}: {name}", text) for name, text in videos.faults(episode, length)
            ]
            for name, column in episode.columns.items():
                if len(column) and column.size == _size(dataset.features.get(name, {})) * len(column):
                    every.setdefault(name, []).append(of_table(column))
            used |= set(episode.tasks)
            episodes, rows = episodes + 1, rows + length
            on_progress(min(1.0, episodes / expected))
        findings += _of_totals(dataset.total_stats(), every)
    except Exception as error:  # noqa: BLE001  files of others: whatever a reader meets is the finding
        findings.append(_error(f"after episode {episodes - 1}" if episodes else "", f"cannot be read: {error!r}"))
    findings += _of_dataset(dataset, episodes, rows, tasks, used)
    findings += _constant(dataset, every)
    findings.sort(key=lambda finding: finding.level != "error")
    return CheckedDataset(version=dataset.version, episodes=episodes, rows=rows, findings=findings)


def _size(feature: Mapping[str, Any]) -> int:
    """Return the number of a feature's dimensions; 0 for none."""
    return int(np.prod(feature.get("shape", 0)))


def _error(where: str, message: str) -> DatasetFinding:
    return DatasetFinding(level="error", where=where, message=message)


def _warning(where: str, message: str) -> DatasetFinding:
    return DatasetFinding(level="warning", where=where, message=message)


def _of_dataset(
    dataset: Dataset, episodes: int, rows: int, tasks: Mapping[int, str], used: set[str]
) -> Iterator[DatasetFinding]:
    for name, count in (("total_episodes", episodes), ("total_frames", rows), ("total_tasks", len(tasks))):
        if dataset.info.get(name) != count:
            yield _error("meta/info.json", f"{name} is {dataset.info.get(name)}, there are {count}")
    if not rows:
        yield _error("", "it has no row")
    unused = set(tasks.values()) - used if episodes == dataset.info.get("total_episodes") else set()
    for task in sorted(unused):
        yield _warning("", f"no episode has the task {task!r}")
    if used & {""}:
        yield _warning("", "an episode has no task in words: policies that read a prompt learn nothing from it")


def _of_episode(
    dataset: Dataset, episode: EpisodeRead, tasks: Mapping[int, str], number: int, first: int
) -> Iterator[DatasetFinding]:
    where = f"episode {episode.number}"
    if episode.number != number:
        yield _error(where, f"stands where episode {number} is to stand")
    for name, feature in dataset.features.items():
        if feature["dtype"] in ("video", "image"):
            continue
        column = episode.columns.get(name)
        if column is None:
            yield _error(f"{where}: {name}", "is missing")
            continue
        yield from _of_column(f"{where}: {name}", feature, column, episode)
    rows = len(next(iter(episode.columns.values()), ()))
    if rows != episode.rows:
        yield _error(where, f"has {rows} rows, {episode.rows} are written down")
    if rows < FEW_ROWS:
        yield _warning(where, f"has {rows} rows only")
    yield from _of_numbers(where, episode, tasks, rows, first, dataset.fps)


def _of_column(
    where: str, feature: Mapping[str, Any], column: npt.NDArray[Any], episode: EpisodeRead
) -> Iterator[DatasetFinding]:
    size = _size(feature)
    if column.dtype.name != feature["dtype"]:
        yield _error(where, f"is of {column.dtype.name}, written down is {feature['dtype']}")
    if column.size != size * len(column):
        yield _error(where, f"has {column.size // max(1, len(column))} dimensions, written down are {size}")
        return
    table = column.reshape(len(column), -1)
    names = labels_of(feature, table.shape[1])
    if table.dtype.kind == "f":
        for dimension in np.flatnonzero(~np.isfinite(table).all(axis=0)):
            row = int(np.flatnonzero(~np.isfinite(table[:, dimension]))[0])
            yield _error(where, f"{names[dimension]} is {table[row, dimension]} in row {row}")
    name = where.partition(": ")[2]
    written = episode.stats.get(name)
    if written is None:
        yield _error(where, "has no statistics")
    elif len(table):
        yield from _differing(where, written, of_table(table), len(table))
    if len(table) > 2 and name.startswith(("observation", "action")):
        yield from _jumps(where, table.astype(np.float64), names)


def _jumps(where: str, table: Floats, names: list[str]) -> Iterator[DatasetFinding]:
    steps = np.abs(np.diff(table, axis=0))
    usual = np.quantile(steps, STEPS, axis=0)
    worst = steps.max(axis=0)
    span = table.max(axis=0) - table.min(axis=0)
    for dimension in np.flatnonzero((worst > JUMP_SHARE * span) & (worst > JUMP_TIMES * usual) & (span > LEAST_SPAN)):
        row = int(steps[:, dimension].argmax())
        yield _warning(
            where,
            f"{names[dimension]} jumps from {table[row, dimension]:.4g} to {table[row + 1, dimension]:.4g} in row {row + 1}",
        )


def _of_numbers(
    where: str, episode: EpisodeRead, tasks: Mapping[int, str], rows: int, first: int, fps: float
) -> Iterator[DatasetFinding]:
    frames = np.arange(rows)
    expected = {"frame_index": frames, "episode_index": np.full(rows, episode.number), "index": frames + first}
    for name, wanted in expected.items():
        column = episode.columns.get(name)
        if column is not None and not np.array_equal(column.reshape(-1), wanted):
            row = int(np.flatnonzero(column.reshape(-1) != wanted)[0])
            yield _error(f"{where}: {name}", f"is {column.reshape(-1)[row]} in row {row}, not {wanted[row]}")
    times = episode.columns.get("timestamp")
    if times is not None and rows:
        steps = np.abs(np.diff(times.reshape(-1).astype(np.float64)) - 1.0 / fps)
        off = np.abs(times.reshape(-1) - frames / fps)
        if steps.size and steps.max() > TOLERANCE_S:
            row = int(steps.argmax()) + 1
            yield _error(f"{where}: timestamp", f"step to row {row} is {steps.max() * 1e3:.3f} ms off 1/{fps:g} s")
        elif off.max() > TOLERANCE_S:
            yield _error(f"{where}: timestamp", f"row {int(off.argmax())} is {off.max() * 1e3:.3f} ms off the grid")
    numbers = episode.columns.get("task_index")
    if numbers is not None:
        said = {tasks.get(int(number), f"number {number}, which is none") for number in np.unique(numbers)}
        if said != set(episode.tasks):
            yield _error(f"{where}: task_index", f"says {sorted(said)}, written down is {sorted(episode.tasks)}")


def _of_totals(written: Mapping[str, Stats], every: Mapping[str, list[Stats]]) -> Iterator[DatasetFinding]:
    if not written:
        return
    for name, parts in every.items():
        if name in written:
            longest = int(max(part["count"][0] for part in parts))
            yield from _differing(f"meta/stats.json: {name}", written[name], merged(parts), longest)
        else:
            yield _error(f"meta/stats.json: {name}", "has no statistics")


def _differing(where: str, written: Mapping[str, Floats], found: Stats, rows: int) -> Iterator[DatasetFinding]:
    """Compare statistics with what is so; `rows` were added up at once, at most."""
    if "count" in written and float(written["count"].reshape(-1)[0]) != float(found["count"][0]):
        yield _error(where, f"statistics of {written['count'].reshape(-1)[0]:g} rows, there are {found['count'][0]:g}")
    largest = np.maximum(np.abs(found["max"]), np.abs(found["min"])).reshape(-1)
    size = max(1e-6, float(largest.max()))
    for what in SUMMED:
        values = written.get(what)
        if values is None or values.size != found[what].size:
            yield _error(where, f"no {what} of {found[what].size} dimensions in the statistics")
            continue
        stands, is_so = values.reshape(-1), found[what].reshape(-1)
        fits = np.isclose(stands, is_so, rtol=RELATIVE, atol=RELATIVE * size)
        if what == "mean":
            fits |= np.abs(stands - is_so) <= rows * SINGLE * largest / 4
        elif what == "std":
            fits |= np.abs(stands**2 - is_so**2) <= rows * SINGLE * largest**2
        if not fits.all():
            worst = int(np.where(fits, -1.0, np.abs(stands - is_so)).argmax())
            text = f"{stands[worst]:.6g} in the statistics, {is_so[worst]:.6g} in the rows"
            yield _error(where, f"{what} of dimension {worst} is {text}")


def _constant(dataset: Dataset, every: Mapping[str, list[Stats]]) -> Iterator[DatasetFinding]:
    for name, parts in every.items():
        if not name.startswith(("observation", "action")):
            continue
        whole = merged(parts)
        names = labels_of(dataset.features[name], len(whole["min"]))
        same = np.flatnonzero(whole["min"] == whole["max"])
        if len(same) == len(names):
            yield _warning(name, "never changes in any dimension")
        elif len(same):
            listed = ", ".join(f"{names[n]} = {whole['min'][n]:g}" for n in same[:6])
            more = f" and {len(same) - 6} more" if len(same) > 6 else ""
            yield _warning(name, f"{len(same)} of {len(names)} dimensions never change: {listed}{more}")
