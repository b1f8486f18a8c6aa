"""What a recording holds, measured: rate, jitter, and which stretches of it are damaged. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gateway.video.hevc.access_unit import CLOCK_HZ
from gateway.video.recording.index import Picture

__all__ = ["Arrival", "Stretch", "Timing", "arrival_of", "stretches", "timing_of"]

MS = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """When pictures stand.

    Attributes:
        pictures: How many.
        duration_s: From the first to the last [s].
        fps: Measured: intervals by duration; 0 for fewer than two pictures [1/s].
        interval_p50_ms: From a picture to the next, usual [ms].
        interval_p99_ms: The same, one in a hundred is longer [ms].
        interval_max_ms: The longest [ms].
        jitter_ms: Standard deviation of the intervals [ms].
    """

    pictures: int
    duration_s: float
    fps: float
    interval_p50_ms: float
    interval_p99_ms: float
    interval_max_ms: float
    jitter_ms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrival:
    """How pictures arrived, against their sender's clock.

    Attributes:
        jitter_ms: Mean deviation from picture to picture, smoothed as RFC 3550 (6.4.1) has it, at the end [ms].
        spread_ms: 99th percentile of how much later than the quickest one they came, within a life of a sender [ms].
    """

    jitter_ms: float
    spread_ms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """Pictures in a row that are not clean.

    Attributes:
        first_s: Where it begins [s].
        last_s: Where its last picture stands [s].
        pictures: How many.
        lost_packets: Lost in it.
    """

    first_s: float
    last_s: float
    pictures: int
    lost_packets: int


def timing_of(pts: Sequence[int]) -> Timing:
    """Return when pictures stand.

    Args:
        pts: Of each, rising [ticks of CLOCK_HZ].
    """
    if len(pts) < 2:
        return Timing(
            pictures=len(pts),
            duration_s=0.0,
            fps=0.0,
            interval_p50_ms=0.0,
            interval_p99_ms=0.0,
            interval_max_ms=0.0,
            jitter_ms=0.0,
        )
    intervals_ms = np.diff(np.asarray(pts, np.int64)) * (1e3 / CLOCK_HZ)
    duration_s = (pts[-1] - pts[0]) / CLOCK_HZ
    p50_ms, p99_ms = np.percentile(intervals_ms, (50, 99))
    return Timing(
        pictures=len(pts),
        duration_s=duration_s,
        fps=(len(pts) - 1) / duration_s,
        interval_p50_ms=float(p50_ms),
        interval_p99_ms=float(p99_ms),
        interval_max_ms=float(intervals_ms.max()),
        jitter_ms=float(intervals_ms.std()),
    )


def arrival_of(pictures: Sequence[Picture]) -> Arrival | None:
    """Return how pictures arrived; None when there are too few."""
    if len(pictures) < 2:
        return None
    jitter_ns, lags_ns = 0.0, []
    for life in sorted({picture.life for picture in pictures}):
        own = [picture for picture in pictures if picture.life == life]
        lag_ns = [picture.arrival_ns - picture.rtp_time * 1_000_000_000 // CLOCK_HZ for picture in own]
        for before, after in pairwise(lag_ns):
            jitter_ns += (abs(after - before) - jitter_ns) / 16
        lags_ns += [lag - min(lag_ns) for lag in lag_ns]
    return Arrival(jitter_ms=jitter_ns / MS, spread_ms=float(np.percentile(lags_ns, 99)) / MS)


def stretches(pictures: Sequence[Picture]) -> tuple[Stretch, ...]:
    """Return the damaged stretches."""
    found: list[list[Picture]] = []
    before = None
    for picture in pictures:
        if not picture.clean:
            if before is None or before.clean:
                found.append([])
            found[-1].append(picture)
        before = picture
    return tuple(
        Stretch(
            first_s=row[0].pts / CLOCK_HZ,
            last_s=row[-1].pts / CLOCK_HZ,
            pictures=len(row),
            lost_packets=sum(last - first + 1 for picture in row for first, last in picture.lost),
        )
        for row in found
    )
