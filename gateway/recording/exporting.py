"""Tables of a bag: a file for each topic, a row for each message, a column for each value, as CSV or Parquet.

A column is named after its field: `position_0`, `orientation_x`. First come `log_ns`, the arrival, and `stamp_ns`, the stamp of
the header by the sender's clock, empty where there is none. Every topic is read twice, first for its columns: the memory that
this takes does not grow with the bag.

Libraries: rosbags decodes; pyarrow writes Parquet (extra `dataset`).
"""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from msgspec import Struct

from gateway.errors import Code, GatewayError, failure
from gateway.recording.bag_reader import Bag, BagTopic
from gateway.recording.bag_writer import needed

__all__ = ["Table", "export"]

MOST_COLUMNS = 4096
"""A topic with more values in a message (a picture, a map) makes no table."""
ROWS_AT_ONCE = 10_000
FIRST = {"log_ns": "int64", "stamp_ns": "int64"}

Row = dict[str, Any]
OnProgress = Callable[[float, str], None]


class Table(Struct, frozen=True, kw_only=True):
    """What came of a topic: its file or, without one, why; rows, columns, and messages that could not be decoded."""

    topic: str
    file: Path | None
    rows: int = 0
    columns: int = 0
    malformed: int = 0
    why: str = ""


def export(
    bag: Bag,
    out: Path,
    kind: str = "csv",
    only: Collection[str] | None = None,
    on_progress: OnProgress = lambda share, name: None,
) -> list[Table]:
    """Write a bag's topics as tables.

    Args:
        bag: Open.
        out: Folder of the tables; made here, and must hold nothing yet.
        kind: `csv` or `parquet`.
        only: Names of topics; None for all that have messages.
        on_progress: Called with the part that is done, 0..1, and the topic that is being written.

    Raises:
        Rejected: BAD_REQUEST, there is no such topic, the folder is not empty or cannot be written, or pyarrow is missing.
    """
    if kind == "parquet":
        needed("pyarrow.parquet", "dataset")
    topics = [topic for topic in bag.topics if topic.count and (only is None or topic.name in only)]
    missing = sorted(set(only or ()) - {topic.name for topic in topics})
    if missing:
        raise _refused(f"{bag.path} has no message of {', '.join(missing)}", "topic", "`ta2 bag topics` lists them")
    try:
        out.mkdir(parents=True, exist_ok=True)
        if any(out.iterdir()):
            raise _refused(f"{out} is not empty", "out", "name a new folder with --out")
        done, expected, tables = 0, max(sum(topic.count for topic in topics), 1), []
        for topic in topics:
            on_progress(done / expected, topic.name)
            tables.append(_table(bag, topic, out, kind))
            done += topic.count
    except OSError as error:
        raise _refused(
            f"{out} cannot be written: {error.strerror or error}", "out", "name another folder with --out"
        ) from error
    on_progress(1.0, "")
    return tables


def _table(bag: Bag, topic: BagTopic, out: Path, kind: str) -> Table:
    columns, malformed = dict(FIRST), 0
    for row in _rows(bag, topic):
        malformed += row is None
        for name, value in (row or {}).items():
            if name not in columns or (columns[name] == "int64" and value is not None and _kind_of(value) != "int64"):
                columns[name] = _kind_of(value)
        if len(columns) > MOST_COLUMNS:
            return Table(topic=topic.name, file=None, why=f"left out: more than {MOST_COLUMNS} values in a message")
    path = out / f"{topic.name.strip('/').replace('/', '.')}.{kind}"
    partial = path.with_name(f".{path.name}.partial")
    rows = (row for row in _rows(bag, topic) if row is not None)
    try:
        count = (_write_csv if kind == "csv" else _write_parquet)(partial, columns, rows)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
    return Table(topic=topic.name, file=path, rows=count, columns=len(columns), malformed=malformed)


def _rows(bag: Bag, topic: BagTopic) -> Iterator[Row | None]:
    """Yield a row for each message, None for one that cannot be decoded."""
    for message in bag.messages([topic.name]):
        try:
            value = bag.decode(topic.type_name, message.payload)
        except ValueError:
            yield None
            continue
        stamp = getattr(getattr(value, "header", None), "stamp", None)
        stamp_ns = None if stamp is None else stamp.sec * 1_000_000_000 + stamp.nanosec
        yield {"log_ns": message.log_ns, "stamp_ns": stamp_ns, **dict(_flat("", value))}


def _flat(name: str, value: Any) -> Iterator[tuple[str, Any]]:  # noqa: ANN401  whatever a message holds
    """Yield the values in a value, with the names of their columns; an array ends where its message would be too wide."""
    if is_dataclass(value):
        for field in fields(value):
            if field.name != "__msgtype__" and (name, field.name) != ("header", "stamp"):
                yield from _flat(f"{name}_{field.name}" if name else field.name, getattr(value, field.name))
    elif hasattr(value, "__len__") and not isinstance(value, str):
        for number, one in enumerate(value[: MOST_COLUMNS + 1]):
            yield from _flat(f"{name}_{number}", one)
    else:
        yield name, value.item() if hasattr(value, "item") else value


def _kind_of(value: object) -> str:
    """Return the name of a value's type in Arrow."""
    if isinstance(value, bool):
        return "bool"
    if isinstance(value, int):
        return "int64" if value < 2**63 else "uint64"
    return "double" if isinstance(value, float) else "string"


def _write_csv(path: Path, columns: Mapping[str, str], rows: Iterator[Row]) -> int:
    count = 0
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(columns), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow(row)
            count += 1
    return count


def _write_parquet(path: Path, columns: Mapping[str, str], rows: Iterator[Row]) -> int:
    arrow = needed("pyarrow", "dataset")
    schema = arrow.schema([(name, arrow.type_for_alias(kind)) for name, kind in columns.items()])
    count, waiting = 0, list[Row]()

    def write(waiting: Sequence[Row]) -> None:
        writer.write_table(arrow.Table.from_pylist(waiting, schema=schema))

    with needed("pyarrow.parquet", "dataset").ParquetWriter(path, schema, compression="zstd") as writer:
        for row in rows:
            count += 1
            waiting.append(row)
            if len(waiting) == ROWS_AT_ONCE:
                write(waiting)
                waiting = []
        write(waiting)
    return count


def _refused(message: str, field: str, hint: str) -> GatewayError:
    return failure(Code.BAD_REQUEST, message, field=field, hint=hint)
