"""Datasets made of datasets: several put together, some episodes taken out. Episodes are renumbered, statistics made anew.

    datasets -> episodes -> OUT.making/ -> LeRobot's layout -> OUT

Rows, numbers, statistics and origin are what `build` would have given of the same bags, byte for byte; but what was left out is
told of all bags together. Videos are not encoded anew: copied, or cut where episodes begin.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import numpy.typing as npt

from gateway.dataset.building import PROVENANCE, refuse_full, told, write_provenance
from gateway.dataset.episode import INTEGERS, EpisodeFacts, WholeEpisode
from gateway.dataset.layout import Layout
from gateway.dataset.lerobot_format import FORMATS, write_dataset
from gateway.dataset.lerobot_reader import Dataset, EpisodeRead
from gateway.errors import Code, GatewayError, Refusal, to_exception
from gateway.recording.bag_writer import needed

__all__ = ["Edited", "merge", "split"]

OnProgress = Callable[[float], None]
Part = tuple[Dataset, Collection[int] | None]
"""A dataset, and the numbers of the episodes that are taken; None for all."""
SAME: Final = ("layout", "eyes")
"""Choices that make numbers and pictures mean something else."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Edited:
    """A dataset that was made: its folder, and how much is in it."""

    folder: Path
    episodes: int
    rows: int


def merge(datasets: Sequence[Dataset], out: Path, on_progress: OnProgress = lambda share: None) -> Edited:
    """Put datasets together, one after the other.

    Args:
        datasets: At least one.
        out: Folder to be made.
        on_progress: Called with the part that is done, 0..1.

    Raises:
        Rejected: BAD_REQUEST, they differ in format, fps, kind of robot, features or what these mean; one cannot be read;
            `out` holds something or cannot be written.
    """
    first = datasets[0]
    for other in datasets[1:]:
        for name, mine, its in (
            ("format", first.version, other.version),
            ("rows per second", first.fps, other.fps),
            ("kind of robot", first.info.get("robot_type"), other.info.get("robot_type")),
        ):
            if mine != its:
                raise _refused(f"{other.folder} is of another {name} than {first.folder}", str(its), str(mine))
        names = dict.fromkeys([*first.features, *other.features])
        differing = [name for name in names if first.features.get(name) != other.features.get(name)]
        if differing:
            hint = "`ta2 dataset diff` says how; `ta2 dataset build` makes both alike"
            raise _refused(f"{other.folder} has other features than {first.folder}: {', '.join(differing)}", hint=hint)
    return _made([(dataset, None) for dataset in datasets], out, on_progress)


def split(
    dataset: Dataset, numbers: Collection[int], out: Path, on_progress: OnProgress = lambda share: None
) -> Edited:
    """Take episodes out of a dataset into a new one, in their order; the dataset stays as it is.

    Args:
        dataset: It.
        numbers: Of the episodes, from 0.
        out: Folder to be made.
        on_progress: Called with the part that is done, 0..1.

    Raises:
        Rejected: BAD_REQUEST, there is no such episode; the dataset cannot be read; `out` holds something or cannot be written.
    """
    there = int(dataset.info.get("total_episodes", 0))
    missing = sorted(number for number in numbers if not 0 <= number < there)
    if missing or not numbers:
        named = ", ".join(map(str, missing)) or "at all"
        raise _refused(f"{dataset.folder} has no episode {named}", named, f"0 to {there - 1}")
    return _made([(dataset, sorted(set(numbers)))], out, on_progress)


def _made(parts: Sequence[Part], out: Path, on_progress: OnProgress) -> Edited:
    refuse_full(out)
    first, _ = parts[0]
    if first.cameras:
        needed("av", "video")
    version = next(version for version in FORMATS if version == first.version)
    total = sum(int(dataset.info.get("total_episodes", 0)) if only is None else len(only) for dataset, only in parts)
    new, rows = out.resolve().with_name(out.resolve().name + ".making"), list[int]()

    def episodes() -> Iterator[WholeEpisode]:
        for dataset, only in parts:
            for episode in dataset.readable(only):
                rows.append(episode.rows)
                yield _whole(dataset, episode)
        if not rows:
            raise ValueError("there is no episode")

    try:
        origin = _origin(parts)
        shutil.rmtree(new, ignore_errors=True)
        new.mkdir(parents=True)
        write_dataset(
            new,
            version,
            first.features,
            episodes(),
            first.fps,
            lambda count: on_progress(min(1.0, count / max(1, total))),
            str(first.info.get("robot_type")),
        )
        if origin is not None:
            choices, views, facts, left_out = origin
            built = told(out, msgspec.convert(choices["layout"], Layout), facts, left_out)
            write_provenance(new, choices, views, facts, built)
        if out.exists():
            out.rmdir()
        new.rename(out)
    except (OSError, ValueError) as error:
        raise _refused(f"{out} cannot be made: {error}") from error
    finally:
        shutil.rmtree(new, ignore_errors=True)
    return Edited(folder=out, episodes=len(rows), rows=sum(rows))


def _whole(dataset: Dataset, episode: EpisodeRead) -> WholeEpisode:
    where = f"{dataset.folder}: episode {episode.number}"
    if len(episode.tasks) != 1:
        raise _refused(f"{where} has {len(episode.tasks)} tasks, one is needed")
    tables: dict[str, npt.NDArray[np.generic]] = {}
    for name, feature in dataset.features.items():
        if feature["dtype"] == "video" or name in INTEGERS:
            continue
        column = episode.columns.get(name)
        if column is None or column.dtype.kind not in "biuf" or len(column) != episode.rows:
            raise _refused(
                f"{where}: {name} is no column of {episode.rows} numbers", hint="`ta2 dataset check` says more"
            )
        tables[name] = column.astype(feature["dtype"], copy=False)
    lacking = [camera for camera in dataset.cameras if "count" not in episode.stats.get(camera, {})]
    if lacking:
        raise _refused(f"{where}: {', '.join(lacking)} has no statistics")
    stats = {camera: episode.stats[camera] for camera in dataset.cameras}
    return WholeEpisode(task=episode.tasks[0], tables=tables, videos=episode.videos, video_stats=stats)


def _origin(
    parts: Sequence[Part],
) -> tuple[dict[str, Any], dict[str, str], list[EpisodeFacts], dict[str, int]] | None:
    """Return choices, views, episodes and what was left out; None where a dataset is not of `build`. Choices that differ go."""
    found = [dataset.folder / PROVENANCE for dataset, _ in parts]
    if not all(path.exists() for path in found):
        return None
    every: list[dict[str, Any]] = [json.loads(path.read_text(encoding="utf-8")) for path in found]
    first, facts, left_out = every[0], list[EpisodeFacts](), dict[str, int]()
    for (dataset, only), one in zip(parts, every, strict=True):
        for name in SAME:
            if one["choices"].get(name) != first["choices"].get(name):
                raise _refused(f"{dataset.folder} has another {name} than {parts[0][0].folder}: {PROVENANCE} has both")
        episodes = msgspec.convert(one["episodes"], list[EpisodeFacts])
        facts += episodes if only is None else [episodes[number] for number in only]
        for reason, count in one["left_out"].items():
            left_out[reason] = left_out.get(reason, 0) + count
    kept = {
        name: value for name, value in first["choices"].items() if all(o["choices"].get(name) == value for o in every)
    }
    return kept, first["views"], facts, left_out


def _refused(message: str, value: str = "", bound: str = "", hint: str = "") -> GatewayError:
    refusal = Refusal(code=Code.BAD_REQUEST, message=message, field="dataset", value=value, bound=bound, hint=hint)
    return to_exception(refusal)
