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
   Arms whose joints hang together (one path for all) brake as a whole.
3. Else all brake. That is safe, because the state they brake from was let go by 1 or 2: its stop keeps the margin.

What 3 needs is less than what the bound above gives: only that the margin is kept when all joints brake at once. Where they go
then is known (`Motion.course`). So a pair that any order of the joints might bring too near is looked at along that course,
piece by piece, before it counts as bad.

Before that comes to pass, velocities are limited (`Verdict.limit_radps`), so that parts come to rest softly.

What is true of a way is true of every way inside it. So a motion may give wider ways along (`Motion.spare`): where these
keep the margin as well, nothing has to be judged until it leaves them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from gateway.kinematics.collision import CollisionModel, Posture
from gateway.kinematics.hull_ends import HullEnds, Kept, Parts, Reach
from gateway.kinematics.judgement import ALL, NONE, Course, Going, Motion, Verdict, Ways
from gateway.values import ARM_DOF, Side

__all__ = ["Approach"]

USED_RATIO = 0.7
"""Part of the room to the margin that stops may use before velocities are limited."""
EARLY = 0.35
"""A piece of a course is parted here: a stop has gone half of its way by then."""
MOST_LOOKS = 5
"""So many pieces of a course are looked at, not more: each costs as much as a judgement."""
CREEP_RADPS = 0.02
"""Velocities are not limited below this [rad/s]: what is left of the way is taken at a creep."""
TOUCHED_M = 1e-9
"""Rounding of a gap that stays as it is [m]."""

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Numbers = NDArray[np.intp]
NO_LIMIT: Mapping[Side, float] = dict.fromkeys(Side, math.inf)


class Approach:
    """The rule for one body.

    Args:
        model: Its parts.
    """

    def __init__(self, model: CollisionModel) -> None:
        self._margin_m = model.margin_m
        self._parts = Parts(model)

    def judge(self, posture: Posture, motion: Motion) -> Verdict:
        """Return what a motion may do.

        Args:
            posture: The body when it was looked at.
            motion: What is wanted of its joints since.
        """
        margin_m = self._margin_m
        widest = Reach(self._parts, motion.wanted if motion.spare is None else motion.spare)
        ends = HullEnds(posture, self._parts, widest, margin_m)
        gap_m = ends.gap_m
        room_m = np.maximum(USED_RATIO * (gap_m - margin_m), TOUCHED_M)
        kept, has_spare = ends.on(widest), False
        if motion.spare is not None:
            has_spare = not self._is_bad(gap_m, kept.gap_m).any()
            if has_spare and not (gap_m - kept.gap_m > room_m).any():
                return Verdict(going=ALL, limit_radps=NO_LIMIT, pair=-1, kept_m=math.inf, has_spare=True)
            kept = ends.on(Reach(self._parts, motion.wanted))
        if not len(gap_m):
            return Verdict(going=ALL, limit_radps=NO_LIMIT, pair=-1, kept_m=math.inf)
        limit_radps, loss_m = dict(NO_LIMIT), gap_m - kept.gap_m
        for row in np.nonzero(loss_m > room_m)[0].tolist():
            closing = kept.closing([row])
            fastest = max(abs(motion.speed_radps[side][k]) for side, k in closing)
            limit = max(fastest * float(room_m[row] / loss_m[row]), CREEP_RADPS)
            for side in {side for side, _ in closing}:
                limit_radps[side] = min(limit_radps[side], limit)
        bad = self._bad(posture, motion, ALL, ends, kept)
        least = bad[int(kept.gap_m[bad].argmin())] if bad else int(kept.gap_m.argmin())
        return Verdict(
            going=self._parting(posture, motion, kept.closing(bad)) if bad else ALL,
            limit_radps=limit_radps,
            pair=int(ends.numbers[least]),
            kept_m=float(kept.gap_m[least]),
            has_spare=has_spare,
        )

    def kept_m(self, posture: Posture, ways: Ways) -> float:
        """Return the least gap on a way of the pairs that may come inside the margin [m]; infinite if none can.

        Args:
            posture: The body when it was looked at.
            ways: Extents of the ways of the joints since, shape (7,) per side [rad].
        """
        reach = Reach(self._parts, ways)
        return float(HullEnds(posture, self._parts, reach, self._margin_m).on(reach).gap_m.min(initial=math.inf))

    def _is_bad(self, gap_m: Array, kept_m: Array) -> Flags:
        return np.asarray(kept_m < np.minimum(self._margin_m, gap_m) - TOUCHED_M)

    def _parting(self, posture: Posture, motion: Motion, closing: set[tuple[Side, int]]) -> Going:
        """Return which joints may go on although some pairs would come too near: those that close none of these."""
        whole = {side for row in motion.together if any(side in row for side, _ in closing) for side in row}
        going = {side: tuple(side not in whole and (side, k) not in closing for k in range(ARM_DOF)) for side in Side}
        braked = motion.braked()
        mixed = {
            side: [w if go else b for w, b, go in zip(motion.wanted[side], braked[side], going[side], strict=True)]
            for side in Side
        }
        reach = Reach(self._parts, mixed)
        after = HullEnds(posture, self._parts, reach, self._margin_m)
        return NONE if self._bad(posture, motion, going, after, after.on(reach)) else going

    def _bad(self, posture: Posture, motion: Motion, going: Going, ends: HullEnds, kept: Kept) -> list[int]:
        """Return which pairs would come too near if some joints go on and the others brake, as rows of `ends`."""
        bad = np.nonzero(self._is_bad(ends.gap_m, kept.gap_m))[0]
        if not len(bad) or motion.course is None:
            return bad.tolist()
        floor_m = np.zeros(len(posture.model.pairs))
        floor_m[ends.numbers] = np.minimum(self._margin_m, ends.gap_m) - TOUCHED_M
        is_kept = self._is_kept(posture, motion.course(going), ends.numbers[bad], floor_m)
        return [] if is_kept else bad.tolist()

    def _is_kept(self, posture: Posture, course: Course, numbers: Numbers, floor_m: Array) -> bool:
        """Return whether some pairs keep what they must along a course, as far as a few looks can tell.

        Args:
            posture: The body at its beginning.
            course: Where the joints go.
            numbers: Of the pairs.
            floor_m: What each pair of all must keep [m].
        """
        middle_s = EARLY * course.duration_s
        pieces, looks = [(middle_s, course.duration_s), (0.0, middle_s)], 0
        while pieces:
            if looks == MOST_LOOKS:
                return False
            looks += 1
            from_s, to_s = pieces.pop()
            there = posture if from_s == 0.0 else posture.model.posture(course.at(from_s))
            reach = Reach(self._parts, course.ways(from_s, to_s))
            ends = HullEnds(there, self._parts, reach, self._margin_m, numbers)
            floor = floor_m[ends.numbers]
            if (ends.gap_m < floor).any():
                return False
            if (ends.on(reach).gap_m < floor).any():
                middle_s = from_s + EARLY * (to_s - from_s)
                pieces += [(middle_s, to_s), (from_s, middle_s)]
        return True
