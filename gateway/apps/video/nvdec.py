"""NVIDIA's decoder, taken only after it decoded the stream's own first key picture exactly as the software does.

H.265 decoding is exact: two decoders that both work give the same samples. A machine without a GPU, without the driver or
with a GPU that cannot decode this stream ends in a reason, never in an exception and never in a black picture.

Two ways lead there: FFmpeg's own decoder with CUDA beneath, which gives each picture at once, and `hevc_cuvid`, whose
parser waits for the picture after it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gateway.apps.video.libav import HWAccel, av
from gateway.apps.video.rgb import rows_of

__all__ = ["WAYS", "difference", "open_nvdec"]

COMPARABLE = ("yuv420p", "yuvj420p", "nv12")
"""Formats whose first plane is luma of 8 bits."""


def _on_cuda() -> av.VideoCodecContext:
    return av.VideoCodecContext.create("hevc", "r", HWAccel("cuda", allow_software_fallback=False))


def _on_cuvid() -> av.VideoCodecContext:
    context = av.CodecContext.create("hevc_cuvid", "r")
    assert isinstance(context, av.VideoCodecContext)
    return context


WAYS: dict[str, Callable[[], av.VideoCodecContext]] = {"hevc on cuda": _on_cuda, "hevc_cuvid": _on_cuvid}
"""Ways to NVDEC, the better one first."""


def open_nvdec(
    key_picture: bytes, expected: av.VideoFrame, prepare: Callable[[av.VideoCodecContext], None]
) -> tuple[av.VideoCodecContext | None, str]:
    """Return a decoder that has proved itself, and its name; or None, and why not.

    Args:
        key_picture: Annex B, with parameter sets.
        expected: It as the software decodes it.
        prepare: Sets the context's options before it is opened.
    """
    reasons = []
    for name, create in WAYS.items():
        context = None
        try:
            context = create()
            prepare(context)
            found = [*context.decode(av.Packet(key_picture)), *context.decode(None)]
            reason = difference(found[0], expected) if found else "gave no picture"
        except (av.FFmpegError, RuntimeError, ValueError, NotImplementedError) as error:
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
