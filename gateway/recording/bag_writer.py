"""A bag that is being written: a folder with one MCAP file, and `metadata.yaml` once it is complete.

Rules
    * Chunks are closed and handed to the disk every half second: whatever ends this process costs no more than the last one.
    * The file is called `.mcap.active` until it is complete, so that nobody takes half of one for whole, and locked as
      long, so that nobody recovers what is still being written.
    * Its memory does not grow: where its chunks are is on the disk, too, until the end.
    * `metadata.yaml` is of rosbag2's version 5, the only one that Humble and all later releases read.

Libraries: mcap. Knows topics and bytes, no zenoh and no clock.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import pickle
import tempfile
from array import array
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from cdr_types.schemas import definition
from gateway import __version__
from gateway.errors import Code, failure
from gateway.process.growing import claim
from gateway.recording.topics import RecordedTopic

__all__ = ["ACTIVE", "ALIAS", "METADATA", "NOTE", "OFFSET", "BagWriter", "bag_file", "needed"]

ACTIVE = ".active"
METADATA = "metadata.yaml"
NOTE = "ta2"
"""Name of the facts about a recording in its bag."""
OFFSET = "arrival_minus_stamp_ns"
"""Begin of the name of such a fact; the topic's follows: the smallest distance of the clocks that it shows [ns]."""
ALIAS = "ta2_alias_of"
"""In a channel's metadata, the topic that it repeats under another name."""
CHUNK_BYTES = 512 * 1024
"""A chunk is closed before it is larger: some one and a half seconds of a robot's whole state."""


def needed(module: str, extra: str = "record") -> Any:  # noqa: ANN401  a module without types of its own
    """Return a module of the packages that recording takes, as an extra names them.

    Raises:
        Rejected: BAD_REQUEST, it is not installed.
    """
    import importlib

    try:
        return importlib.import_module(module)
    except ImportError as error:
        hint = f"install it: pip install 'teleavatar-gateway[{extra}]'"
        message = f"this takes {module.partition('.')[0]}, which is not installed ({error})"
        raise failure(Code.BAD_REQUEST, message, hint=hint) from None


def bag_file(folder: Path) -> Path:
    """Return where the data of a bag are, as rosbag2 names its first file."""
    return folder / f"{folder.resolve().name}_0.mcap"


class _Spilled:
    """Where chunks are, kept in a file without a name until the bag's end: in memory they would be 12 MB after an hour."""

    def __init__(self, folder: Path) -> None:
        self._file = tempfile.TemporaryFile(dir=folder, buffering=0)  # closed by `close`
        self._sizes, self._end = array("I"), 0

    def append(self, index: object) -> None:
        """Keep one; called by mcap, as `__iter__` is.

        Raises:
            OSError: The disk is full, or failed: what was kept before is there.
        """
        data = pickle.dumps(index)
        self._file.seek(self._end)
        if self._file.write(data) != len(data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._sizes.append(len(data))
        self._end += len(data)

    def __iter__(self) -> Iterator[object]:
        self._file.seek(0)
        return (pickle.loads(self._file.read(size)) for size in self._sizes)

    def close(self) -> None:
        """Forget them. May be called again."""
        self._file.close()


class BagWriter:
    """Writes one bag.

    Args:
        folder: Of the bag; made here, and must hold none yet.
        topics: Everything that it can hold.

    Raises:
        Rejected: BAD_REQUEST, the folder is not empty or cannot be written; mcap is missing.
    """

    def __init__(self, folder: Path, topics: Sequence[RecordedTopic]) -> None:
        writing = needed("mcap.writer")
        self.folder = folder
        self.counts = [0] * len(topics)
        """Messages of each topic."""
        self._topics = topics
        self._first_ns = self._last_ns = 0
        self._size_bytes = 0
        self._file = _claimed(folder)
        claim(self._file)
        self._writer = writing.Writer(self._file, chunk_size=CHUNK_BYTES, compression=writing.CompressionType.ZSTD)
        self._indices = self._writer._Writer__chunk_indices = _Spilled(folder)
        self._add = self._writer.add_message
        self._writer.start(profile="ros2", library=f"teleavatar-gateway {__version__}")
        kinds = [(topic.type_name, topic.encoding, topic.definition or definition(topic.type_name)) for topic in topics]
        schemas = {
            (name, encoding, text): self._writer.register_schema(name=name, encoding=encoding, data=text.encode())
            for name, encoding, text in dict.fromkeys(kinds)
        }
        self._channels = [
            self._writer.register_channel(
                topic=topic.name,
                message_encoding="cdr",
                schema_id=schemas[kind],
                metadata={"offered_qos_profiles": topic.qos} | ({ALIAS: topic.alias_of} if topic.alias_of else {}),
            )
            for topic, kind in zip(topics, kinds, strict=True)
        ]

    @property
    def size_bytes(self) -> int:
        """Of the file by now, without the chunk that is open [bytes]."""
        return self._size_bytes if self._file.closed else int(self._file.tell())

    def add(self, number: int, log_ns: int, publish_ns: int, payload: bytes) -> None:
        """Add a message.

        Args:
            number: Which topic.
            log_ns: When it came, by this host's wall clock [ns].
            publish_ns: When it was sent, by the sender's clock [ns]; the same where nobody knows.
            payload: As it came.
        """
        if log_ns > self._last_ns:
            self._last_ns = log_ns
        if log_ns < self._first_ns or not self._first_ns:
            self._first_ns = log_ns
        count = self.counts[number] = self.counts[number] + 1
        self._add(self._channels[number], log_ns, payload, publish_ns, count)

    def note(self, facts: Mapping[str, str]) -> None:
        """Add facts about the recording itself, under `NOTE`."""
        self._writer.add_metadata(NOTE, dict(facts))

    def flush(self) -> None:
        """Hand everything so far to the disk, and wait for it.

        Raises:
            OSError: The disk is full, or failed.
        """
        # mcap closes chunks by their size alone; a robot that says little would leave minutes in memory.
        self._writer._Writer__finalize_chunk()
        self._file.flush()
        os.fdatasync(self._file.fileno())

    def finish(self) -> Path:
        """Complete the bag and return its file.

        Raises:
            OSError: The disk is full, or failed: what is there can be recovered.
        """
        self._writer.finish()
        self._file.flush()
        os.fsync(self._file.fileno())
        self.abandon()
        path = bag_file(self.folder)
        (self.folder / METADATA).write_text(
            metadata(path.name, self._topics, self.counts, self._first_ns, self._last_ns), encoding="utf-8"
        )
        os.rename(f"{path}{ACTIVE}", path)
        return path

    def abandon(self) -> None:
        """Close the file as it is: what is there can be recovered. May be called again."""
        self._indices.close()
        if not self._file.closed:
            self._size_bytes = int(self._file.tell())
            with contextlib.suppress(OSError):  # it flushes once more; it is closed all the same
                self._file.close()

    def discard(self) -> None:
        """Take the bag away again, and its folder if nothing else is in it."""
        self.abandon()
        with contextlib.suppress(OSError):
            os.unlink(f"{bag_file(self.folder)}{ACTIVE}")
            self.folder.rmdir()


def _claimed(folder: Path) -> Any:  # noqa: ANN401  a binary file
    hint = "name a new folder with --out; bags are never overwritten"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise failure(Code.BAD_REQUEST, f"{folder} is not empty", field="out", hint=hint)
        return open(f"{bag_file(folder)}{ACTIVE}", "xb")
    except OSError as error:
        message = f"{folder} cannot be written: {error.strerror or error}"
        raise failure(Code.BAD_REQUEST, message, field="out", hint=hint) from error


def metadata(file: str, topics: Sequence[RecordedTopic], counts: Sequence[int], first_ns: int, last_ns: int) -> str:
    """Return the text of `metadata.yaml`; strings are written as JSON, which is YAML.

    Args:
        file: Name of the bag's file.
        topics: Of the bag; those without messages are left out.
        counts: Messages of each.
        first_ns: Arrival of the first message [ns].
        last_ns: Arrival of the last one [ns].
    """
    span = [
        f"duration: {{nanoseconds: {last_ns - first_ns}}}",
        f"starting_time: {{nanoseconds_since_epoch: {first_ns}}}",
        f"message_count: {sum(counts)}",
    ]
    rows = []
    for topic, count in zip(topics, counts, strict=True):
        if count:
            facts = {
                "name": topic.name,
                "type": topic.type_name,
                "serialization_format": "cdr",
                "offered_qos_profiles": topic.qos,
            }
            rows.append(f"    - topic_metadata: {json.dumps(facts)}\n      message_count: {count}\n")
    return (
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n"
        + "".join(f"  {line}\n" for line in span)
        + f"  topics_with_message_count:{'' if rows else ' []'}\n"
        + "".join(rows)
        + '  compression_format: ""\n  compression_mode: ""\n'
        + f"  relative_file_paths: [{json.dumps(file)}]\n"
        + f"  files:\n    - path: {json.dumps(file)}\n"
        + "".join(f"      {line}\n" for line in span)
    )
