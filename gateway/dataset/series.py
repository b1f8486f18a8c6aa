"""Fields of a bag's messages as columns over time: what a layout asks for, by the recording host's clock.

A message with a stamp counts at its stamp, moved to the host's clock by the smallest delay between stamp and arrival around
it: arrival jitters with the network, stamps do not (manual §4.1.1: the robot's stamps are of its own publishing). Each public
command has the clock of whoever commanded, everything else the robot's. Where a stamp is missing, or a clock was set while
recording, arrival counts. A pose has no stamp (§4.0.2).
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gateway.recording.bag_reader import Bag
from gateway.recording.delays import WINDOW_NS, Delays, merged, step_ns, widened
from gateway.robot.topics import COMMAND_TOPICS

__all__ = ["Floats", "Instants", "Series", "read_series"]

Floats = npt.NDArray[np.float64]
Instants = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """One field of one topic over time.

    Attributes:
        times_ns: When each sample counts, ascending [ns since 1970, recording host], shape (N,).
        values: The field's numbers, shape (N, width).
        messages: Which message of the topic each sample is of, in the order of arrival, shape (N,).
        rejected: Messages of the topic without this field, with another width than most, or with a number that is not finite.
    """

    times_ns: Instants
    values: Floats
    messages: Instants = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    rejected: int = 0


@dataclass(slots=True)
class _Field:
    """A field while it is read: how many numbers each message has of it, and all of these, one after the other."""

    widths: array[int] = field(default_factory=lambda: array("i"))
    numbers: array[float] = field(default_factory=lambda: array("d"))


@dataclass(slots=True)
class _Column:
    """A topic while it is read: arrivals and stamps [ns] (0 for none), its delays, and its fields by their names.

    An hour of a robot has millions of numbers: they are kept in eight bytes each.
    """

    fields: dict[str, _Field]
    arrivals: array[int] = field(default_factory=lambda: array("q"))
    stamps: array[int] = field(default_factory=lambda: array("q"))
    delays: Delays = field(default_factory=Delays)

    @property
    def is_stamped(self) -> bool:
        """Whether each of its messages has a stamp."""
        return bool(self.stamps) and min(self.stamps) > 0


def read_series(
    bag: Bag,
    wanted: Iterable[tuple[str, str]],
    *,
    by_arrival: bool = False,
    on_progress: Callable[[float], None] = lambda share: None,
) -> dict[tuple[str, str], Series]:
    """Return a series of each field; pairs of which the bag has no usable sample are left out.

    `wanted` are pairs of topic, as the bag names it, and field.
    """
    pairs = sorted(set(wanted))
    columns = {topic: _Column({name: _Field() for other, name in pairs if other == topic}) for topic, _ in pairs}
    counts = {topic.name: topic.count for topic in bag.topics}
    expected, count = max(1, sum(counts.get(topic, 0) for topic in columns)), 0
    for topic, log_ns, message in bag.decoded(columns):
        if count % 5000 == 0:
            on_progress(min(1.0, count / expected))
        count += 1
        column = columns[topic]
        column.arrivals.append(log_ns)
        column.stamps.append(_stamp_ns(message))
        column.delays.add(log_ns, column.stamps[-1])
        for name, values in column.fields.items():
            before = len(values.numbers)
            values.numbers.extend(_numbers(message, name))
            values.widths.append(len(values.numbers) - before)
    on_progress(1.0)
    clocks, delays = _clocks(bag, columns), {}
    for clock in () if by_arrival else set(clocks.values()):
        delays[clock] = _delays(one for topic, one in columns.items() if clocks[topic] == clock)
    found = {}
    for topic, column in columns.items():
        times_ns = _times(column, delays.get(clocks[topic]))
        for name, values in column.fields.items():
            series = _series(times_ns, values)
            if len(series.times_ns):
                found[topic, name] = series
    return found


def _clocks(bag: Bag, names: Iterable[str]) -> dict[str, str]:
    """Return for each topic whose clock stamps it: of a public command its own, as anybody may send it; else the robot's."""
    aliases = {topic.name: topic.alias_of for topic in bag.topics}
    origins = {name: aliases.get(name) or name for name in names}
    return {name: origin if origin.endswith(COMMAND_TOPICS) else "" for name, origin in origins.items()}


def _stamp_ns(message: Any) -> int:  # noqa: ANN401  messages of any type
    header = getattr(message, "header", None)
    return 0 if header is None else int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def _numbers(message: Any, name: str) -> Iterable[float]:  # noqa: ANN401
    """Return a field's numbers in order; none where there is no such field, or it holds something else."""
    for part in name.split("."):
        message = getattr(message, part, None)
    return _flat(message)


def _flat(value: Any) -> Iterable[float]:  # noqa: ANN401
    if isinstance(value, bool | int | float):
        return (float(value),)
    if isinstance(value, np.ndarray):
        return value.ravel().tolist() if value.dtype.kind in "biuf" else ()
    names = getattr(value, "__dataclass_fields__", {})
    return [number for name in names if name != "__msgtype__" for number in _flat(getattr(value, name))]


def _series(times_ns: Instants, field: _Field) -> Series:
    """Return rows of the width that most have, in the order of their times; of equal times the last."""
    widths, numbers = np.array(field.widths, dtype=np.int64), np.array(field.numbers, dtype=np.float64)
    used = widths[widths > 0]
    width = int(np.bincount(used).argmax()) if len(used) else 0
    fits = np.flatnonzero(widths == width) if width else np.empty(0, dtype=np.int64)
    values = numbers[(np.cumsum(widths) - widths)[fits, np.newaxis] + np.arange(width)]
    finite = np.isfinite(values).all(axis=1)
    times, values = times_ns[fits][finite], values[finite]
    order = np.argsort(times, kind="stable")
    times, values, messages = times[order], values[order], fits[finite][order]
    is_last = np.append(times[1:] != times[:-1], True)[: len(times)]
    rejected = len(widths) - int(finite.sum())
    return Series(times_ns=times[is_last], values=values[is_last], messages=messages[is_last], rejected=rejected)


def _delays(columns: Iterable[_Column]) -> tuple[Floats, Floats] | None:
    """Return the middles of windows and the smallest arrival minus stamp in each [ns]; None where stamps cannot be used."""
    least = merged(column.delays.least for column in columns if column.is_stamped)
    if not least or step_ns(least):
        return None
    wide = widened(least)
    windows, delays = (np.array(list(part), dtype=np.float64) for part in (wide, wide.values()))
    return (windows + 0.5) * WINDOW_NS, delays


def _times(column: _Column, delays: tuple[Floats, Floats] | None) -> Instants:
    arrivals = np.array(column.arrivals, dtype=np.int64)
    if delays is None or not column.is_stamped:
        return arrivals
    middles, least = delays
    moved = np.array(column.stamps, dtype=np.int64) + np.rint(np.interp(arrivals, middles, least)).astype(np.int64)
    return np.minimum(moved, arrivals)  # nothing is known before it was said
