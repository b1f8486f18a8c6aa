"""A bag that is read: ours, or any other of ROS 2, MCAP or SQLite; what it holds, and its messages as they came.

Libraries: rosbags. A message is handed out as bytes: nothing is decoded that nobody asked for.
"""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple

from msgspec import Struct

from gateway.errors import Code, failure
from gateway.recording.bag_writer import ACTIVE, ALIAS, METADATA, NOTE, needed
from gateway.recording.topics import RecordedTopic

__all__ = ["VIDEO_PACKET", "VIDEO_PACKET_FIELDS", "Bag", "BagCopy", "BagMessage", "BagTopic"]

VIDEO_PACKET = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
VIDEO_PACKET_FIELDS = (
    "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\n"
    "uint64 pts\nuint8 flags\nbool is_bigendian\nuint8[] data\n"
)
"""A coded picture, as the robot's own recorder keeps its cameras (§5.4); ROS itself does not define it."""


class BagMessage(NamedTuple):
    """A message: its topic, arrival by the recording host's clock [ns], CDR bytes."""

    topic: str
    log_ns: int
    payload: bytes


class BagCopy(NamedTuple):
    """A message to be copied: arrival and sender's time [ns], topic, CDR bytes."""

    log_ns: int
    publish_ns: int
    topic: str
    payload: bytes


class BagTopic(Struct, frozen=True, kw_only=True):
    """A topic of a bag: ROS name, ROS type, number of messages, and which one it repeats, if it does."""

    name: str
    type_name: str
    count: int
    alias_of: str = ""


class Bag:
    """An open bag. Context manager.

    Args:
        path: Its folder, or an MCAP file.

    Raises:
        Rejected: BAD_REQUEST, there is no bag, it is incomplete, or it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        reading, types = needed("rosbags.highlevel"), needed("rosbags.typesys")
        _refuse_incomplete(path)
        try:
            store = types.get_typestore(types.Stores.ROS2_HUMBLE)  # SQLite bags of Humble hold no definitions
            store.register(types.get_types_from_msg(VIDEO_PACKET_FIELDS, VIDEO_PACKET))
            self._reader: Any = reading.AnyReader([path], default_typestore=store)
            self._reader.open()
            self._aliases = self._found_aliases()
        except Exception as error:
            message = f"{path} cannot be read: {error}"
            hint = "a folder with metadata.yaml and an .mcap or .db3 file, or an .mcap file, is a bag"
            raise failure(Code.BAD_REQUEST, message, field="bag", hint=hint) from error

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
            name, alias_of = connection.topic, self._aliases.get(connection.topic, "")
            found[name] = BagTopic(name=name, type_name=connection.msgtype, count=count, alias_of=alias_of)
        return [found[name] for name in sorted(found)]

    def recorded_topics(self) -> list[RecordedTopic]:
        """Return every topic as a writer needs it, with definition and QoS, by name.

        Raises:
            Rejected: BAD_REQUEST, nobody knows the definition of a type.
        """
        dump, languages = needed("rosbags.rosbag2.metadata").dump_qos_v8, {"MSG": "ros2msg", "IDL": "ros2idl"}
        found: dict[str, RecordedTopic] = {}
        for connection in self._reader.connections:
            name, type_name = connection.topic, connection.msgtype
            text, encoding = connection.msgdef.data, languages.get(connection.msgdef.format.name)
            try:
                if encoding is None:
                    text, encoding = self._reader.typestore.generate_msgdef(type_name, ros_version=2)[0], "ros2msg"
            except Exception as error:
                message = f"{name}: nobody knows the definition of {type_name}"
                raise failure(Code.BAD_REQUEST, message, field="bag") from error
            qos = dump(connection.ext.offered_qos_profiles)
            found[name] = RecordedTopic(
                name=name,
                type_name=type_name,
                definition=text,
                encoding=encoding,
                qos=qos,
                alias_of=self._aliases.get(name, ""),
            )
        return [found[name] for name in sorted(found)]

    def decode(self, type_name: str, payload: bytes) -> Any:  # noqa: ANN401  a class that rosbags made of the definition
        """Return a message of any type of this bag, as a dataclass.

        Raises:
            ValueError: It is malformed.
        """
        try:
            return self._reader.deserialize(payload, type_name)
        except Exception as error:  # whatever a malformed message makes of it
            raise ValueError(f"{type_name}: {error}") from error

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
        for connection, log_ns, payload in self._messages(topics, begin_ns, end_ns):
            yield BagMessage(connection.topic, log_ns, bytes(payload))

    def decoded(self, topics: Collection[str]) -> Iterator[tuple[str, int, Any]]:
        """Yield topic, arrival [ns] and message, in the order of arrival; None for a message that is not of its type.

        Args:
            topics: Only these. Their types are the bag's own, or those of ROS 2 Humble.
        """
        for connection, log_ns, payload in self._messages(topics):
            message = None
            with suppress(ValueError):
                message = self.decode(connection.msgtype, payload)
            yield connection.topic, log_ns, message

    def copies(self, begin_ns: int | None = None, end_ns: int | None = None) -> Iterator[BagCopy]:
        """Yield messages in the order of their arrival, as they are to be copied: with the times of their senders.

        Args:
            begin_ns: Only those that came then or later [ns].
            end_ns: Only those that came before [ns].
        """
        files = self._mcap_files()
        if not files:  # SQLite keeps one time
            yield from (BagCopy(m.log_ns, m.log_ns, m.topic, m.payload) for m in self.messages(None, begin_ns, end_ns))
            return
        with ExitStack() as streams:
            readers = [needed("mcap.reader").make_reader(streams.enter_context(file.open("rb"))) for file in files]
            rows = [reader.iter_messages(starting_at=begin_ns, ending_before=end_ns) for reader in readers]
            for _, channel, message in heapq.merge(*rows, key=lambda row: row[2].log_time):
                yield BagCopy(message.log_time, message.publish_time, channel.topic, message.data)

    def _messages(
        self, topics: Collection[str] | None, begin_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[tuple[Any, int, Any]]:
        wanted = [c for c in self._reader.connections if topics is None or c.topic in topics]
        if wanted:  # rosbags takes none for all
            yield from self._reader.messages(connections=wanted, start=begin_ns, stop=end_ns)

    def _mcap_files(self) -> list[Path]:
        files = sorted(self.path.glob("*.mcap")) if self.path.is_dir() else [self.path]
        return [file for file in files if file.suffix == ".mcap"]

    def _found_aliases(self) -> dict[str, str]:
        found: dict[str, str] = {}
        for file in self._mcap_files():
            with file.open("rb") as stream:
                summary = needed("mcap.reader").make_reader(stream).get_summary()
                channels = summary.channels.values() if summary is not None else ()
                found |= {channel.topic: channel.metadata[ALIAS] for channel in channels if ALIAS in channel.metadata}
        return found

    def facts(self) -> Mapping[str, str]:
        """Return what our recorder noted; nothing of other recorders' bags."""
        facts: dict[str, str] = {}
        for file in self._mcap_files():
            with file.open("rb") as stream, suppress(Exception):  # noted facts are a gift: none are no fault
                for record in needed("mcap.reader").make_reader(stream).iter_metadata():
                    if record.name == NOTE:
                        facts |= record.metadata
        return facts


def _refuse_incomplete(path: Path) -> None:
    if not path.exists():
        raise failure(Code.BAD_REQUEST, f"there is no {path}", field="bag", hint="name a folder or file that exists")
    if path.is_dir() and not (path / METADATA).exists() and list(path.glob(f"*{ACTIVE}")):
        message = f"{path} is still being recorded, or its recorder was killed"
        hint = f"if nothing records there any more: ta2 record recover {path}"
        raise failure(Code.BAD_REQUEST, message, field="bag", hint=hint)
