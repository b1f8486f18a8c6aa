"""Says in what two datasets differ: features, tasks, rows and pictures. Neither format nor coding is content."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
import numpy.typing as npt

from gateway.dataset.lerobot_reader import Dataset, EpisodeRead, labels_of, names_of
from gateway.dataset.lerobot_videos import episode_pictures
from gateway.errors import Code, failure

__all__ = ["Difference", "differences"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """Something in which datasets differ.

    Attributes:
        where: `info.json`, or an episode; empty for the datasets as wholes.
        feature: Of it; empty for all.
        message: What.
        largest: By how much at most, in the feature's unit, or in steps of a colour (0..255); the largest number where a number
            stands against NaN; 0 where nothing is measured.
        row: Where that is, in the episode; -1 where nothing is measured.
    """

    where: str = ""
    feature: str = ""
    message: str
    largest: float = 0.0
    row: int = -1


def differences(a: Dataset, b: Dataset, on_progress: Callable[[float], None] = lambda share: None) -> list[Difference]:
    """Compare two datasets, and tell how much of them was compared, 0..1.

    Raises:
        Rejected: BAD_REQUEST, one of them cannot be read.
    """
    found = list(_of_info(a, b))
    expected = max(1, int(a.info.get("total_episodes", 1)))
    pairs = list[tuple[bool, bool]]()
    try:
        for one, other in zip_longest(a.readable(), b.readable()):
            pairs.append((one is not None, other is not None))
            if one is not None and other is not None:
                found += _of_episode(a, one, b, other)
            on_progress(min(1.0, len(pairs) / expected))
    except (OSError, ValueError) as error:
        hint = "`ta2 dataset check` says what is wrong with it"
        message = f"episode {len(pairs) - 1} cannot be compared: {error}"
        raise failure(Code.BAD_REQUEST, message, field="dataset", hint=hint) from error
    mine, its = (sum(pair[n] for pair in pairs) for n in (0, 1))
    return found + [Difference(message=f"{mine} or {its} episodes")] * (mine != its)


def _of_info(a: Dataset, b: Dataset) -> Iterator[Difference]:
    if a.fps != b.fps:
        yield Difference(where="info.json", message=f"{a.fps:g} or {b.fps:g} rows per second")
    robots = a.info.get("robot_type"), b.info.get("robot_type")
    if robots[0] != robots[1]:
        yield Difference(where="info.json", message=f"robot_type {robots[0]} or {robots[1]}")
    for name in dict.fromkeys([*a.features, *b.features]):
        mine, its = a.features.get(name), b.features.get(name)
        if mine is None or its is None:
            folder = b.folder if mine is None else a.folder
            yield Difference(where="info.json", feature=name, message=f"only {folder} has it")
            continue
        for what in ("dtype", "shape"):
            if mine.get(what) != its.get(what):
                yield Difference(where="info.json", feature=name, message=f"{what} {mine.get(what)} or {its.get(what)}")
        names = zip_longest(names_of(mine), names_of(its))
        for place, (one, other) in enumerate(names):
            if one != other:
                message = f"dimension {place} is {one} or {other}: the first of another name"
                yield Difference(where="info.json", feature=name, message=message)
                break


def _of_episode(a: Dataset, one: EpisodeRead, b: Dataset, other: EpisodeRead) -> Iterator[Difference]:
    where = f"episode {one.number}"
    tasks = (", ".join(each.tasks) for each in (one, other))
    for what, mine, its in (("tasks", *tasks), ("rows", one.rows, other.rows)):
        if mine != its:
            yield Difference(where=where, message=f"{what}: {mine} or {its}")
    for name in a.features:
        if name in one.videos and name in other.videos:
            yield from _of_pictures(where, name, (a, one), (b, other))
        elif name in one.columns and name in other.columns and name != "task_index":  # of which words are compared
            rows = min(len(one.columns[name]), len(other.columns[name]))
            x, y = (each.columns[name][:rows].reshape(rows, -1) for each in (one, other))
            if x.shape == y.shape and x.size and (off := _off(x, y)).any():
                row, dimension = divmod(int(off.argmax()), off.shape[1])
                label = labels_of(a.features[name], off.shape[1], "dimension {}")[dimension]
                values = f"{label} is {x[row, dimension]} or {y[row, dimension]}"
                message, largest = f"{values} in row {row}: the largest difference", float(off[row, dimension])
                yield Difference(where=where, feature=name, message=message, largest=largest, row=row)


def _off(x: npt.NDArray[Any], y: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    if x.dtype.kind not in "biuf" or y.dtype.kind not in "biuf":
        return np.asarray(x != y, dtype=np.float64)
    u, v = x.astype(np.float64), y.astype(np.float64)
    off = np.nan_to_num(np.abs(u - v), nan=np.finfo(np.float64).max)
    off[(u == v) | (np.isnan(u) & np.isnan(v))] = 0.0
    return np.asarray(off)


def _of_pictures(
    where: str, name: str, one: tuple[Dataset, EpisodeRead], other: tuple[Dataset, EpisodeRead]
) -> Iterator[Difference]:
    pictures = (episode_pictures(*episode.videos[name], episode.rows, dataset.fps) for dataset, episode in (one, other))
    counts, largest, at = [0, 0], 0, -1
    for row, pair in enumerate(zip_longest(*pictures)):
        counts = [count + (picture is not None) for count, picture in zip(counts, pair, strict=True)]
        if None not in pair:
            mine, its = (picture.to_ndarray(format="rgb24").astype(np.int16) for picture in pair)
            off = 255 if mine.shape != its.shape else int(np.abs(mine - its).max())
            largest, at = (off, row) if off > largest else (largest, at)
    if counts[0] != counts[1]:
        yield Difference(where=where, feature=name, message=f"{counts[0]} or {counts[1]} pictures")
    if largest:
        message = f"a pixel is {largest} of 255 off in row {at}, or the size differs: the largest difference"
        yield Difference(where=where, feature=name, message=message, largest=largest, row=at)
