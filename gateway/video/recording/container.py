"""A recording's file: the robot's pictures as they came, remuxed without re-encoding, with their exact times.

Matroska, or fragmented MP4 by the file's name: both are readable up to the last third of a second (MP4: the last IRAP)
when the writer is killed; a plain MP4 is not readable at all.

libavformat writes Matroska in milliseconds, which would move each picture by up to half of one. Matroska itself counts
in any number of nanoseconds (TimestampScale, RFC 9559 section 5.1.2.9): with 11111 ns, just below a tick of 90 kHz, every
tick has a number of its own and can be told from it. The muxer believes in milliseconds; the file says the truth.
"""

from __future__ import annotations

import io
import os
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Final

from gateway.errors import Code, failure
from gateway.process.growing import claim
from gateway.video.decoding.libav import av
from gateway.video.hevc.access_unit import CLOCK_HZ, AccessUnit

if TYPE_CHECKING:
    from av.container import OutputContainer
    from av.stream import Stream

__all__ = ["SUFFIXES", "TROUBLE", "Container", "ticks_of"]

TROUBLE: Final = (OSError, ValueError, av.FFmpegError)
"""What reading and writing files raises, with libavformat and without."""
TICK: Final = Fraction(1, CLOCK_HZ)
MILLISECOND: Final = Fraction(1, 1000)
SCALE_NS = 11_111
"""Nanoseconds of one unit of Matroska time."""
SCALE_BELIEVED: Final = b"\x2a\xd7\xb1\x83" + (1_000_000).to_bytes(3, "big")
SCALE_WRITTEN: Final = b"\x2a\xd7\xb1\x83" + SCALE_NS.to_bytes(3, "big")
"""The element as the muxer writes it, and as the file has it (EBML: id, length 3, value)."""
HEAD_BYTES = 4096
"""Only there it is looked for: it stands in front of all pictures."""

MATROSKA: Final = {
    "write_crc32": "0",  # of the element that is changed
    "cluster_time_limit": "30000",  # [SCALE_NS]: a third of a second; 16 bits hold no more
    "flush_packets": "1",
}
FRAGMENTED_MP4: Final = {
    "movflags": "frag_keyframe+empty_moov+default_base_moof",
    "frag_duration": "500000",  # [us], for streams without periodic IRAPs
    "video_track_timescale": str(CLOCK_HZ),
    "flush_packets": "1",
}
SUFFIXES: Final = {".mkv": "matroska", ".mp4": "mp4"}
"""By the ending of a file's name, its format."""


def ticks_of(pts: int, time_base: Fraction) -> int:
    """Return a time in a recording's file as ticks of CLOCK_HZ, exactly as it was recorded."""
    return round(pts * time_base * CLOCK_HZ)


class Container:
    """Writes a recording.

    Args:
        path: Of the file; its ending says the format, and there must be no such file.

    Raises:
        Rejected: BAD_REQUEST, no such format.
        OSError: The file exists, or cannot be written.
    """

    def __init__(self, path: Path) -> None:
        kind = SUFFIXES.get(path.suffix.lower())
        if kind is None:
            message = f"{path.name} is no recording that can be written"
            hint = f"name it .mkv (safest), or .mp4, not {path.suffix or 'without an ending'}"
            raise failure(Code.BAD_REQUEST, message, field="file", hint=hint)
        self._kind = kind
        self._file = _ScaledFile(path)
        self._output: OutputContainer | None = None
        self._stream: Stream | None = None
        self.width = 0
        self.height = 0

    def open(self, unit: AccessUnit) -> bool:
        """Take the size from the first picture and open the file for it; return whether the picture says its size.

        Args:
            unit: An intact IRAP with its parameter sets.

        Raises:
            OSError: The file cannot be written.
        """
        options = MATROSKA if self._kind == "matroska" else FRAGMENTED_MP4
        try:
            with av.open(io.BytesIO(unit.data), format="hevc") as first:
                template = first.streams.video[0]
                self.width, self.height = template.width, template.height
                if not self.width or not self.height:
                    return False
                self._output = av.open(self._file, "w", format=self._kind, options=options)
                self._stream = self._output.add_stream_from_template(
                    template, opaque=True
                )  # else PyAV opens an encoder
        except (av.InvalidDataError, IndexError):
            return False
        self._stream.time_base = TICK
        return True

    def write(self, unit: AccessUnit, pts: int) -> None:
        """Append a picture.

        Args:
            unit: The picture.
            pts: Where it stands [ticks of CLOCK_HZ]; more than that of the one before.

        Raises:
            OSError: The file cannot be written.
        """
        assert self._output is not None and self._stream is not None
        packet = av.Packet(unit.data)
        if self._kind == "matroska":
            packet.pts = packet.dts = round(pts * 1_000_000_000 / (CLOCK_HZ * SCALE_NS))
            packet.time_base = MILLISECOND
        else:
            packet.pts = packet.dts = pts
            packet.time_base = TICK
        packet.stream = self._stream
        packet.is_keyframe = unit.is_irap
        self._output.mux_one(packet)

    def close(self) -> None:
        """End the file, so that it can be searched in.

        Raises:
            OSError: The end cannot be written; what stands in the file is readable.
        """
        try:
            if self._output is not None:
                self._output.close()
        finally:
            self._file.close()


class _ScaledFile:
    """A file as libavformat sees it, in which the Matroska head gets its true unit of time."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)
        claim(self._file)
        self.name = os.fspath(path)

    def write(self, data: bytes) -> int:
        at = self._file.tell()
        if at < HEAD_BYTES:
            data = bytes(data).replace(SCALE_BELIEVED, SCALE_WRITTEN, 1)
        self._file.write(data)
        return len(data)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def close(self) -> None:
        self._file.close()
