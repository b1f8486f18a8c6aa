"""Small coded pictures for tests of the recorder: real H.265 that counts, as access units with times of their own."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from functools import cache

import av
import numpy as np

from gateway.video.hevc.access_unit import AccessUnit

__all__ = ["GOP", "HEIGHT", "PERIOD_NS", "PERIOD_TICKS", "WIDTH", "grey_of", "units"]

WIDTH, HEIGHT = 160, 340
GOP = 10
PERIOD_TICKS = 2000
PERIOD_NS = 22_222_222
START_NS = 5_000_000_000
START_TICKS = 123_456_789


def grey_of(n: int) -> int:
    """Return the luma of picture n."""
    return 40 + 7 * n % 160


@cache
def units(count: int = 40, *, life: int = 0, ssrc: int = 7, gop: int = GOP) -> tuple[AccessUnit, ...]:
    """Return coded pictures of one sender, an IRAP every `gop`."""
    coder = av.CodecContext.create("libx265", "w")
    coder.width, coder.height, coder.pix_fmt = WIDTH, HEIGHT, "yuv420p"
    coder.time_base, coder.framerate = Fraction(1, 90_000), Fraction(45)
    parameters = f"keyint={gop}:min-keyint={gop}:scenecut=0:repeat-headers=1:log-level=none:pools=1:frame-threads=1"
    coder.options = {"preset": "ultrafast", "tune": "zerolatency", "x265-params": parameters}
    packets = []
    for n in range(count):
        planes = np.full((HEIGHT * 3 // 2, WIDTH), 128, np.uint8)
        planes[:HEIGHT] = grey_of(n)
        picture = av.VideoFrame.from_ndarray(planes, format="yuv420p")
        picture.pts, picture.time_base = n, Fraction(1, 45)
        packets += coder.encode(picture)
    packets += coder.encode(None)
    first = AccessUnit(
        data=b"",
        seq=0,
        rtp_time=START_TICKS,
        first_packet_ns=START_NS,
        complete_ns=START_NS,
        is_intact=True,
        is_irap=True,
        has_parameter_sets=True,
        lost=(),
        ssrc=ssrc,
        life=life,
    )
    return tuple(
        replace(
            first,
            data=bytes(packet),
            seq=n,
            rtp_time=START_TICKS + n * PERIOD_TICKS,
            first_packet_ns=START_NS + n * PERIOD_NS,
            complete_ns=START_NS + n * PERIOD_NS + 9_000_000,
            is_irap=packet.is_keyframe,
            has_parameter_sets=packet.is_keyframe,
        )
        for n, packet in enumerate(packets)
    )
