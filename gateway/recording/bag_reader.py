"""A bag that is read: ours, or any other of ROS 2, MCAP or SQLite; what it holds, and its messages as they came.

Libraries: rosbags. A message is handed out as bytes: nothing is decoded that nobody asked for.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from gateway.errors import Code, Refusal, to_exception
from gateway.recording.bag_writer import ACTIVE, METADATA, NOTE, needed

__all__ = ["Bag", "BagMessage", "BagTopic"]


class BagMessage(NamedTuple):
    """A message: its topic, arrival by the recording host's clock [ns], CDR bytes."""

    topic: str
    log_ns: int
    payload: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class BagTopic:
    """A topic of a bag: ROS name, ROS type, number of messages."""

    name: str
    type_name: str
    count: int


class Bag:
    """An open bag. Context manager.

    Args:
        path: Its folder, or an MCAP file.

    Raises:
        Rejected: BAD_REQUEST, there is no bag, it is incomplete, or it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        reading = needed("rosbags.highlevel")
        _refuse_incomplete(path)
        try:
            self._reader: Any = reading.AnyReader([path])
            self._reader.open()
        except Exception as error:
            message = f"{path} cannot be read: {error}"
            hint = "a folder with metadata.yaml and an .mcap or .db3 file, or an .mcap file, is a bag"
            raise to_exception(Refusal(code=Code.BAD_REQUEST, message=message, field="bag", hint=hint)) from error

    def close(self) -> None:
        """Close it."""
        self._reader.close()

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def topics(self) -> list[BagTopic]:
        """Every topic, by name."""
        found: dict[str, BagTopic] = {}
        for connection in self._reader.connections:
            before = found.get(connection.topic)
            count = connection.msgcount + (before.count if before else 0)
            found[connection.topic] = BagTopic(name=connection.topic, type_name=connection.msgtype, count=count)
        return [found[name] for name in sorted(found)]

    @property
    def begin_ns(self) -> int:
        """Arrival of the first message [ns]; 0 in an empty bag."""
        return int(self._reader.start_time) if self._reader.message_count else 0

    @property
    def end_ns(self) -> int:
        """The first instant after the last message [ns]; 0 in an empty bag."""
        return int(self._reader.end_time) if self._reader.message_count else 0

    @property
    def duration_s(self) -> float:
        """From the first to the last message [s]."""
        return float(self._reader.duration) / 1e9 if self._reader.message_count else 0.0

    @property
    def message_count(self) -> int:
        """Messages, as the bag itself says."""
        return int(self._reader.message_count)

    @property
    def size_bytes(self) -> int:
        """Of all its files [bytes]."""
        files = self.path.rglob("*") if self.path.is_dir() else [self.path]
        return sum(file.stat().st_size for file in files if file.is_file())

    def messages(
        self, topics: Collection[str] | None = None, begin_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[BagMessage]:
        """Yield messages in the order of their arrival.

        Args:
            topics: Only these; None for all.
            begin_ns: Only those that came then or later [ns].
            end_ns: Only those that came before [ns].
        """
        wanted = [c for c in self._reader.connections if topics is None or c.topic in topics]
        if not wanted:
            return
        for connection, log_ns, payload in self._reader.messages(connections=wanted, start=begin_ns, stop=end_ns):
            yield BagMessage(connection.topic, log_ns, bytes(payload))

    def facts(self) -> Mapping[str, str]:
        """Return what our recorder noted; nothing of other recorders' bags."""
        facts: dict[str, str] = {}
        files = sorted(self.path.glob("*.mcap")) if self.path.is_dir() else [self.path]
        for file in files:
            with file.open("rb") as stream, suppress(Exception):  # noted facts are a gift: none are no fault
                for record in needed("mcap.reader").make_reader(stream).iter_metadata():
                    if record.name == NOTE:
                        facts |= record.metadata
        return facts


def _refuse_incomplete(path: Path) -> None:
    if not path.exists():
        message = f"there is no {path}"
        raise to_exception(Refusal(code=Code.BAD_REQUEST, message=message, field="bag"))
    if path.is_dir() and not (path / METADATA).exists() and list(path.glob(f"*{ACTIVE}")):
        message = f"{path} is still being recorded, or its recorder was killed"
        hint = f"if nothing records there any more: ta2 record recover {path}"
        raise to_exception(Refusal(code=Code.BAD_REQUEST, message=message, field="bag", hint=hint))
