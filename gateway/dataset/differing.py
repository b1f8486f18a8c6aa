"""Says in what two datasets differ: features, tasks, rows and pictures. Neither format nor coding is content."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
import numpy.typing as npt

from gateway.dataset.lerobot_reader import Dataset, EpisodeRead
from gateway.dataset.lerobot_videos import episode_pictures
from gateway.errors import Code, Refusal, to_exception

__all__ = ["Difference", "differences"]

TASKS = "task_index"
"""A number that each dataset gives as it likes: words are compared."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """Something in which datasets differ.

    Attributes:
        where: `info.json`, or an episode; empty for the datasets as wholes.
        feature: Of it; empty for all.
        message: What.
        largest: By how much at most: a feature's unit, or steps of a pixel's colour of 255; 0 where nothing is measured.
        row: Where that is, in the episode; -1 where nothing is measured.
    """

    where: str
    feature: str
    message: str
    largest: float = 0.0
    row: int = -1


def differences(a: Dataset, b: Dataset, on_progress: Callable[[float], None] = lambda share: None) -> list[Difference]:
    """Compare two datasets.

    Args:
        a: One.
        b: The other.
        on_progress: Called with the part that was compared, 0..1.

    Raises:
        Rejected: BAD_REQUEST, one of them cannot be read.
    """
    found = list(_of_features(a, b))
    if a.fps != b.fps:
        found.append(Difference(where="info.json", feature="", message=f"{a.fps:g} or {b.fps:g} rows per second"))
    expected = max(1, int(a.info.get("total_episodes", 1)))
    counts = [0, 0]
    for number, (one, other) in enumerate(zip_longest(a.readable(), b.readable())):
        counts = [counts[0] + (one is not None), counts[1] + (other is not None)]
        if one is not None and other is not None:
            try:
                found += _of_episode(a, one, b, other)
            except (OSError, ValueError) as error:
                hint = "`ta2 dataset check` says what is wrong with it"
                message = f"episode {number} cannot be compared: {error}"
                raise to_exception(
                    Refusal(code=Code.BAD_REQUEST, message=message, field="dataset", hint=hint)
                ) from error
        on_progress(min(1.0, (number + 1) / expected))
    if counts[0] != counts[1]:
        found.append(Difference(where="", feature="", message=f"{counts[0]} or {counts[1]} episodes"))
    return found


def _of_features(a: Dataset, b: Dataset) -> Iterator[Difference]:
    for name in dict.fromkeys([*a.features, *b.features]):
        if name not in a.features or name not in b.features:
            yield Difference(
                where="info.json", feature=name, message=f"only {(a if name in a.features else b).folder} has it"
            )
            continue
        for what in ("dtype", "shape", "names"):
            mine, its = a.features[name].get(what), b.features[name].get(what)
            if mine != its and what == "names" and isinstance(mine, list) and isinstance(its, list):
                mine, its = (
                    sorted(set(mine) - set(its)) or "names in one order",
                    sorted(set(its) - set(mine)) or "another",
                )
            if mine != its:
                yield Difference(where="info.json", feature=name, message=f"{what}: {mine} or {its}")


def _of_episode(a: Dataset, one: EpisodeRead, b: Dataset, other: EpisodeRead) -> Iterator[Difference]:
    where = f"episode {one.number}"
    if one.tasks != other.tasks:
        yield Difference(where=where, feature="", message=f"tasks {list(one.tasks)} or {list(other.tasks)}")
    if one.rows != other.rows:
        yield Difference(where=where, feature="", message=f"{one.rows} or {other.rows} rows")
    for name, mine in one.columns.items():
        its = other.columns.get(name)
        if its is None or name == TASKS or name not in a.features:
            continue
        rows = min(len(mine), len(its))
        if not rows:
            continue
        x, y = mine[:rows].reshape(rows, -1), its[:rows].reshape(rows, -1)
        if x.shape == y.shape and (largest := _largest(x, y))[0] > 0.0:
            row, dimension = divmod(largest[1], x.shape[1])
            named = (a.features[name].get("names") or [])[dimension : dimension + 1] or [f"dimension {dimension}"]
            message = f"{named[0]} is {x[row, dimension]} or {y[row, dimension]} in row {row}: the largest difference"
            yield Difference(where=where, feature=name, message=message, largest=largest[0], row=row)
    for name in one.videos:
        if name in other.videos:
            yield from _of_pictures(where, name, (a, one), (b, other))


def _largest(x: npt.NDArray[Any], y: npt.NDArray[Any]) -> tuple[float, int]:
    """Return the largest difference of two tables and where it is, counted through; infinite where numbers meet none."""
    if x.dtype.kind not in "biuf" or y.dtype.kind not in "biuf":
        off = (x != y).astype(np.float64)
    else:
        u, v = x.astype(np.float64), y.astype(np.float64)
        off = np.where((u == v) | (np.isnan(u) & np.isnan(v)), 0.0, np.nan_to_num(np.abs(u - v), nan=np.inf))
    place = int(off.argmax())
    return float(off.flat[place]), place


def _of_pictures(
    where: str, name: str, one: tuple[Dataset, EpisodeRead], other: tuple[Dataset, EpisodeRead]
) -> Iterator[Difference]:
    pictures = (episode_pictures(*episode.videos[name], episode.rows, dataset.fps) for dataset, episode in (one, other))
    counts, largest, at, size = [0, 0], 0.0, -1, ""
    for row, pair in enumerate(zip_longest(*pictures)):
        counts = [count + (picture is not None) for count, picture in zip(counts, pair, strict=True)]
        if None in pair:
            continue
        mine, its = (picture.to_ndarray(format="rgb24").astype(np.int16) for picture in pair)
        if mine.shape != its.shape:
            size = f"pictures of {mine.shape[1]} x {mine.shape[0]} or {its.shape[1]} x {its.shape[0]}"
        elif (off := float(np.abs(mine - its).max())) > largest:
            largest, at = off, row
    if size:
        yield Difference(where=where, feature=name, message=size)
    if counts[0] != counts[1]:
        yield Difference(where=where, feature=name, message=f"{counts[0]} or {counts[1]} pictures")
    if largest:
        message = f"a pixel differs by {largest:g} of 255 in row {at}: the largest difference"
        yield Difference(where=where, feature=name, message=message, largest=largest, row=at)
