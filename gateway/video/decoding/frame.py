"""One decoded picture: immutable, with its views, its times, and whether anything in it is damaged."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from gateway.video.decoding.views import VIEWS, view_of
from gateway.video.hevc.access_unit import CLOCK_HZ

__all__ = ["Frame", "RgbSource"]


class RgbSource(Protocol):
    """Where a frame has its RGB from."""

    def array(self) -> npt.NDArray[np.uint8]:
        """Return it, shape (height, width, 3), not writable; the same one each time."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A picture of all cameras.

    Attributes:
        source: Where its RGB comes from.
        seq: Counts published frames, from 0.
        rtp_time: RTP timestamp, unwrapped [ticks of 90 kHz]: the robot's clock of sending, not the cameras' trigger (§5.5).
        received_ns: When the picture's first packet arrived, monotonic [ns].
        published_ns: When it was published, monotonic [ns].
        clean: Whether nothing in it is damaged, nor was anything it is predicted from.
        lost: Ranges of RTP sequence numbers (first, last) that were lost since the last clean picture.
        life: Counts senders, from 0.
    """

    source: RgbSource
    seq: int
    rtp_time: int
    received_ns: int
    published_ns: int
    clean: bool
    lost: tuple[tuple[int, int], ...] = ()
    life: int = 0

    @property
    def rgb(self) -> npt.NDArray[np.uint8]:
        """The composite, RGB, shape (2720, 1280, 3), uint8; not writable, and never overwritten.

        It is converted by whoever asks first, some milliseconds of work: a picture that nobody looks at costs nothing.
        """
        return self.source.array()

    def __getitem__(self, name: str) -> npt.NDArray[np.uint8]:
        """Return a view by the manual's name (§5.2), `head_camera` for the composite: no copy, not writable.

        Raises:
            KeyError: If there is no such view.
        """
        return view_of(self.rgb, name)

    @property
    def views(self) -> Mapping[str, npt.NDArray[np.uint8]]:
        """All six views by name, without copies."""
        return {name: view_of(self.rgb, name) for name in VIEWS}

    @property
    def age_ns(self) -> int:
        """How long ago its first packet arrived [ns]."""
        return time.monotonic_ns() - self.received_ns

    @property
    def age(self) -> float:
        """How long ago its first packet arrived [s]."""
        return self.age_ns / 1e9

    @property
    def stream_s(self) -> float:
        """RTP time in seconds; only differences within one life of a sender mean anything."""
        return self.rtp_time / CLOCK_HZ
