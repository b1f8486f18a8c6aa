"""RTP timestamps as a time that never falls: 32 bits unwrapped, jumps recognised (RFC 7798 section 4.1).

A clock may step and a sender may start again with the same SSRC; the times alone look the same. Whether a jump is the one
or the other, the sequence numbers say: `Stream` decides.
"""

from __future__ import annotations

from typing import Final

from gateway.video.hevc.access_unit import CLOCK_HZ

__all__ = ["RtpClock"]

MAX_FALL: Final = CLOCK_HZ // 2
"""Pictures sent in another order than they are shown in fall by less [ticks]."""
MAX_AHEAD: Final = 10 * CLOCK_HZ
"""A sender's clock runs ahead of ours by less, from one picture to the next [ticks]."""
S: Final = 1_000_000_000
_TURN: Final = 1 << 32


class RtpClock:
    """The times of one life of a sender.

    Args:
        timestamp: Of its first packet [ticks].
        now_ns: When that came, monotonic [ns].
    """

    def __init__(self, timestamp: int, now_ns: int) -> None:
        self.time = timestamp
        """The newest time, unwrapped [ticks]."""
        self.stamp = timestamp
        """The newest timestamp, as it was sent [ticks]."""
        self._at_ns = now_ns
        self._highest = timestamp  # of what was sent; `time` is above it after a fall or a jump
        self._offset = 0

    def is_jump(self, timestamp: int, now_ns: int) -> bool:
        """Return whether a timestamp cannot follow the one before.

        Args:
            timestamp: Of a packet, modulo 2^32 [ticks].
            now_ns: When it came [ns].
        """
        step = _signed(timestamp - self._highest)
        return step < -MAX_FALL or step > MAX_AHEAD + max(0, now_ns - self._at_ns) * CLOCK_HZ // S

    def follow(self, timestamp: int, now_ns: int) -> bool:
        """Go on to the time of the next packet in `time`; return whether it is earlier than the one before.

        Args:
            timestamp: Of a packet in order, modulo 2^32, no jump [ticks].
            now_ns: When it came [ns].
        """
        self._at_ns = now_ns
        if timestamp == self.stamp:
            return False
        self.stamp = timestamp
        highest = self._highest + _signed(timestamp - self._highest)
        falls = highest <= self._highest
        self._highest = max(highest, self._highest)
        self.time = max(highest + self._offset, self.time + 1)
        return falls

    def step_over(self, timestamp: int, now_ns: int, step: int) -> None:
        """Go on behind a jump of the clock, as if no more than a step had passed.

        Args:
            timestamp: Behind the jump [ticks].
            now_ns: When it came [ns].
            step: Usual distance of two pictures [ticks].
        """
        self.time += max(1, step)
        self.stamp = self._highest = timestamp
        self._offset = self.time - timestamp
        self._at_ns = now_ns


def _signed(difference: int) -> int:
    """Return a difference of timestamps as one between -2^31 and 2^31 - 1."""
    return (difference + _TURN // 2) % _TURN - _TURN // 2
