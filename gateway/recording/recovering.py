"""Makes a bag whole again whose recorder was killed: everything up to the last half second before its end.

What is whole is copied into a new file; the old one goes when the new one is on the disk. How far the clocks are apart,
which is noted at the end of a recording, is noted anew.
"""

from __future__ import annotations

import os
from pathlib import Path

from msgspec import Struct

from gateway.errors import Code, failure
from gateway.process.growing import is_growing
from gateway.recording.bag_writer import ACTIVE, CHUNK_BYTES, METADATA, NOTE, OFFSET, metadata, needed
from gateway.recording.topics import RecordedTopic

__all__ = ["Recovered", "recover"]

PARTIAL = ".recovering"


class Recovered(Struct, frozen=True, kw_only=True):
    """What came of it: the file, its messages, from the first to the last [s], and why reading ended before the file did."""

    file: Path
    messages: int
    duration_s: float
    torn: str


def recover(folder: Path) -> Recovered:
    """Recover the bag in a folder.

    Raises:
        Rejected: BAD_REQUEST, there is none that is incomplete, it is still being recorded, or it cannot be read or written.
    """
    torn = sorted(folder.glob(f"*.mcap{ACTIVE}"))
    if not torn:
        message = f"{folder}: there is no *.mcap{ACTIVE}: nothing to recover"
        hint = "an unfinished recording leaves one in its folder"
        raise failure(Code.BAD_REQUEST, message, field="folder", hint=hint)
    path = torn[0].with_suffix("")
    try:
        with torn[0].open("rb") as file:
            if is_growing(file):
                raise failure(Code.BAD_REQUEST, f"{folder} is being recorded: end that first", field="folder")
        return _copied(torn[0], path, folder)
    except OSError as error:
        message = f"{folder} cannot be recovered: {error.strerror or error}"
        raise failure(Code.BAD_REQUEST, message, field="folder") from error


def _copied(torn: Path, path: Path, folder: Path) -> Recovered:
    reading, writing, records = needed("mcap.stream_reader"), needed("mcap.writer"), needed("mcap.records")
    schemas: dict[int, tuple[str, int]] = {}
    channels: dict[int, int] = {}
    topics: list[RecordedTopic] = []
    counts: list[int] = []
    place: dict[int, int] = {}
    offsets_ns: dict[str, int] = {}
    first_ns = last_ns = 0
    why = ""
    partial = path.with_name(path.name + PARTIAL)
    with torn.open("rb") as source, partial.open("wb") as target:
        writer = writing.Writer(target, chunk_size=CHUNK_BYTES, compression=writing.CompressionType.ZSTD)
        writer.start(profile="ros2", library="teleavatar-gateway recover")
        whole = iter(reading.StreamReader(source, validate_crcs=True).records)
        while True:
            try:
                record = next(whole)
            except StopIteration:
                break
            except Exception as error:  # noqa: BLE001  whatever a torn record makes of a reader: here the whole part ends
                why = f"{type(error).__name__}: {error}".rstrip(": ")
                break
            if isinstance(record, records.Schema) and record.id not in schemas:
                number = writer.register_schema(name=record.name, encoding=record.encoding, data=record.data)
                schemas[record.id] = record.name, number
            elif isinstance(record, records.Channel) and record.id not in channels:
                name, number = schemas[record.schema_id]
                channels[record.id] = writer.register_channel(
                    topic=record.topic,
                    message_encoding=record.message_encoding,
                    schema_id=number,
                    metadata=record.metadata,
                )
                place[record.id] = len(topics)
                topics.append(RecordedTopic(name=record.topic, type_name=name))
                counts.append(0)
            elif isinstance(record, records.Message):
                writer.add_message(
                    channels[record.channel_id], record.log_time, record.data, record.publish_time, record.sequence
                )
                number = place[record.channel_id]
                counts[number] += 1
                if offset_ns := record.log_time - record.publish_time:
                    name = OFFSET + topics[number].name
                    offsets_ns[name] = min(offset_ns, offsets_ns.get(name, offset_ns))
                first_ns = min(first_ns or record.log_time, record.log_time)
                last_ns = max(last_ns, record.log_time)
            elif isinstance(record, records.Metadata):
                writer.add_metadata(record.name, record.metadata)
            elif isinstance(record, records.DataEnd):  # what follows repeats it
                break
        writer.add_metadata(NOTE, {name: str(offset_ns) for name, offset_ns in offsets_ns.items()})
        writer.finish()
        target.flush()
        os.fsync(target.fileno())
    (folder / METADATA).write_text(metadata(path.name, topics, counts, first_ns, last_ns), encoding="utf-8")
    os.rename(partial, path)
    torn.unlink()
    return Recovered(file=path, messages=sum(counts), duration_s=(last_ns - first_ns) / 1e9, torn=why)
