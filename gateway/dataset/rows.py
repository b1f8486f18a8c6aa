"""Rows of episodes: every feature of a layout at the times of a grid, in runs without a gap. Pure.

    series of a bag, layout, fps, interval -> runs, each a table of float32 per feature, and what was left out and why

A row needs a value for every part that its layout and the bag ask for. Where one is missing the run ends, and another may
begin: no row is made up, and time does not jump within a run. It also ends before it is too long for the times of a dataset.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil
from typing import Final

import numpy as np
import numpy.typing as npt

from gateway.dataset.layout import Feature, Layout, Part, Source
from gateway.dataset.resample import Bools, resample
from gateway.dataset.series import Floats, Instants, Series
from gateway.dataset.videos import STALE_NS
from gateway.errors import Code, failure
from gateway.robot.vector_layout import effort_of_command

__all__ = ["NO_SOURCE", "Chosen", "Run", "choose", "runs", "stretches"]

Table = npt.NDArray[np.float32]
NO_SOURCE: Final = "nothing of it was recorded"
LONGEST_S: Final = 1000.0
"""Longer runs are cut into even parts [s]: LeRobot has times as float32, whose steps are over its own tolerance of 1e-4 s from
1024 s on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Chosen:
    """Where each part of a layout comes from in one bag.

    Attributes:
        layout: The layout.
        sources: Per feature and part, topic as the bag names it and source; None where the bag has none.
    """

    layout: Layout
    sources: tuple[tuple[tuple[str, Source] | None, ...], ...]

    @property
    def pairs(self) -> set[tuple[str, str]]:
        """Topics and fields that are to be read."""
        return {(topic, source.field) for parts in self.sources for topic, source in filter(None, parts)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """Rows one after the other, without a gap.

    Attributes:
        times_ns: Of the rows [ns since 1970, recording host], shape (n,).
        tables: Per feature, shape (n, dimensions).
        covered: Per feature and part, the share of rows that have a value, 0..1.
    """

    times_ns: Instants
    tables: dict[str, Table]
    covered: dict[str, tuple[float, ...]] = field(default_factory=dict)


def choose(layout: Layout, topics: Collection[str], namespace: str = "") -> Chosen:
    """Return the first source of each part whose topic a bag has."""
    prefix = f"/{namespace.strip('/')}" if namespace.strip("/") else ""

    def first(part: Part) -> tuple[str, Source] | None:
        return next(((prefix + s.topic, s) for s in part.source if prefix + s.topic in topics), None)

    return Chosen(layout=layout, sources=tuple(tuple(map(first, feature.part)) for feature in layout.feature))


def runs(
    chosen: Chosen,
    series: Mapping[tuple[str, str], Series],
    interval_ns: tuple[int, int],
    fps: float,
    least_rows: int,
    pictures_ns: Mapping[str, Instants] | None = None,
) -> tuple[list[Run], dict[str, int]]:
    """Return the rows of an episode.

    The end of the interval is not part of it. Each row needs a picture of each kind of `pictures_ns`, which ascend.

    Returns:
        Runs, in order; and how many rows were left out, by reason.

    Raises:
        Rejected: BAD_REQUEST, a part that is always needed is not in the bag, or is narrower than its names.
    """
    begin_ns, end_ns = interval_ns
    count = max(0, int(np.ceil((end_ns - begin_ns) * fps / 1e9)))
    times_ns = begin_ns + np.rint(np.arange(count) * (1e9 / fps)).astype(np.int64)
    missing: dict[str, Bools] = {}
    tables: dict[str, Table] = {}
    filled: dict[str, list[Bools]] = {}
    for feature, sources in zip(chosen.layout.feature, chosen.sources, strict=True):
        columns = []
        for part, source in zip(feature.part, sources, strict=True):
            values, ok, is_recorded = _part(feature, part, source, series, times_ns)
            columns.append(values)
            filled.setdefault(feature.name, []).append(ok)
            if part.need == "always" or (part.need == "if_recorded" and is_recorded):
                topic = source[0] if source else part.names[0]
                missing[topic] = missing.get(topic, np.zeros(count, dtype=np.bool_)) | ~ok
        tables[feature.name] = np.concatenate(columns, axis=1).astype(np.float32)
    for name, arrivals_ns in (pictures_ns or {}).items():
        seen = Series(times_ns=arrivals_ns, values=np.zeros((len(arrivals_ns), 1)))
        missing[name] = ~resample(seen, times_ns, "hold", STALE_NS)[1]
    usable = ~np.any(np.stack(list(missing.values())), axis=0) if missing else np.ones(count, dtype=np.bool_)
    left_out = _reasons(missing, usable)
    found = []
    for first, last in _parts(stretches(usable), LONGEST_S * fps):
        if last - first < least_rows:
            reason = f"less than {least_rows} rows in a row"
            left_out[reason] = left_out.get(reason, 0) + last - first
            continue
        found.append(
            Run(
                times_ns=times_ns[first:last],
                tables={name: table[first:last] for name, table in tables.items()},
                covered={name: tuple(float(ok[first:last].mean()) for ok in oks) for name, oks in filled.items()},
            )
        )
    return found, left_out


def _reasons(missing: Mapping[str, Bools], usable: Bools) -> dict[str, int]:
    """Return how many rows lack a value, by the topics that they lack."""
    topics = list(missing)
    lacking = np.stack(list(missing.values()), axis=1)[~usable] if missing else np.empty((0, 0))
    kinds, counts = np.unique(lacking, axis=0, return_counts=True) if len(lacking) else ((), ())
    return {
        "no value of " + ", ".join(topic for topic, lacks in zip(topics, kind, strict=True) if lacks): int(count)
        for kind, count in zip(kinds, counts, strict=True)
    }


def _part(
    feature: Feature,
    part: Part,
    chosen: tuple[str, Source] | None,
    series: Mapping[tuple[str, str], Series],
    times_ns: Instants,
) -> tuple[Floats, Bools, bool]:
    """Return values, where there are any, and whether the bag has this part at all."""
    width = len(part.names)
    topic, source = chosen if chosen is not None else ("", part.source[0])
    one = series.get((topic, source.field))
    if one is None:
        if part.need == "always":
            message = f"{feature.name}: {part.names[0]} and what follows: {NO_SOURCE}"
            wanted = " or ".join(f"{each.topic} ({each.field})" for each in part.source)
            hint = f"it comes from {wanted}; another layout is chosen with --layout"
            raise failure(Code.BAD_REQUEST, message, field="layout", hint=hint)
        return np.zeros((len(times_ns), width)), np.zeros(len(times_ns), dtype=np.bool_), False
    has = one.values.shape[1] - source.first
    if has < width:
        message = f"{topic}: {source.field} has {has} numbers from number {source.first} on, {width} are named"
        raise failure(Code.BAD_REQUEST, message, field="layout", value=str(has), bound=str(width))
    picked = Series(times_ns=one.times_ns, values=one.values[:, source.first : source.first + width])
    shifted = times_ns + round(source.shift_s * 1e9)
    values, ok = resample(picked, shifted, source.rule, round(source.stale_s * 1e9))
    if source.convert == "gripper_torque":
        values[ok] = np.vectorize(effort_of_command, otypes=[np.float64])(np.clip(values[ok], 0.0, 1.0))
    return values, ok, True


def _parts(whole: Iterable[tuple[int, int]], most_rows: float) -> Iterator[tuple[int, int]]:
    for first, last in whole:
        yield from pairwise(np.linspace(first, last, ceil((last - first) / most_rows) + 1, dtype=np.int64).tolist())


def stretches(usable: Bools) -> list[tuple[int, int]]:
    """Return begin and end of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], usable, [False])).astype(np.int8)))
    return [(int(first), int(last)) for first, last in zip(edges[::2], edges[1::2], strict=True)]
