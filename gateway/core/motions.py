"""Point-to-point motions: from acceptance to an end that is proven by the measured state.

A motion is `queued` until its first setpoint leaves, `executing` until it ends, and ends exactly once: `reached` when
every joint is *measured* within tolerance for the settling time, else `cancelled`, `superseded` or `aborted` with a code.
A motion of two arms ends for both: what takes one arm away ends the motion, and the other arm brakes and holds.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from enum import Enum
from operator import attrgetter, sub

from gateway.core.snapshot import MotionView
from gateway.errors import Code
from gateway.settings import ArmSettings
from gateway.values import Side, Vector

__all__ = ["ENDED_KEPT", "Motion", "MotionBook", "MotionState"]

ENDED_KEPT = 32
"""So many ended motions stay visible."""


class MotionState(str, Enum):
    """Where a motion is in its life."""

    QUEUED = "queued"
    EXECUTING = "executing"
    REACHED = "reached"
    CANCELLED = "cancelled"
    SUPERSEDED = "superseded"
    ABORTED = "aborted"


RUNNING = frozenset({MotionState.QUEUED, MotionState.EXECUTING})


class Motion:
    """One motion's record.

    Args:
        motion_id: Rises by one with each motion of this daemon.
        goals_rad: Per arm that takes part, shape (7,) [rad].
        tolerance_rad: Settling tolerance [rad].
        duration_ns: Planned duration [ns].
    """

    def __init__(
        self, motion_id: int, goals_rad: Mapping[Side, Vector], tolerance_rad: float, duration_ns: int
    ) -> None:
        self.motion_id = motion_id
        self.goals_rad = dict(goals_rad)
        self.tolerance_rad = tolerance_rad
        self.duration_ns = duration_ns
        self.state = MotionState.QUEUED
        self.progress = 0.0
        self.error_rad: float | None = None
        self.code: Code | None = None
        self.message = ""
        self.path_ended_ns: int | None = None
        """When the last setpoint of the path left [ns]."""
        self.settled_since_ns: int | None = None
        """Since when every joint is measured within tolerance [ns]."""

    @property
    def is_running(self) -> bool:
        """Whether it has not ended."""
        return self.state in RUNNING

    def view(self) -> MotionView:
        """Return what the outside may see."""
        return MotionView(
            motion_id=self.motion_id,
            sides=tuple(side.value for side in self.goals_rad),
            state=self.state.value,
            progress=self.progress,
            error_rad=self.error_rad,
            duration_ns=self.duration_ns,
            code=self.code.value if self.code else "",
            message=self.message,
        )


class MotionBook:
    """All motions: at most one running per arm.

    Args:
        settings: Settling times.
    """

    def __init__(self, settings: ArmSettings) -> None:
        self._settings = settings
        self._next_id = 1
        self._running: list[Motion] = []
        self._ended: deque[Motion] = deque(maxlen=ENDED_KEPT)
        self._ended_views: deque[MotionView] = deque(maxlen=ENDED_KEPT)

    def of(self, side: Side) -> Motion | None:
        """Return the running motion of an arm."""
        return next((m for m in self._running if side in m.goals_rad), None)

    def find(self, motion_id: int) -> Motion | None:
        """Return a motion that runs or is still visible."""
        return next((m for m in (*self._running, *self._ended) if m.motion_id == motion_id), None)

    @property
    def running(self) -> tuple[Motion, ...]:
        """Motions that have not ended."""
        return tuple(self._running)

    def open(self, goals_rad: Mapping[Side, Vector], tolerance_rad: float | None, duration_ns: int) -> Motion:
        """Record an accepted motion; its arms must be free of others."""
        tolerance = self._settings.settle_rad if tolerance_rad is None else tolerance_rad
        motion = Motion(self._next_id, goals_rad, tolerance, duration_ns)
        self._next_id += 1
        self._running.append(motion)
        return motion

    def end(self, motion: Motion, state: MotionState, code: Code | None, message: str) -> None:
        """End a running motion; an ended one stays as it is."""
        if not motion.is_running:
            return
        motion.state, motion.code, motion.message = state, code, message
        self._running.remove(motion)
        self._ended.append(motion)
        self._ended_views.append(motion.view())

    def advance(
        self, motion: Motion, progress: Mapping[Side, float], measured: Mapping[Side, Vector | None], now_ns: int
    ) -> None:
        """Take note of what was sent and measured; ends the motion when it has settled or never will.

        One that is within tolerance when its time is over may still settle; it is aborted when it leaves.

        Args:
            motion: A running one.
            progress: Per side, part of the path that has been sent, 0..1.
            measured: Per side, fresh joint positions [rad]; None when they are not fresh.
            now_ns: Monotonic time [ns].
        """
        sent = [progress[side] for side in motion.goals_rad]
        motion.progress = min(sent)
        if max(sent) > 0.0:
            motion.state = MotionState.EXECUTING
        errors = []
        for side, goal in motion.goals_rad.items():
            q_rad = measured[side]
            errors.append(None if q_rad is None else max(map(abs, map(sub, goal, q_rad))))
        known = [e for e in errors if e is not None]
        motion.error_rad = max(known) if len(known) == len(errors) else None
        if motion.progress < 1.0:
            return
        if motion.path_ended_ns is None:
            motion.path_ended_ns = now_ns
        if motion.error_rad is None or motion.error_rad > motion.tolerance_rad:
            motion.settled_since_ns = None
        elif motion.settled_since_ns is None:
            motion.settled_since_ns = now_ns
        if motion.settled_since_ns is not None:
            if now_ns - motion.settled_since_ns >= self._settings.settle_ns:
                self.end(motion, MotionState.REACHED, None, "")
        elif now_ns - motion.path_ended_ns > self._settings.settle_timeout_ns:
            error = "unknown" if motion.error_rad is None else f"{motion.error_rad:.4f} rad"
            self.end(
                motion,
                MotionState.ABORTED,
                Code.SETTLE_TIMEOUT,
                f"the measured error is {error} {self._settings.settle_timeout_ns / 1e9:.1f} s after the path ended, "
                f"{motion.tolerance_rad} rad is asked for",
            )

    def views(self) -> tuple[MotionView, ...]:
        """Return running and lately ended motions, oldest first."""
        views = [*self._ended_views, *[motion.view() for motion in self._running]]
        return tuple(sorted(views, key=attrgetter("motion_id")))
