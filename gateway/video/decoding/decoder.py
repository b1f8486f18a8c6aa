"""From access units to pictures: FFmpeg's H.265 decoder in software, or NVIDIA's where it has proved itself.

Rules
    * One context for the whole life of a receiver: it goes on after a sender's restart.
    * Flushed before it is dropped, always: PyAV can wait for ever for a decoder that still holds pictures.
    * Slice threads and low delay: a picture comes out as it goes in, where its sender does not reorder.
    * What cannot be decoded is counted, never raised; what is damaged it conceals without a word (see `damage.py`).
"""

from __future__ import annotations

import logging
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

from gateway.video.decoding.libav import Flags, av
from gateway.video.decoding.nvdec import FAILURES, Probe
from gateway.video.hevc.access_unit import AccessUnit

__all__ = ["DecodedPicture", "Decoder", "DecoderChoice"]

DecoderChoice = Literal["auto", "software", "nvdec"]

MAX_PENDING = 32
"""Pictures that a stream may hold back for reordering, at most: twice the most of H.265 (A.4.2)."""
UNSPECIFIED_MATRIX = 2
"""matrix_coeffs of H.265, Table E.5."""
UNSPECIFIED_RANGE = 0
BARREN = 30
"""After so many intact access units without a picture a GPU's decoder is given up ..."""
ERROR_WEIGHT = 10
"""... where one that it refuses counts for so many: what is intact is not refused by a decoder that works."""

logger = logging.getLogger(__name__)


Mark = TypeVar("Mark")


@dataclass(frozen=True, slots=True)
class DecodedPicture(Generic[Mark]):
    """A picture, and a mark that was given with what it was decoded from.

    Attributes:
        mark: As given to `Decoder.decode`.
        picture: As the decoder left it: YUV.
    """

    mark: Mark
    picture: av.VideoFrame


class Decoder:
    """Decodes the access units of one stream. Not for several threads at once.

    Args:
        choice: `auto` and `nvdec` go over to the GPU once it has decoded a key picture exactly as the software does.
        threads: Of the software decoder; more help only where the stream has slices or wavefronts.
    """

    def __init__(self, choice: DecoderChoice = "auto", *, threads: int = 2) -> None:
        self._choice = choice
        self._threads = threads
        self._context = self._software()
        self._is_probing = choice != "software"
        self._probe: Probe | None = None
        self._given = 0
        self._marks: dict[int, Any] = {}
        self._barren = 0
        self.name = f"software ({threads} slice threads)"
        self.note = "" if choice == "software" else "NVDEC has not proved itself yet"
        self.errors = 0
        self.last_error = ""
        self.has_begun_anew = False

    def decode(self, unit: AccessUnit, mark: Mark, *, begins: bool = False) -> list[DecodedPicture[Mark]]:
        """Return the pictures that are complete now; none is lost by an error of another.

        Args:
            unit: The next one in the order of sending.
            mark: Comes back with its picture.
            begins: Whether it is a key picture after which nothing before it is needed: what is still held is given up.
        """
        self.has_begun_anew = False
        if not unit.data:
            return []  # FFmpeg would take it for the end of the stream
        if begins:
            self._forget()
        pictures = self._look_for_nvdec(unit) if self._is_probing else []
        packet = av.Packet(unit.data)
        packet.pts = packet.dts = self._given
        self._marks[self._given] = mark
        self._given += 1
        while len(self._marks) > MAX_PENDING:
            del self._marks[next(iter(self._marks))]
        weight = 1
        try:
            pictures += self._context.decode(packet)
        except FAILURES as error:
            weight = ERROR_WEIGHT
            self.errors += 1
            self.last_error = f"{type(error).__name__}: {error}"
        self._watch(unit, pictures, weight)
        for picture in pictures:
            self._name_colours(picture)
        return [DecodedPicture(self._marks.pop(p.pts), p) for p in pictures if p.pts in self._marks]

    def close(self) -> None:
        """Give back what it holds; it can be called again and again."""
        if self._probe is not None:
            self._probe.close()
            self._is_probing, self._probe = False, None
        self._forget()

    @property
    def is_nvdec(self) -> bool:
        """Whether the GPU decodes."""
        return self.name.startswith("nvdec")

    def _forget(self) -> None:
        self._marks.clear()
        self._barren = 0
        if self._context.is_open:
            self._context.flush_buffers()

    def _software(self) -> av.VideoCodecContext:
        context = av.VideoCodecContext.create("hevc", "r")
        _low_delay(context)
        context.thread_count = self._threads
        return context

    def _look_for_nvdec(self, unit: AccessUnit) -> list[av.VideoFrame]:
        """Prove NVDEC with the first key picture, then take it or say why not; return pictures the old decoder held."""
        is_key = unit.is_irap and unit.is_intact and unit.has_parameter_sets
        if self._probe is None:
            if is_key:
                self._probe = Probe(unit.data, self._software(), _low_delay)
            return []
        if (result := self._probe.take()) is None:
            return []
        context, why = result
        if context is None:
            self._is_probing, self._probe = False, None
            self.note = f"NVDEC is not used: {why}"
            logger.log(logging.WARNING if self._choice == "nvdec" else logging.INFO, "%s", self.note)
            return []
        if not is_key:
            return []
        self._is_probing, self._probe = False, None
        rest: list[av.VideoFrame] = []
        with suppress(av.FFmpegError):
            rest = self._context.decode(None)
        self._context.flush_buffers()
        self._context, self.name = context, f"nvdec ({why})"
        self.note = "NVDEC decoded a key picture exactly as the software did"
        logger.info("%s: %s", self.name, self.note)
        return rest

    def _name_colours(self, picture: av.VideoFrame) -> None:
        """Write into a picture what the stream says of its colours: it is lost on the way from a GPU's memory."""
        if picture.colorspace == UNSPECIFIED_MATRIX:
            picture.colorspace = self._context.colorspace
        if picture.color_range == UNSPECIFIED_RANGE:
            picture.color_range = self._context.color_range

    def _watch(self, unit: AccessUnit, pictures: list[av.VideoFrame], weight: int) -> None:
        """Go back to software when the GPU gives nothing any more; decoding then begins anew."""
        if pictures or not self.is_nvdec:
            self._barren = 0
            return
        self._barren += weight * unit.is_intact
        if self._barren >= BARREN:
            self.note = f"NVDEC was given up: no picture from intact access units. {self.last_error}".rstrip()
            logger.warning("%s", self.note)
            self._forget()
            self._context, self.name = self._software(), f"software ({self._threads} slice threads)"
            self.has_begun_anew = True


def _low_delay(context: av.VideoCodecContext) -> None:
    context.thread_type = "SLICE"
    # Without output_corrupt FFmpeg shows nothing from the loss of a whole picture on until the next key picture comes,
    # and where none comes nothing ever again.
    context.flags |= Flags.low_delay | Flags.output_corrupt
