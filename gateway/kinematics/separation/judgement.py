"""Judgement: what the rule of approach is asked about the next step of both arms, and what it answers (`approach.py`).

Plain values, for those who ask tick by tick and for those who never do: no array library comes along with them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from msgspec import Struct

from gateway.kinematics.separation.stopping import Extent
from gateway.values import ARM_DOF, Side, Vector

__all__ = ["ALL", "NONE", "Course", "Going", "Motion", "Passing", "Verdict", "Ways"]

Going = Mapping[Side, Sequence[bool]]
Ways = Mapping[Side, Sequence[Extent]]
ALL: Going = {side: (True,) * ARM_DOF for side in Side}
NONE: Going = {side: (False,) * ARM_DOF for side in Side}


class Course(Protocol):
    """How the joints of both arms go when they take a step and then all brake, at once."""

    def pieces(self, parts: Sequence[float]) -> tuple[Sequence[Mapping[Side, Vector]], Sequence[Ways]]:
        """Return the course in pieces: where the joints are when each begins [rad], and how far they go in it from there [rad].

        Args:
            parts: Where pieces are parted: parts of the course's duration, between 0 and 1, ascending.
        """

    def setpoints(self) -> Sequence[Mapping[Side, Vector]] | None:
        """Return where the joints are at each setpoint of a short course [rad]; None of a long one, or where nobody knows."""


class Motion(Struct, frozen=True, kw_only=True):
    """What the joints of both arms may do from where the body was looked at.

    Attributes:
        wanted: Extent of each joint's way through the wanted next state and the stop from there, shape (7,) per side [rad].
        braked: Tells the extents of their ways when they brake now, likewise; asked only where something has to brake.
        speed_radps: Velocity of each joint in the wanted state, shape (7,) per side [rad/s].
        together: Arms whose joints go on or brake as a whole; those of one row all at once.
        lookahead: Ways that hold the wanted ones; None where nobody asks for more.
        course: Tells how all joints go if some take the wanted step and the others one of their stop, and then all brake;
            None where that is not known, so that any order of the joints has to be reckoned with.
    """

    wanted: Ways
    braked: Callable[[], Ways]
    speed_radps: Mapping[Side, Sequence[float]]
    together: Sequence[Sequence[Side]] = ()
    lookahead: Ways | None = None
    course: Callable[[Going], Course] | None = None


class Passing(Struct, frozen=True, kw_only=True):
    """What is known of ways that may be gone.

    Attributes:
        has_lookahead: Whether the wider ones may be as well.
        limits: Tells the velocity limit for the next plan of each arm [rad/s], infinite where nothing is near; needs the
            velocity of each joint, shape (7,) per side [rad/s].
    """

    has_lookahead: bool
    limits: Callable[[Mapping[Side, Sequence[float]]], Mapping[Side, float]]


class Verdict(Struct, frozen=True, kw_only=True):
    """What may be done.

    Attributes:
        going: Which joints may take the wanted step, shape (7,) per side; the others take a step of their stop.
        limit_radps: Velocity limit for the next plan of each arm [rad/s]; infinite where nothing is near.
        pair: Number of the pair that keeps least on the wanted way (`Posture.told`); -1 if none may come inside the margin.
        kept_m: Gap that it keeps, at least [m]; infinite without one.
        has_lookahead: Whether all pairs keep the margin on the wider ways as well.
    """

    going: Going
    limit_radps: Mapping[Side, float]
    pair: int
    kept_m: float
    has_lookahead: bool = False

    @property
    def is_free(self) -> bool:
        """Whether the whole motion may go on."""
        return all(all(row) for row in self.going.values())
