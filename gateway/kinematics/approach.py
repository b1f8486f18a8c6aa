"""Approach: how quickly parts of the body may come together, so that they always stop with a margin left.

A motion is judged by where its stop may lead. For each joint it is known how far that goes, back and forth (`stopping.py`),
from where the body was looked at: one or two ticks ago, if need be. From that follows the least gap of a pair that any
part of the way may have, whatever joint stands still first:

    gap - sum of max(0, -slope * travel + bend)

`slope` is how much an end of the part moves along the direction between the nearest points, by each joint; `bend` what
turning leaves its tangent by, at most. For the direction parts the two convex lines, and a motion that keeps all four ends
on their sides keeps the lines there. A joint that opens is never set off against one that closes: it may stand still first.

The rule of a tick (`Approach.judge`):

1. A motion whose every pair keeps the margin is let go. Where a pair is inside the margin already, it must not get nearer.
2. Else the joints that close such a pair brake, and the others go on: parting is always possible, together or joint by joint.
3. Else all brake. That is safe, because the state they brake from was let go by 1 or 2: its stop keeps the margin.

Before that comes to pass, velocities are limited (`Verdict.limit_radps`), so that parts come to rest softly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from gateway.kinematics.collision import CollisionModel, Posture
from gateway.kinematics.hull_ends import HullEnds, levers
from gateway.kinematics.stopping import Extent
from gateway.values import ARM_DOF, Side

__all__ = ["Approach", "Motion", "Verdict"]

USED_RATIO = 0.7
"""Part of the room to the margin that stops may use before velocities are limited."""
CREEP_RADPS = 0.02
"""Velocities are not limited below this [rad/s]: what is left of the way is taken at a creep."""
TOUCHED_M = 1e-9
"""Rounding of a gap that stays as it is [m]."""

Going = Mapping[Side, Sequence[bool]]
Ways = Mapping[Side, Sequence[Extent]]
ALL: Going = {side: (True,) * ARM_DOF for side in Side}
NONE: Going = {side: (False,) * ARM_DOF for side in Side}


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """What the joints of both arms may do from where the body was looked at.

    Attributes:
        wanted: Extent of each joint's way through the wanted next state and the stop from there, shape (7,) per side [rad].
        braked: Tells the extents of their ways when they brake now, likewise; asked only where something has to brake.
        speed_radps: Velocity of each joint in the wanted state, shape (7,) per side [rad/s].
    """

    wanted: Ways
    braked: Callable[[], Ways]
    speed_radps: Mapping[Side, Sequence[float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What may be done.

    Attributes:
        going: Which joints may take the wanted step, shape (7,) per side; the others take a step of their stop.
        limit_radps: Velocity limit for the next plan of each arm [rad/s]; infinite where nothing is near.
        pair: Number of the pair that keeps least on the wanted way (`Posture.told`); -1 if none may come inside the margin.
        kept_m: Gap that it keeps, at least [m]; infinite without one.
    """

    going: Going
    limit_radps: Mapping[Side, float]
    pair: int
    kept_m: float

    @property
    def is_free(self) -> bool:
        """Whether the whole motion may go on."""
        return all(all(row) for row in self.going.values())


class Approach:
    """The rule for one body.

    Args:
        model: Its parts.
    """

    def __init__(self, model: CollisionModel) -> None:
        self._margin_m = model.margin_m
        self._levers = levers(model)

    def judge(self, posture: Posture, motion: Motion) -> Verdict:
        """Return what a motion may do.

        Args:
            posture: The body when it was looked at.
            motion: What is wanted of its joints since.
        """
        ends = HullEnds(posture, self._levers, motion.wanted)
        least_m, decided = math.inf, -1
        limit_radps = dict.fromkeys(Side, math.inf)
        bad: list[int] = []
        for gap_m, number in ends.within(self._margin_m):
            kept_m = ends.kept_m(gap_m, number)
            room_m, loss_m = USED_RATIO * (gap_m - self._margin_m), gap_m - kept_m
            if loss_m > max(room_m, TOUCHED_M):
                closing = ends.closing(number)
                fastest = max(abs(motion.speed_radps[side][k]) for side, k in closing)
                limit = max(fastest * max(room_m, 0.0) / loss_m, CREEP_RADPS)
                for side in {side for side, _ in closing}:
                    limit_radps[side] = min(limit_radps[side], limit)
            if kept_m < least_m:
                least_m, decided = kept_m, number
            if self._is_bad(gap_m, kept_m):
                bad.append(number)
        return Verdict(
            going=self._parting(posture, motion, ends, bad) if bad else ALL,
            limit_radps=limit_radps,
            pair=decided,
            kept_m=least_m,
        )

    def kept_m(self, posture: Posture, ways: Ways) -> float:
        """Return the least gap on a way of the pairs that may come inside the margin [m]; infinite if none can.

        Args:
            posture: The body when it was looked at.
            ways: Extents of the ways of the joints since, shape (7,) per side [rad].
        """
        ends = HullEnds(posture, self._levers, ways)
        return min((ends.kept_m(*row) for row in ends.within(self._margin_m)), default=math.inf)

    def _is_bad(self, gap_m: float, kept_m: float) -> bool:
        return kept_m < min(self._margin_m, gap_m) - TOUCHED_M

    def _parting(self, posture: Posture, motion: Motion, ends: HullEnds, bad: Sequence[int]) -> Going:
        """Return which joints may go on although some pairs would come too near: those that close none of these."""
        closing = set().union(*(ends.closing(number) for number in bad))
        going = {side: tuple((side, k) not in closing for k in range(ARM_DOF)) for side in Side}
        braked = motion.braked()
        mixed = {
            side: [w if go else b for w, b, go in zip(motion.wanted[side], braked[side], going[side], strict=True)]
            for side in Side
        }
        after = HullEnds(posture, self._levers, mixed)
        if any(self._is_bad(gap_m, after.kept_m(gap_m, number)) for gap_m, number in after.within(self._margin_m)):
            return NONE
        return going
