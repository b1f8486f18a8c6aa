"""Why there is no picture, or no good one: what is wrong, in words, with a remedy. Of the video, as `ta2 why` of the robot.

Pure: what is known and the time in, findings out; the worst first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

from gateway.apps.video.counters import Counts
from gateway.apps.video.errors import VideoCode
from gateway.apps.video.stream import StreamFacts

__all__ = ["DecoderFacts", "Facts", "Finding", "why"]

S: Final = 1_000_000_000


class Finding(NamedTuple):
    """Something that is wrong.

    Attributes:
        code: Stable code.
        message: One sentence with the numbers.
        hint: What to do.
    """

    code: VideoCode
    message: str
    hint: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DecoderFacts:
    """What a decoder knows of itself.

    Attributes:
        name: What decodes.
        frames: Published.
        recent_frames: Published in the time of `Facts.recent`.
        recent_errors: Pictures in that time that it could make nothing of.
        decode_ms: Usual time for one picture [ms].
    """

    name: str
    frames: int
    recent_frames: int
    recent_errors: int
    decode_ms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """What is known.

    Attributes:
        started_ns: When receiving began, monotonic [ns].
        port: UDP port.
        payload_type: The one that is wanted.
        sources: Addresses that are listened to; None: all.
        asked_bytes: Receive buffer asked for.
        granted_bytes: Receive buffer granted.
        counts: Counted since the receiver was made.
        recent: Counted in the last seconds.
        recent_since_ns: When those began [ns].
        stream: What was seen of the stream.
        error: What ended receiving; empty when nothing did.
        decoder: What the decoder knows; None without one.
    """

    started_ns: int
    port: int
    payload_type: int
    sources: tuple[str, ...] | None
    asked_bytes: int
    granted_bytes: int
    counts: Counts
    recent: Counts
    recent_since_ns: int
    stream: StreamFacts
    error: str = ""
    decoder: DecoderFacts | None = None


def why(facts: Facts, now_ns: int) -> tuple[Finding, ...]:
    """Return what is wrong, the worst first; empty when nothing is.

    Args:
        facts: What is known.
        now_ns: Monotonic time [ns].
    """
    return tuple(_of_this_host(facts))


def _of_this_host(facts: Facts) -> Iterator[Finding]:
    if facts.granted_bytes < facts.asked_bytes:
        yield Finding(
            VideoCode.RECEIVE_BUFFER_CAPPED,
            f"the receive buffer has {facts.granted_bytes} bytes instead of {facts.asked_bytes}: "
            "this host's kernel allows no more",
            f"raise it: sudo sysctl -w net.core.rmem_max={facts.asked_bytes}",
        )
