"""What becomes of motions and stops, as a user is told."""

from __future__ import annotations

from dataclasses import dataclass

from gateway.api.protocol import TouchView

__all__ = ["MotionResult", "StopResult"]


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionResult:
    """A motion that reached its goal, proven by measured joints, or ended at the touch that it was to end at.

    Attributes:
        motion_id: Of the motion.
        sides: Arms that took part.
        error: Largest measured joint distance to the goal, or the angle to it [rad].
        duration: Planned duration of its path [s].
        error_m: Largest measured distance to the goal of an end effector [m]; None for joints.
        touch: The touch that ended it: force, wrench, place and time; None when it reached its goal.
    """

    motion_id: int
    sides: tuple[str, ...]
    error: float | None
    duration: float
    error_m: float | None = None
    touch: TouchView | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StopResult:
    """What became of a stop.

    Attributes:
        undelivered: True when there was no transport to the robot: use the physical emergency stop.
        by_guard: Whether the guard of a dead daemon did it.
    """

    undelivered: bool
    by_guard: bool = False
