"""Line elbow: where the elbow is while the hand goes along a straight line.

A pose leaves one angle open, the arm angle. Along a line it is a parabola of the part of the way: it begins as the elbow hangs,
and may end anywhere, by a bulge or without. So it is smooth whatever the joints' limits are, and knows in the beginning where
it will have to be in the end. Of all parabolas tried (a grid, then ever smaller steps from the best one) that one is
taken with which the joints have to turn least quickly and least in all, and none comes near its limit that need not.

All is worked out in pieces of about a tenth of a millisecond.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from gateway.core.motion.joints.braking import JointLimits
from gateway.core.motion.lines.line import Line
from gateway.values import Vector

if TYPE_CHECKING:  # it takes numpy along, which a guard has no use for
    from gateway.kinematics.arm import ArmModel
    from gateway.kinematics.solving.inverse import Swivel

__all__ = ["Elbow", "chosen"]

STATIONS = 12
"""Places at which the joints are looked at."""
ENDS_RAD = tuple(0.2 * n for n in range(-9, 10))
"""How far the arm angle may be from its begin in the end: the grid."""
BULGES_RAD = (0.0, -0.3, 0.3)
"""... and how far it may leave the straight way there in the middle."""
STEPS_RAD = (0.1, 0.05, 0.025)
"""Steps from the best one, one after the other; each is repeated while it helps, at most REPEATED times."""
REPEATED = 3
NEAR_RAD = 0.05
"""A joint nearer to its limit than this, and nearer than at the begin, counts against a parabola."""
TRAVEL_SHARE = 0.3
"""What the travel of all joints counts, beside the greatest speed of one."""
NEAR_SHARE = 20.0
"""What nearness to a limit counts."""
BEYOND = 1e3
"""What being beyond a limit counts at least: more than anything else."""
TRIED = 2
"""Parabolas that are tried in one piece."""
STOOD = 4
"""Stations that are worked out in one piece."""


class Elbow(NamedTuple):
    """The arm angle along a line.

    Attributes:
        begin_rad: At its begin [rad].
        moved_rad: How much further it is in the end [rad].
        bulge_rad: How far it leaves the straight way there in the middle [rad].
    """

    begin_rad: float
    moved_rad: float = 0.0
    bulge_rad: float = 0.0

    def at(self, part: float) -> float:
        """Return the arm angle at a part of the way [rad]."""
        return self.begin_rad + part * (self.moved_rad + 4.0 * self.bulge_rad * (1.0 - part))


def chosen(arm: ArmModel, line: Line, begin_rad: Vector, limits: JointLimits) -> Generator[None, None, Elbow]:
    """Choose the elbow's way along a line, piece by piece.

    The line begins at the pose of `begin_rad`, shape (7,) [rad].

    Returns:
        The best one; where the limits leave none, that which is least beyond them.
    """
    bend = arm.bend(begin_rad)
    swivels: list[Swivel] = []
    for n in range(1, STATIONS + 1):
        swivel = bend.swivel(line.at(n / STATIONS))
        if swivel is None:
            break  # what follows is out of reach, whatever the elbow does
        swivels.append(swivel)
        if n % STOOD == 0:
            yield
    judge = _Judge(swivels, begin_rad, limits)
    best = Elbow(bend.arm_angle_rad)
    least = judge.cost(best, math.inf)
    grid = [best._replace(moved_rad=moved, bulge_rad=bulge) for bulge in BULGES_RAD for moved in ENDS_RAD]
    for number, elbow in enumerate(grid):
        cost = judge.cost(elbow, least)
        if cost < least:
            best, least = elbow, cost
        if number % TRIED == 0:
            yield
    for step in STEPS_RAD:
        for _ in range(REPEATED):
            before = least
            for moved, bulge in ((step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step)):
                elbow = best._replace(moved_rad=best.moved_rad + moved, bulge_rad=best.bulge_rad + bulge)
                cost = judge.cost(elbow, least)
                if cost < least:
                    best, least = elbow, cost
                yield
            if least == before:
                break
    return best


class _Judge:
    """What a way of the elbow costs."""

    def __init__(self, swivels: Sequence[Swivel], begin_rad: Vector, limits: JointLimits) -> None:
        self._swivels = swivels
        self._begin_rad = begin_rad
        self._limits = tuple(zip(limits.lower_rad, limits.upper_rad, strict=True))
        self._near = tuple(
            [
                min(max(min(q - low, high - q), 0.0), NEAR_RAD)
                for q, (low, high) in zip(begin_rad, self._limits, strict=True)
            ]
        )

    def cost(self, elbow: Elbow, least: float) -> float:
        """Return what it costs; no more than that it is above `least`, as soon as that is known."""
        cost = fastest = travel = near = beyond = 0.0
        before = self._begin_rad
        for n, swivel in enumerate(self._swivels, start=1):
            here = swivel.at(elbow.at(n / STATIONS))
            for q, was, (low, high), room in zip(here, before, self._limits, self._near, strict=True):
                way = abs(q - was)
                travel += way
                fastest = max(fastest, way)
                left = min(q - low, high - q)
                if left < room:
                    near = max(near, room - left)
                    beyond = max(beyond, -left)
            cost = STATIONS * fastest + TRAVEL_SHARE * travel + NEAR_SHARE * near
            if beyond > 0.0:
                cost += BEYOND * (1.0 + beyond)
            if cost >= least:
                return cost
            before = here
        return cost
