"""When ticks and snapshots come: how late the ticks were, when a snapshot is due, and how far apart they may be at rest."""

from __future__ import annotations

from collections import deque

from gateway.core.supervision.coordinator import AT_BASE, Coordinator
from gateway.messages.snapshot import LoopView
from gateway.robot.limits import ARM_WATCHDOG_NS

__all__ = ["REST_NS", "TICK_NS", "Pace", "is_idle"]

MS = 1_000_000
S = 1_000_000_000

TICK_NS = 10 * MS
"""The engine is ticked at least this often [ns] while anything is sent or owned: 100 Hz."""

REST_NS = 50 * MS
"""Ticks are at most this far apart [ns] while nobody owns the robot and nobody watches: half of the age at which the
robot's state is stale, so that the loss of it is still seen in time."""

UNWATCHED_PERIOD_NS = 200 * MS
"""Snapshots come this far apart while nobody listens [ns]."""

LATE_WINDOW_NS = 10 * S
"""The worst lateness is the worst of this long [ns]."""


class Pace:
    """Counts ticks and snapshots."""

    def __init__(self, snapshot_hz: float) -> None:
        self._snapshot_period_ns = round(S / snapshot_hz)
        self._last_snapshot_ns = -S
        self._snapshots = 0
        self._ticks = 0
        self._skipped = 0
        self._lateness: deque[tuple[int, int]] = deque()
        self._sent_ns: int | None = None  # when setpoints could leave last
        self._was_late = False

    def tick(self, now_ns: int, late_ns: int) -> None:
        """Note a tick."""
        self._ticks += 1
        if late_ns >= TICK_NS:
            self._skipped += late_ns // TICK_NS
        while self._lateness and self._lateness[-1][1] <= late_ns:
            self._lateness.pop()
        self._lateness.append((now_ns, late_ns))
        while now_ns - self._lateness[0][0] > LATE_WINDOW_NS:
            self._lateness.popleft()

    def gap_ns(self, now_ns: int, *, is_late: bool) -> int:
        """Note whether a tick is skipped; return for how long late ticks let no setpoint leave, until the next that may [ns].

        0 without a late tick. A gap longer than the arms' watchdog (manual §4.3) is told once: what is asked for after it
        begins from rest.

        Args:
            now_ns: Monotonic time of this tick [ns].
            is_late: Whether this tick is skipped: the next one is the earliest.
        """
        since_ns, was_late, self._was_late = self._sent_ns, self._was_late, is_late
        if not is_late:
            self._sent_ns = now_ns
        if since_ns is None or not (is_late or was_late):
            return 0
        gap_ns = now_ns - since_ns + is_late * TICK_NS
        if is_late and gap_ns > ARM_WATCHDOG_NS:
            self._sent_ns = None
        return gap_ns

    def snapshot_due(self, now_ns: int, *, is_watched: bool) -> int | None:
        """Return the number of the snapshot that is due now, from 1, or None."""
        period_ns = self._snapshot_period_ns if is_watched else UNWATCHED_PERIOD_NS
        if now_ns // period_ns == self._last_snapshot_ns // period_ns:
            return None
        self._last_snapshot_ns = now_ns
        self._snapshots += 1
        return self._snapshots

    def rest_ns(self, *, is_watched: bool) -> int:
        """Return how far apart ticks may be while nothing is under way [ns]: whoever listens gets every snapshot."""
        return min(REST_NS, self._snapshot_period_ns) if is_watched else REST_NS

    def view(self, late_ns: int) -> LoopView:
        """Return the figures for the outside, after a tick."""
        return LoopView(ticks=self._ticks, skipped=self._skipped, late_ns=late_ns, worst_late_ns=self._lateness[0][1])


def is_idle(coordinator: Coordinator) -> bool:
    """Return whether nobody owns the robot, nothing is sent or owed, and no course is under way."""
    return (
        coordinator.state in AT_BASE
        and coordinator.lease.owner is None
        and not coordinator.is_exiting
        and not coordinator.body.heartbeat.is_owed
        and coordinator.body.next_due_ns() is None
    )
