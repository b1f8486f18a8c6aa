"""Point-to-point motions: from acceptance to an end that is proven by the measured state.

A motion is `queued` until its first setpoint leaves, `executing` until it ends, and ends exactly once: `reached` when
every joint, or the pose, is *measured* within tolerance for the settling time, `touched` when it was to end at a touch
and did, else `cancelled`, `superseded` or `aborted` with a code.
A motion of two arms ends for both: what takes one arm away ends the motion, and the other arm brakes and holds.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from enum import Enum
from operator import attrgetter

from msgspec import Struct

from gateway.core.body.feeler import Feeler
from gateway.core.motion.gap import Gap, gap
from gateway.core.motion.tolerance import Deviation, Tolerances, first_beyond
from gateway.errors import Code
from gateway.messages.snapshot import MotionView, TouchView
from gateway.settings.settings import ArmSettings, PoseSettings
from gateway.values import Side, Space, Vector

__all__ = ["ENDED_KEPT", "Motion", "MotionBook", "MotionState", "Terms"]

ENDED_KEPT = 32
"""So many ended motions stay visible."""


class MotionState(str, Enum):
    """Where a motion is in its life."""

    QUEUED = "queued"
    EXECUTING = "executing"
    REACHED = "reached"
    TOUCHED = "touched"
    CANCELLED = "cancelled"
    SUPERSEDED = "superseded"
    ABORTED = "aborted"


RUNNING = frozenset({MotionState.QUEUED, MotionState.EXECUTING})


class Terms(Struct, frozen=True, kw_only=True):
    """What a trajectory is judged by.

    Attributes:
        tolerances: On the way, at the end, and in time.
        ends_ns: When it is planned to be at its last point [ns].
    """

    tolerances: Tolerances
    ends_ns: int


class Motion:
    """One motion's record.

    Goals and what is measured are in its space; without terms it is a motion from point to point.
    """

    def __init__(
        self,
        motion_id: int,
        goals: Mapping[Side, Vector],
        tolerance: Gap,
        duration_ns: int,
        space: Space,
        terms: Terms | None = None,
    ) -> None:
        self.motion_id = motion_id
        self.goals = dict(goals)
        self.tolerance = tolerance
        self.space = space
        self.duration_ns = duration_ns
        self.terms = terms
        self.state = MotionState.QUEUED
        self.is_planned = True
        """Whether its way is known; until then it is queued, and nothing of it is judged."""
        self.seen: Callable[[Side, Vector], Vector] | None = None
        """What turns the joints that are measured into values of its space, by the body model; None where none is needed."""
        self.progress = 0.0
        self.error: Gap | None = None
        """Measured distance to the goal, the worst of all arms; None when it is not known."""
        self.code: Code | None = None
        self.message = ""
        self.feelers: Mapping[Side, Feeler] = {}
        """At what touch it ends before its goal, per arm; empty for none."""
        self.touch: TouchView | None = None
        """The touch that ended it; None else."""
        self.path_ended_ns: int | None = None
        """When the last setpoint of the path left [ns]."""
        self.settled_since_ns: int | None = None
        """Since when every arm is measured within tolerance [ns]."""

    @property
    def is_running(self) -> bool:
        """Whether it has not ended."""
        return self.state in RUNNING

    def where(self, measured: Mapping[Side, Vector | None]) -> Mapping[Side, Vector | None]:
        """Return what is measured of its arms, in its own space.

        Args:
            measured: Per side, in the space of the arm's setpoints; None when it is not fresh.
        """
        seen = self.seen
        if seen is None:
            return measured
        rows = {side: measured[side] for side in self.goals}
        return {side: None if values is None else seen(side, values) for side, values in rows.items()}

    def view(self) -> MotionView:
        """Return what the outside may see."""
        return MotionView(
            motion_id=self.motion_id,
            sides=tuple(side.value for side in self.goals),
            space=self.space.value,
            state=self.state.value,
            progress=self.progress,
            error_rad=None if self.error is None else self.error.rad,
            error_m=None if self.error is None or self.space is Space.JOINT else self.error.m,
            duration_ns=self.duration_ns,
            code=self.code.value if self.code else "",
            message=self.message,
            touch=self.touch,
        )


class MotionBook:
    """All motions: at most one running per arm."""

    def __init__(self, settings: ArmSettings, pose: PoseSettings | None = None) -> None:
        self.renew(settings, pose or PoseSettings())
        self.next_id = 1
        """Number of the motion that is opened next."""
        self._running: list[Motion] = []
        self._ended: deque[Motion] = deque(maxlen=ENDED_KEPT)
        self._ended_views: deque[MotionView] = deque(maxlen=ENDED_KEPT)

    def renew(self, settings: ArmSettings, pose: PoseSettings) -> None:
        """Settle by these from now on; a motion under way keeps its tolerance."""
        self._settings = settings
        self._tolerances = {Space.JOINT: Gap(settings.settle_rad), Space.POSE: Gap(pose.settle_rad, pose.settle_m)}

    def of(self, side: Side) -> Motion | None:
        """Return the running motion of an arm."""
        return next((m for m in self._running if side in m.goals), None)

    def find(self, motion_id: int) -> Motion | None:
        """Return a motion that runs or is still visible."""
        return next((m for m in (*self._running, *self._ended) if m.motion_id == motion_id), None)

    @property
    def running(self) -> tuple[Motion, ...]:
        """Motions that have not ended."""
        return tuple(self._running)

    def open(
        self,
        goals: Mapping[Side, Vector],
        tolerance: Gap | None,
        duration_ns: int,
        terms: Terms | None = None,
        space: Space = Space.JOINT,
    ) -> Motion:
        """Record an accepted motion; its arms must be free of others. Without a tolerance the configured one counts.

        `terms` are a trajectory's.
        """
        motion = Motion(self.next_id, goals, tolerance or self._tolerances[space], duration_ns, space, terms)
        self.next_id += 1
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

        `progress` is the part of each path that has been sent, 0..1; `measured` is in the motion's space, None where
        it is not fresh.
        """
        sent = [progress[side] for side in motion.goals]
        motion.progress = min(sent)
        if max(sent) > 0.0:
            motion.state = MotionState.EXECUTING
        motion.error = Gap(0.0)
        for side, goal in motion.goals.items():
            values = measured[side]
            if values is None:
                motion.error = None
                break
            motion.error = motion.error.worst(gap(motion.space, goal, values))
        if motion.progress >= 1.0:
            if motion.path_ended_ns is None:
                motion.path_ended_ns = now_ns
            if not _is_within(motion, measured):
                motion.settled_since_ns = None
            elif motion.settled_since_ns is None:
                motion.settled_since_ns = now_ns
        if motion.settled_since_ns is not None:
            if now_ns - motion.settled_since_ns >= self._settings.settle_ns:
                self.end(motion, MotionState.REACHED, None, "")
        elif motion.terms is not None:
            if now_ns > motion.terms.ends_ns + motion.terms.tolerances.goal_time_ns:
                self.end(motion, MotionState.ABORTED, Code.GOAL_TOLERANCE, _too_late(motion, motion.terms, measured))
        elif motion.path_ended_ns is not None and now_ns - motion.path_ended_ns > self._settings.settle_timeout_ns:
            error = "unknown" if motion.error is None else motion.error.text(motion.space)
            self.end(
                motion,
                MotionState.ABORTED,
                Code.SETTLE_TIMEOUT,
                f"the measured error is {error} {self._settings.settle_timeout_ns / 1e9:.1f} s after the path ended, "
                f"{motion.tolerance.text(motion.space)} is asked for",
            )

    def views(self) -> tuple[MotionView, ...]:
        """Return running and lately ended motions, oldest first."""
        views = [*self._ended_views, *[motion.view() for motion in self._running]]
        return tuple(sorted(views, key=attrgetter("motion_id")))


def _is_within(motion: Motion, measured: Mapping[Side, Vector | None]) -> bool:
    """Whether every arm is measured within the motion's tolerance of its goal."""
    if motion.error is None:
        return False
    if motion.terms is None:
        return not motion.error.exceeds(motion.tolerance)
    return next(_beyond(motion, motion.terms, measured), None) is None


def _beyond(motion: Motion, terms: Terms, measured: Mapping[Side, Vector | None]) -> Iterator[tuple[Side, Deviation]]:
    """Yield for each measured arm the first joint that is not within its tolerance of the goal."""
    for side, goal in motion.goals.items():
        q_rad = measured[side]
        off = None if q_rad is None else first_beyond(terms.tolerances.space, goal, q_rad, terms.tolerances.goal[side])
        if off is not None:
            yield side, off


def _too_late(motion: Motion, terms: Terms, measured: Mapping[Side, Vector | None]) -> str:
    """Say what is missing when the goal time of a trajectory is over: a joint, or the rest of the way."""
    late = f"{terms.tolerances.goal_time_ns / 1e9:g} s after its planned end"
    if motion.progress < 1.0:
        return f"only {motion.progress:.0%} of the trajectory was sent {late}"
    for side, off in _beyond(motion, terms, measured):
        return f"{side} arm {off} from its goal {late}, {off.bound} {off.unit} is asked for"
    return f"the arm is not measured {late}"
