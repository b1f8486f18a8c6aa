"""NVIDIA's decoder, taken only after it decoded the stream's own first key picture exactly as the software does.

H.265 decoding is exact: two decoders that both work give the same samples. A machine without a GPU, without the driver or
with a GPU that cannot decode this stream ends in a reason, never in an exception and never in a black picture.

The proof takes the time that a GPU needs to wake up, about a second: it is made in a thread of its own, and pictures come
from the software meanwhile.

Two ways lead there: FFmpeg's own decoder with CUDA beneath, which gives each picture at once, and `hevc_cuvid`, whose
parser waits for the picture after it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np

from gateway.process.threads import supervised
from gateway.video.decoding.libav import HWAccel, av
from gateway.video.decoding.rgb import rows_of

__all__ = ["FAILURES", "WAYS", "Probe", "difference", "open_nvdec"]

COMPARABLE = ("yuv420p", "yuvj420p", "nv12")
"""Formats whose first plane is luma of 8 bits."""
FAILURES = (av.FFmpegError, RuntimeError, ValueError, MemoryError)
"""What PyAV raises when a way does not exist, or fails later on."""
CLOSE_S = 5.0
"""Longest wait for a proof that nobody wants any more [s]: a driver that hangs must not hold up whoever ends."""

logger = logging.getLogger(__name__)


def _on_cuda() -> av.VideoCodecContext:
    context = av.VideoCodecContext.create("hevc", "r", HWAccel("cuda", allow_software_fallback=False))
    if not context.is_hwaccel:  # PyAV makes one of software then, without a word: it would pass every proof
        raise RuntimeError("this FFmpeg was built without CUDA for H.265")
    return context


def _on_cuvid() -> av.VideoCodecContext:
    context = av.CodecContext.create("hevc_cuvid", "r")
    assert isinstance(context, av.VideoCodecContext)
    return context


WAYS: dict[str, Callable[[], av.VideoCodecContext]] = {"hevc on cuda": _on_cuda, "hevc_cuvid": _on_cuvid}
"""Ways to NVDEC, the better one first."""


class Probe:
    """Has a GPU prove itself; begins at once.

    `key_picture` is Annex B, with parameter sets; `software` a decoder of its own, to compare with.
    """

    def __init__(
        self,
        key_picture: bytes,
        software: av.VideoCodecContext,
        prepare: Callable[[av.VideoCodecContext], None],
    ) -> None:
        self._key_picture = key_picture
        self._software = software
        self._prepare = prepare
        self._result: tuple[av.VideoCodecContext | None, str] = (None, "it has not ended")
        self._thread = supervised(self._run, "video-nvdec-probe")
        self._thread.start()

    def take(self) -> tuple[av.VideoCodecContext | None, str] | None:
        """Return the decoder and its name, or None and why there is none; only None while that is not known."""
        return None if self._thread.is_alive() else self._result

    def close(self) -> None:
        """Wait for its end, not for long, and give up what nobody has taken; not for a decoder that is in use."""
        self._thread.join(CLOSE_S)
        if (result := self.take()) is None:
            logger.warning("NVDEC's driver has not answered the proof: it is left behind")
        elif (context := result[0]) is not None:
            context.flush_buffers()

    def _run(self) -> None:
        try:
            self._result = self._prove()
        except Exception as error:
            logger.warning("the proof of NVDEC ended by an error", exc_info=error)
            self._result = None, f"the proof ended by an error, {type(error).__name__}: {error}"

    def _prove(self) -> tuple[av.VideoCodecContext | None, str]:
        software = self._software
        try:
            expected = [*software.decode(av.Packet(self._key_picture)), *software.decode(None)]
        except av.FFmpegError:
            expected = []
        if software.is_open:
            software.flush_buffers()
        if not expected:
            return None, "the first key picture cannot be decoded at all"
        return open_nvdec(self._key_picture, expected[0], self._prepare)


def open_nvdec(
    key_picture: bytes, expected: av.VideoFrame, prepare: Callable[[av.VideoCodecContext], None]
) -> tuple[av.VideoCodecContext | None, str]:
    """Return a decoder that has proved itself, and its name; or None, and why not."""
    reasons = []
    for name, create in WAYS.items():
        context = None
        try:
            context = create()
            prepare(context)
            found = [*context.decode(av.Packet(key_picture)), *context.decode(None)]
            reason = difference(found[0], expected) if found else "gave no picture"
        except FAILURES as error:
            reason = f"{type(error).__name__}: {error}"
        if context is not None and context.is_open:
            context.flush_buffers()  # before it is used again, and before it is dropped
            if not reason:
                return context, name
        reasons.append(f"{name}: {reason}")
    return None, "; ".join(reasons)


def difference(found: av.VideoFrame, expected: av.VideoFrame) -> str:
    """Return how the luma of two pictures differs, in words; empty when it does not."""
    for picture in (found, expected):
        if picture.format.name not in COMPARABLE:
            return f"pictures of format {picture.format.name} cannot be compared"
    a, b = (rows_of(picture)[:, : picture.width] for picture in (found, expected))
    if a.shape != b.shape:
        return f"gave a picture of {found.width} x {found.height}, not {expected.width} x {expected.height}"
    wrong = int(np.count_nonzero(a != b))
    return f"decoded {wrong} of {a.size} pixels wrongly" if wrong else ""
