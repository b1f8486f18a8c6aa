"""Coded pictures that wait for whoever takes them: never more than can be caught up with, and what is dropped is counted.

    live      a picture that waits longer than 150 ms is too old: everything up to the newest picture that decoding can
              begin with is dropped; where none waits, everything until one comes
    keeping   (a recorder) nothing is too old; when there is no room, what comes is dropped up to the next such picture

Rules
    * It is the waiting that is measured, from when a picture was complete: time on the network cannot be caught up with.
    * Dropped pictures leave a hole in `AccessUnit.seq`: `AccessUnit.follows` tells whoever takes the next one.
    * In a stream without such pictures (no periodic IDR) it goes on after `BLIND_NS` with whatever comes: late is worse
      than damaged, and damaged is flagged.

Pure: times come in, nothing waits here.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from gateway.video.hevc.access_unit import AccessUnit
from gateway.video.receiving.counters import Tally

__all__ = ["BLIND_NS", "MAX_AGE_NS", "Keeping", "Live"]

MAX_AGE_NS: Final = 150_000_000
"""A picture that has waited for longer is too old [ns] (proposed, not measured: no picture a person would call late)."""
BLIND_NS: Final = 2_000_000_000
"""It goes on without a picture that decoding can begin with after this [ns]: twice the usual distance of two (assumed)."""
MAX_BYTES: Final = 128 << 20
"""Room for pictures that nobody takes [bytes]: 50 s of a stream of 20 Mbit/s."""
MAX_UNITS: Final = 4096
KEPT_UNITS: Final = 450
"""Pictures that wait for a slow disk: 10 s at 45 fps, some 25 MB at 20 Mbit/s."""


class Live:
    """For one who wants the newest.

    Args:
        tally: What counts the dropped.
        max_age_ns: Longest wait of a picture [ns].
    """

    def __init__(self, tally: Tally, max_age_ns: int = MAX_AGE_NS) -> None:
        self._tally = tally
        self._max_age_ns = max_age_ns
        self._units: deque[AccessUnit] = deque()
        self._bytes = 0
        self._skipping_ns: int | None = None  # since when everything is dropped
        self._has_hole = False  # whether something was dropped since the last one was taken
        self._drops_leading = False  # whether RASL pictures refer to what was dropped

    def __len__(self) -> int:
        """Return how many wait."""
        return len(self._units)

    def put(self, unit: AccessUnit) -> None:
        """Let a picture wait, or drop it."""
        if self._skipping_ns is not None:
            is_blind = not unit.is_entry
            if is_blind and unit.complete_ns - self._skipping_ns < BLIND_NS:
                self._tally.add(skipped=1)
                return
            self._tally.add(blind_starts=is_blind)
            self._skipping_ns, self._drops_leading = None, unit.is_irap
        elif self._drops_leading:
            if unit.is_rasl:
                self._tally.add(skipped=1)
                return
            self._drops_leading = False
        self._units.append(unit)
        self._bytes += len(unit.data)
        if unit.is_entry or self._is_full():
            self._catch_up(unit.complete_ns)

    def take(self, now_ns: int) -> AccessUnit | None:
        """Return the next picture; None when none waits that is young enough."""
        self._catch_up(now_ns)
        if not self._units:
            return None
        self._has_hole = False
        return self._pop()

    def _catch_up(self, now_ns: int) -> None:
        is_full = self._is_full()
        if not self._units or (now_ns - self._units[0].complete_ns <= self._max_age_ns and not is_full):
            return
        newest = next((n for n in range(len(self._units) - 1, -1, -1) if self._units[n].is_entry), None)
        if newest is None or (newest == 0 and is_full):
            newest, self._skipping_ns = len(self._units), now_ns
        if not newest:
            return
        self._tally.add(skips=not self._has_hole, skipped=newest)
        self._has_hole = True
        for _ in range(newest):
            self._pop()
        if self._units:
            self._drop_leading()

    def _drop_leading(self) -> None:
        """Drop what follows the first picture and refers to what was dropped before it."""
        first = self._pop()
        while self._units and self._units[0].is_rasl:
            self._pop()
            self._tally.add(skipped=1)
        self._drops_leading = not self._units
        self._units.appendleft(first)
        self._bytes += len(first.data)

    def _pop(self) -> AccessUnit:
        unit = self._units.popleft()
        self._bytes -= len(unit.data)
        return unit

    def _is_full(self) -> bool:
        return self._bytes > MAX_BYTES or len(self._units) > MAX_UNITS


class Keeping:
    """For one who wants all of them."""

    def __init__(self, tally: Tally, max_bytes: int = MAX_BYTES) -> None:
        self._tally = tally
        self._max_bytes = max_bytes
        self._units: deque[AccessUnit] = deque()
        self._bytes = 0
        self._dropping_ns: int | None = None

    def __len__(self) -> int:
        """Return how many wait."""
        return len(self._units)

    def put(self, unit: AccessUnit) -> None:
        """Let a picture wait, or drop it."""
        has_room = self._bytes + len(unit.data) <= self._max_bytes and len(self._units) < KEPT_UNITS
        may_enter = self._dropping_ns is None or unit.is_entry or unit.complete_ns - self._dropping_ns >= BLIND_NS
        if not (has_room and may_enter):
            self._tally.add(recorder_dropped=1)
            if self._dropping_ns is None:
                self._dropping_ns = unit.complete_ns
            return
        self._dropping_ns = None
        self._units.append(unit)
        self._bytes += len(unit.data)

    def take(self, now_ns: int) -> AccessUnit | None:
        """Return the next picture; None when none waits.

        Args:
            now_ns: Monotonic time [ns]; nothing here becomes too old.
        """
        if not self._units:
            return None
        unit = self._units.popleft()
        self._bytes -= len(unit.data)
        return unit
