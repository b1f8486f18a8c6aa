"""One coded picture as it came off the network: what the depacketiser makes, and decoder and recorder take."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["CLOCK_HZ", "AccessUnit"]

CLOCK_HZ = 90_000
"""Ticks of RTP time per second (§5.1; RFC 7798 section 4.1)."""


@dataclass(frozen=True, slots=True)
class AccessUnit:
    """A coded picture.

    Attributes:
        data: Its NAL units in Annex B form (four-byte start codes); before an IRAP the parameter sets, also where the
            stream did not repeat them.
        seq: Counts access units of this stream, from 0; gaps are pictures of which nothing arrived, as far as known.
        rtp_time: RTP timestamp, unwrapped: never falls within one life of a sender [ticks of CLOCK_HZ].
        first_packet_ns: When its first packet arrived, monotonic [ns].
        complete_ns: When it was complete, monotonic [ns].
        is_intact: Whether all of its packets arrived.
        is_irap: Whether decoding can begin here (IDR, CRA or BLA).
        has_parameter_sets: Whether VPS, SPS and PPS are in `data`.
        lost: Ranges of RTP sequence numbers (first, last), unwrapped, that were lost in it or since the one before.
        ssrc: Of its sender.
        life: Counts senders, from 0: a new one restarts sequence numbers, RTP time and decoding.
        slice_type: NAL unit type of its slices (H.265 table 7-1).
        recovers_after: Pictures after which decoding that begins here is right, by its recovery point SEI; None without one.
    """

    data: bytes
    seq: int
    rtp_time: int
    first_packet_ns: int
    complete_ns: int
    is_intact: bool
    is_irap: bool
    has_parameter_sets: bool
    lost: tuple[tuple[int, int], ...]
    ssrc: int
    life: int
    slice_type: int = 0
    recovers_after: int | None = None

    @property
    def is_rasl(self) -> bool:
        """Whether it cannot be decoded when decoding began with the CRA before it (NAL types 8 and 9)."""
        return self.slice_type in (8, 9)

    @property
    def is_entry(self) -> bool:
        """Whether decoding can begin with it, and is right at once or soon: an intact IRAP or recovery point."""
        return self.is_intact and (self.is_irap or self.recovers_after is not None)

    def follows(self, before: AccessUnit) -> bool:
        """Return whether nothing is missing between another one and this one: what is predicted from it can be right."""
        return self.life == before.life and self.seq == before.seq + 1 and not self.lost
