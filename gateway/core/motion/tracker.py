"""Tracker: one arm's way onto a trajectory, along it and off its end, period by period, whatever the arm did before.

The trajectory's own clock runs from the first period on. Before a start in the future the arm *waits*: it goes on with the
trajectory it was on, or brakes and rests. At the end it rests at the last point or, where it shall not, runs there at speed;
without a successor it then has to brake (*underrun*). How the arm gets onto the trajectory, and how near it stays, is the
business of `joints/tracker.py` and `poses/pose_tracker.py`. This module knows no side, no request and no wall clock.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import Enum
from typing import Any, Generic, Protocol, TypeVar

from gateway.core.motion.space import State
from gateway.values import Vector

__all__ = ["ROUNDING_S", "Outcome", "Tracker"]

ROUNDING_S = 1e-9
"""Rounding of a sum of periods [s]."""


class Outcome(str, Enum):
    """How the following of a trajectory came to its end."""

    DONE = "done"
    """The arm rests at the last point."""
    UNDERRUN = "underrun"
    """The trajectory ended in motion and no other followed."""
    LOST = "lost"
    """The trajectory cannot be reached, or not be followed inside the limits."""


class _Trajectory(Protocol):
    @property
    def duration_s(self) -> float: ...

    def at(self, time_s: float) -> tuple[Vector, Vector, Any]: ...


TrajectoryT = TypeVar("TrajectoryT", bound=_Trajectory)


class Tracker(ABC, Generic[TrajectoryT]):
    """Leads one arm along one trajectory.

    Args:
        period_s: Time between setpoints [s].
        trajectory: Inside the limits.
        start_s: Time on the trajectory at which the arm is now [s]; negative when it begins in the future.
        rests: Whether it ends at rest at the last point; else it ends at speed.
        lead: What the arm follows until this one begins; None when it follows nothing.
    """

    def __init__(
        self,
        period_s: float,
        trajectory: TrajectoryT,
        start_s: float,
        *,
        rests: bool,
        lead: Tracker[TrajectoryT] | None,
    ) -> None:
        self.trajectory = trajectory
        self.rests = rests
        self.outcome: Outcome | None = None
        """How it ended; None while it goes on."""
        self.has_joined = False
        """Whether the arm has been on the trajectory."""
        self._period_s = period_s
        self._start_s = start_s
        self._steps = 0
        """Periods handed out."""
        self._lead = lead

    # ------------------------------------------------------------------------------------------------ what is seen

    @property
    def time_s(self) -> float:
        """Time on the trajectory [s]; negative before it begins."""
        return self._time_s(self._steps)

    @property
    def is_waiting(self) -> bool:
        """Whether it has not begun."""
        return self._time_s(self._steps + 1) <= 0.0

    @property
    def progress(self) -> float:
        """Part of the trajectory's duration that is behind us, 0..1; 1 only when the arm rests at its end."""
        if self.outcome is Outcome.DONE:
            return 1.0
        return min(max(self.time_s / self.trajectory.duration_s, 0.0), 1.0 - 1e-6)

    @property
    def under_way(self) -> Tracker[TrajectoryT] | None:
        """What leads the arm now: this one, or while it waits the one before it; None when nothing does."""
        return self._lead if self.is_waiting else self

    @property
    def is_sound(self) -> bool:
        """Whether an arm that runs to the end at speed can brake inside its limits from there."""
        return True

    def origin(self, here: Vector, rest: Vector) -> Vector:
        """Return where the arm will be when this one begins.

        Args:
            here: Where it is now.
            rest: Where it would come to rest if it braked now.
        """
        if not self.is_waiting:
            return here
        return rest if self._lead is None else self._lead.place_in(-self.time_s)

    def place_in(self, time_s: float) -> Vector:
        """Return where the trajectory is a time from now; at its ends before and after them."""
        return self.trajectory.at(self.time_s + time_s)[0]

    def _time_s(self, steps: int) -> float:
        return self._start_s + steps * self._period_s

    # ------------------------------------------------------------------------------------------------ one period

    def begin(self, now: State) -> bool:
        """Plan the way onto the trajectory; return whether there is one. Only for one that does not wait."""
        return True

    def step(self, now: State) -> State | None:
        """Return the state one period after `now`; None when it has ended and the arm has to brake."""
        if self.outcome is not None:
            return now if self.outcome is Outcome.DONE else None
        if not self.is_waiting:
            self._lead = None
            return self._go_on(now)
        state = self._lead.step(now) if self._lead is not None else None
        if state is None:
            self._lead = None
            state = self._pause(now)
        self._steps += 1
        return state

    @abstractmethod
    def _pause(self, now: State) -> State:
        """Return the state one period after `now` of an arm that waits and follows nothing."""

    @abstractmethod
    def _go_on(self, now: State) -> State | None:
        """Count the next period and return its state; None, with an outcome, where there is none."""
