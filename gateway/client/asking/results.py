"""What becomes of motions and stops, as a user is told."""

from __future__ import annotations

from msgspec import Struct

from gateway.api.protocol import TouchView

__all__ = ["MotionResult", "Payload", "Rows", "StopResult"]

Rows = tuple[tuple[float, ...], ...]
"""Seven numbers of joints for each posture."""


class MotionResult(Struct, frozen=True, kw_only=True):
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


class StopResult(Struct, frozen=True, kw_only=True):
    """What became of a stop.

    Attributes:
        undelivered: True when there was no transport to the robot: use the physical emergency stop.
        by_guard: Whether the guard of a dead daemon did it.
    """

    undelivered: bool
    by_guard: bool = False


class Payload(Struct, frozen=True, kw_only=True):
    """What a hand holds: weighed by `ArmControl.payload`, or known and told with it.

    Attributes:
        mass: Its mass [kg].
        com: Its centre of mass in `frame`, shape (3,) [m]; None while it may be nothing.
        mass_sd: Standard deviation of the mass [kg].
        com_sd: Standard deviations of the centre [m].
        frame: Frame of the end effector: `left_ee` or `right_ee`; empty where it was not weighed.
        condition: Condition number of the postures; 0 where it was not weighed.
        q_rad: Postures that it was weighed in, shape (n, 7) [rad].
        up_nm: What pulled the joints there on the way up, shape (n, 7) [N·m] ...
        down_nm: ... and down.
        noise_nm: Standard deviation of the mean of both [N·m].
    """

    mass: float
    com: tuple[float, ...] | None = (0.0, 0.0, 0.0)
    mass_sd: float = 0.0
    com_sd: tuple[float, ...] | None = (0.0, 0.0, 0.0)
    frame: str = ""
    condition: float = 0.0
    q_rad: Rows = ()
    up_nm: Rows = ()
    down_nm: Rows = ()
    noise_nm: Rows = ()
