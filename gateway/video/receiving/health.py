"""How the video is: rates, latencies, counters, as numbers that do not change any more once they are handed out."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from statistics import median

from gateway.video.receiving.counters import Counts

__all__ = ["Health", "Meter", "Reading"]

RECENT_NS = 2_000_000_000
"""Rates and latencies are of so long [ns]."""
REMEMBERED = 512


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What the decoding thread measured.

    Attributes:
        frames: Published since the start.
        damaged: Of these, not clean.
        withheld: Damaged ones that strict mode did not publish.
        undecodable: Coded pictures that nothing could be made of: before the first key picture.
        errors: Coded pictures that the decoder refused.
        fps: Published per second, lately; 0 when none came lately.
        latency_ms: From a picture's first packet to its publication, the median of lately [ms]; 0 without any.
        worst_latency_ms: The longest of lately [ms].
        decode_ms: For decoding, the median of lately [ms]; RGB is made by whoever looks at a frame.
    """

    frames: int = 0
    damaged: int = 0
    withheld: int = 0
    undecodable: int = 0
    errors: int = 0
    fps: float = 0.0
    latency_ms: float = 0.0
    worst_latency_ms: float = 0.0
    decode_ms: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """Everything that is counted and measured, at one instant.

    Attributes:
        decoder: What decodes, e.g. `software (2 slice threads)`.
        decoder_note: Why it is this one.
        reading: Of the decoding thread.
        counts: Of the receiving thread: packets, losses, whatever was refused.
        granted_bytes: Receive buffer that the kernel granted [bytes]; None before the start.
        age_s: Of the newest frame, from its first packet on [s]; None before the first.
    """

    decoder: str
    decoder_note: str
    reading: Reading
    counts: Counts
    granted_bytes: int | None
    age_s: float | None


class Meter:
    """Measures in one thread; any other may read."""

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._frames: deque[tuple[int, int, int]] = deque(maxlen=REMEMBERED)  # published, latency, decoding [ns]
        self._errors: deque[int] = deque(maxlen=REMEMBERED)
        self._counts = dict.fromkeys(("frames", "damaged", "withheld", "undecodable", "errors"), 0)

    def add(self, **counts: int) -> None:
        """Add to the counters named."""
        with self._guard:
            for name, count in counts.items():
                self._counts[name] += count

    def published(self, now_ns: int, latency_ns: int, decoding_ns: int, *, clean: bool) -> None:
        """Take note of a frame."""
        with self._guard:
            self._frames.append((now_ns, latency_ns, decoding_ns))
            self._counts["frames"] += 1
            self._counts["damaged"] += not clean

    def refused(self, now_ns: int) -> None:
        """Take note of a coded picture that the decoder refused."""
        with self._guard:
            self._errors.append(now_ns)
            self._counts["errors"] += 1

    def since(self, since_ns: int) -> tuple[int, int]:
        """Return how many frames were published and how many pictures refused since an instant, as far as remembered."""
        with self._guard:
            return sum(at >= since_ns for at, _, _ in self._frames), sum(at >= since_ns for at in self._errors)

    def reading(self, now_ns: int) -> Reading:
        """Return what was measured."""
        with self._guard:
            counts = dict(self._counts)
            recent = [each for each in self._frames if each[0] >= now_ns - RECENT_NS]
        if not recent:
            return Reading(**counts)
        times, latencies, decodings = zip(*recent, strict=True)
        # A rate counts periods; when frames have stopped, the time since the newest one counts as well.
        period_ns = (times[-1] - times[0]) / (len(times) - 1) if len(times) > 1 else RECENT_NS
        silence_ns = now_ns - times[-1]
        covered_ns = times[-1] - times[0] + (silence_ns if silence_ns > 2 * period_ns else 0)
        fps = 1e9 * (len(times) - 1) / covered_ns if covered_ns else 0.0
        return Reading(
            **counts,
            fps=fps,
            latency_ms=median(latencies) / 1e6,
            worst_latency_ms=max(latencies) / 1e6,
            decode_ms=median(decodings) / 1e6,
        )
