"""How the six views are encoded when a recording is split."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from gateway.errors import Code, failure

__all__ = ["CODECS", "Coding"]

CODECS: Final[Mapping[str, str]] = {"h264": "libx264", "h265": "libx265"}
"""By name, who encodes it."""
QUALITY = 20
LIVE_QUALITY = 23
"""Constant rate factors: little visible loss; live, about the bitrate of the original."""
TREELESS_QUALITY = 23
"""Without x264's macroblock tree, which shifts the factor: files are about as large as with `QUALITY` and it."""
PRESETS: Final = {
    ("h264", False): "veryfast",
    ("h264", True): "ultrafast",
    ("h265", False): "superfast",
    ("h265", True): "ultrafast",
}
"""By codec, and whether it has to keep up with a camera: six views in H.264 take half a core then, in H.265 three."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Coding:
    """How views are encoded.

    Attributes:
        codec: `h264`, which everything plays, or `h265`.
        is_all_intra: Whether each picture stands alone: several times the size, and any of them is found at once.
        is_live: Whether it has to keep up with a camera.
        gop: Every so manieth picture stands alone; 0 leaves that to the encoder.
        threads: Of each view, which cut its pictures into as many slices; 0 takes the host's processors.
        is_repeatable: Whether H.264 of the same pictures shall be the same bytes each time, with `threads` that are given.
    """

    codec: str = "h264"
    is_all_intra: bool = False
    is_live: bool = False
    gop: int = 0
    threads: int = 0
    is_repeatable: bool = False

    def __post_init__(self) -> None:
        """Refuse a codec that there is not."""
        if self.codec not in CODECS:
            message, hint = f"no codec {self.codec!r} for the views", f"take one of {', '.join(CODECS)}"
            raise failure(Code.BAD_REQUEST, message, field="codec", hint=hint)

    @property
    def encoder(self) -> str:
        """Who encodes it, by the name libavcodec has for it."""
        return CODECS[self.codec]

    @property
    def options(self) -> dict[str, str]:
        """What the encoder is told: no picture refers to a later one, so that none waits."""
        options = {
            "preset": PRESETS[self.codec, self.is_live],
            "crf": str(LIVE_QUALITY if self.is_live else QUALITY),
            "bf": "0",
            "threads": str(self.threads),
        }
        if self.is_all_intra or self.gop:
            options["g"] = "1" if self.is_all_intra else str(self.gop)
        if self.is_repeatable and self.codec == "h264":
            # With AVX-512 x264's tree takes macroblocks of a row by eights, and with the last ones what lies in memory behind.
            options |= {"mbtree": "0", "crf": str(TREELESS_QUALITY)}
        if self.codec == "h265":
            options["x265-params"] = f"log-level=none:info=0:pools={os.cpu_count() or 1}:frame-threads=1"
        return options
