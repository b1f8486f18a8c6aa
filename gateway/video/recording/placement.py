"""When each picture stands in a recording: by its sender's RTP time, also across senders. Pure.

Within one life of a sender a picture's time is its RTP time, exactly. A new sender counts from elsewhere: its first
picture stands as long after the last one as it arrived after it. So does a picture whose RTP time ran away from the
clock on the wall, which no camera does.
"""

from __future__ import annotations

from gateway.video.hevc.access_unit import CLOCK_HZ, AccessUnit

__all__ = ["RUNAWAY_S", "Placement"]

S = 1_000_000_000

RUNAWAY_S = 10
"""RTP time may be ahead of the time of arrival by this, since a sender began [s]: a host that was asleep reads packets late,
and 50 ppm of drift take 55 hours to get here."""


class Placement:
    """Places pictures one after another, beginning with 0."""

    def __init__(self) -> None:
        self._anchor: AccessUnit | None = None  # the picture from which others of its life are counted ...
        self._anchor_pts = 0  # ... and where that one stands
        self._newest: AccessUnit | None = None
        self._newest_pts = -1

    def place(self, unit: AccessUnit) -> int:
        """Return where a picture stands [ticks of CLOCK_HZ since the first one]; rises with every call."""
        anchor, newest = self._anchor, self._newest
        if anchor is None or newest is None:
            self._anchor, pts = unit, 0
        elif unit.life == anchor.life and not _ran_away(anchor, unit):
            pts = self._anchor_pts + unit.rtp_time - anchor.rtp_time
        else:
            pts = self._newest_pts + _ticks(unit.first_packet_ns - newest.first_packet_ns)
            self._anchor, self._anchor_pts = unit, max(pts, self._newest_pts + 1)
        self._newest, self._newest_pts = unit, max(pts, self._newest_pts + 1)
        return self._newest_pts


def _ran_away(anchor: AccessUnit, unit: AccessUnit) -> bool:
    ahead = unit.rtp_time - anchor.rtp_time - _ticks(unit.first_packet_ns - anchor.first_packet_ns)
    return ahead > RUNAWAY_S * CLOCK_HZ


def _ticks(duration_ns: int) -> int:
    return round(duration_ns * CLOCK_HZ / S)
