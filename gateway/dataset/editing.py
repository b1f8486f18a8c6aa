"""Datasets made of datasets: several put together, some episodes taken out. Episodes are renumbered, statistics made anew.

Rows, numbers, statistics and origin are what `build` would have given of the same bags, byte for byte; but what was left out is
told of all bags together. Videos are not encoded anew: copied, or cut where episodes begin.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from gateway.dataset.building import PROVENANCE, refuse_full, told, write_provenance
from gateway.dataset.episode import INTEGERS, EpisodeFacts, WholeEpisode
from gateway.dataset.layout import Layout
from gateway.dataset.lerobot_format import FORMATS, write_dataset
from gateway.dataset.lerobot_reader import Dataset, EpisodeRead
from gateway.errors import Code, GatewayError, failure
from gateway.recording.bag_writer import needed

__all__ = ["Edited", "merge", "split"]

OnProgress = Callable[[float], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Edited:
    """A dataset that was made: its folder, and how much is in it."""

    folder: Path
    episodes: int
    rows: int


def merge(datasets: Sequence[Dataset], out: Path, on_progress: OnProgress = lambda share: None) -> Edited:
    """Put datasets together, at least one, in their order; tell how much is done, 0..1.

    Raises:
        Rejected: BAD_REQUEST, they differ in format, rate, robot, features or what these mean; one cannot be read; `out` holds
            something or cannot be written.
    """
    first = datasets[0]
    for other in datasets[1:]:
        pairs = {"format": (other.version, first.version), "rows per second": (other.fps, first.fps)}
        pairs |= {"robot_type": (other.info.get("robot_type"), first.info.get("robot_type"))}
        for name in dict.fromkeys([*first.features, *other.features]):
            pairs[f"feature {name}"] = (other.features.get(name), first.features.get(name))
        if all(origins := [_origin(dataset) for dataset in (other, first)]):
            for what in ("layout", "eyes"):
                pairs[f"{what} in {PROVENANCE}"] = (origins[0]["choices"][what], origins[1]["choices"][what])
        differing = [what for what, (its, mine) in pairs.items() if its != mine]
        if differing:
            message = f"{other.folder} and {first.folder} do not go together: other {', '.join(differing)}"
            raise _refused(message, "build both alike")
    return _made([(dataset, None) for dataset in datasets], out, on_progress)


def split(
    dataset: Dataset, numbers: Collection[int], out: Path, on_progress: OnProgress = lambda share: None
) -> Edited:
    """Copy episodes, by their numbers from 0 on, into a new dataset, in the old order; tell how much is done, 0..1.

    Raises:
        Rejected: BAD_REQUEST, there is no such episode; the dataset cannot be read; `out` holds something or cannot be written.
    """
    there = range(int(dataset.info.get("total_episodes", 0)))
    missing = [str(number) for number in sorted(numbers) if number not in there]
    if missing:
        raise _refused(f"{dataset.folder} has no episode {', '.join(missing)}: there are {len(there)}, from 0 on")
    return _made([(dataset, sorted(set(numbers)))], out, on_progress)


def _made(parts: Sequence[tuple[Dataset, list[int] | None]], out: Path, on_progress: OnProgress) -> Edited:
    refuse_full(out)
    first, _ = parts[0]
    if first.cameras:
        needed("av", "video")
    total = sum(int(dataset.info.get("total_episodes", 0)) if only is None else len(only) for dataset, only in parts)
    new, rows = out.resolve().with_name(out.resolve().name + ".making"), list[int]()

    def episodes() -> Iterator[WholeEpisode]:
        for dataset, only in parts:
            for episode in dataset.readable(only):
                rows.append(episode.rows)
                on_progress(min(1.0, len(rows) / max(1, total)))
                yield _whole(dataset, episode)

    try:
        shutil.rmtree(new, ignore_errors=True)
        new.mkdir(parents=True)
        version = next(version for version in FORMATS if version == first.version)
        write_dataset(new, version, first.features, episodes(), first.fps, robot_type=first.info.get("robot_type"))
        if not rows:
            raise ValueError("there is no episode")
        _write_origin(new, out, parts)
        if out.exists():
            out.rmdir()
        new.rename(out)
    except (OSError, ValueError, LookupError) as error:
        raise _refused(
            f"{out} cannot be made: {type(error).__name__}: {error}",
            "`ta2 dataset check` says what is wrong with a dataset",
        ) from error
    finally:
        shutil.rmtree(new, ignore_errors=True)
    return Edited(folder=out, episodes=len(rows), rows=sum(rows))


def _whole(dataset: Dataset, episode: EpisodeRead) -> WholeEpisode:
    """Return an episode to be written; raise LookupError where something is missing, ValueError where it is of another kind."""
    (task,) = episode.tasks
    tables: dict[str, npt.NDArray[np.generic]] = {}
    for name, feature in dataset.features.items():
        if feature["dtype"] != "video" and name not in INTEGERS:
            tables[name] = episode.columns[name].astype(np.dtype(feature["dtype"]), copy=False)
            if tables[name].dtype.kind not in "biuf" or len(tables[name]) != episode.rows:
                raise ValueError(f"episode {episode.number}: {name} is no column of {episode.rows} numbers")
    stats = {camera: episode.stats[camera] for camera in dataset.cameras}
    return WholeEpisode(task=task, tables=tables, videos=episode.videos, video_stats=stats)


def _origin(dataset: Dataset) -> dict[str, Any]:
    path = dataset.folder / PROVENANCE
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def _write_origin(folder: Path, out: Path, parts: Sequence[tuple[Dataset, list[int] | None]]) -> None:
    """Write where all this comes from, if that is known of every part; choices that differ are not told."""
    origins = [_origin(dataset) for dataset, _ in parts]
    if not all(origins):
        return
    facts, left_out = list[EpisodeFacts](), dict[str, int]()
    for (_, only), origin in zip(parts, origins, strict=True):
        episodes = msgspec.convert(origin["episodes"], list[EpisodeFacts])
        facts += episodes if only is None else [episodes[number] for number in only]
        for reason, count in origin["left_out"].items():
            left_out[reason] = left_out.get(reason, 0) + count
    first = origins[0]["choices"]
    choices = {name: value for name, value in first.items() if all(o["choices"].get(name) == value for o in origins)}
    built = told(out, msgspec.convert(choices["layout"], Layout), facts, left_out)
    write_provenance(folder, choices, origins[0]["views"], facts, built)


def _refused(message: str, hint: str = "") -> GatewayError:
    return failure(Code.BAD_REQUEST, message, field="dataset", hint=hint)
