"""Approach: how quickly parts of the body may come together, so that they always stop with a margin left.

A motion is judged by where its stop may lead. For each joint it is known how far that goes, back and forth (`stopping.py`),
from where the body was looked at: one or two ticks ago, if need be. From that follows the least gap of a pair that any
part of the way may have, whatever joint stands still first:

    gap - sum of max(0, -slope * travel + bend)

`slope` is how much an end of the part moves along the direction between the nearest points, by each joint; `bend` what
turning leaves its tangent by, at most. For the direction parts the two convex lines, and a motion that keeps all four ends
on their sides keeps the lines there. A joint that opens is never set off against one that closes: it may stand still first.

The rule of a tick (`Look.judge`):

1. A motion whose every pair keeps the margin is let go. Where a pair is inside the margin already, it must not get nearer.
2. Else the joints that close such a pair brake, and the others go on: parting is always possible, together or joint by joint.
   Arms whose joints hang together (one path for all) brake as a whole. Where that leaves none (a finger between two others:
   what opens one gap closes the other), those go on that open all such gaps together.
3. Else all brake. That is safe, because the state they brake from was let go by 1 or 2: its stop keeps the margin.

What 3 needs is less than what the bound above gives: only that the margin is kept when all joints brake at once. Where they go
then is known (`Motion.course`). So a pair that any order of the joints might bring too near is looked at along that course
before it counts as bad: setpoint by setpoint where it is short, else in pieces.

Before that comes to pass, velocities are limited (`Verdict.limit_radps`), so that parts come to rest softly.

What is true of a way is true of every way inside it. So a motion may give wider ways along (`Motion.lookahead`): where these
keep the margin as well, nothing has to be judged until it leaves them. And what was looked at in one tick says something of
the next ones (`Look.passing`): ways from where the body was then, that lead through where it is now, are ways as well. Only
what they do not let pass has to be looked at again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gateway.kinematics.collision import CollisionModel
from gateway.kinematics.separation.hull_ends import HullEnds, Kept, Reach
from gateway.kinematics.separation.judgement import ALL, NONE, Going, Motion, Passing, Verdict, Ways
from gateway.kinematics.separation.posture_arrays import JOINTS, Parts
from gateway.kinematics.separation.stopping import STAYS
from gateway.values import ARM_DOF, Side, Vector

__all__ = ["Approach", "Look"]

USED_RATIO = 0.7
"""Part of the room to the margin that stops may use before velocities are limited."""
PIECES = (0.06, 0.13, 0.21, 0.3, 0.42, 0.6)
"""Where a course is parted to be looked at, all pieces at once: in each a stop goes about as far as in the others."""
CREEP_RADPS = 0.02
"""Velocities are not limited below this [rad/s]: what is left of the way is taken at a creep."""
TOUCHED_M = 1e-9
"""Rounding of a gap that stays as it is [m]."""

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Numbers = NDArray[np.intp]
BACK_AND_FORTH = np.repeat((-1.0, 1.0), JOINTS)
STILL: Ways = {side: (STAYS,) * ARM_DOF for side in Side}
NO_LIMIT: Mapping[Side, float] = dict.fromkeys(Side, math.inf)


class Approach:
    """The rule for one body."""

    def __init__(self, model: CollisionModel) -> None:
        self._model = model
        self._parts = Parts(model)

    def look(self, here: Mapping[Side, Vector], within: Ways) -> Look:
        """Look at the body, for motions that stay within some ways.

        Args:
            here: Where the joints are, shape (7,) per side [rad].
            within: How far they may go from there, likewise [rad].
        """
        return Look(self._model, self._parts, here, within)


class Look:
    """What was seen of the body in one posture.

    Args:
        model: The body.
        parts: Of it.
        here: Joint angles, shape (7,) per side [rad].
        within: How far motions may go from there that are judged by it, likewise [rad].

    Attributes:
        here: Likewise.
        is_free: Whether all such motions may go on, at any speed.
    """

    def __init__(self, model: CollisionModel, parts: Parts, here: Mapping[Side, Vector], within: Ways) -> None:
        self.here = here
        self._model = model
        self._parts = parts
        self._margin_m = margin_m = model.margin_m
        self._arrays = parts.stand([here])
        reach = Reach([within])
        self._far_rad = reach.goes_rad * BACK_AND_FORTH
        self._ends = HullEnds(self._arrays, parts, reach, margin_m)
        gap_m = self._ends.gap_m[0]
        self._ends.drop(gap_m - self._ends.on(reach).gap_m[0] < USED_RATIO * (gap_m - margin_m))
        gap_m = self._ends.gap_m[0]
        self._room_m = np.maximum(USED_RATIO * (gap_m - margin_m), TOUCHED_M)
        self._floor_m = np.minimum(margin_m, gap_m) - TOUCHED_M
        self.is_free = not len(gap_m)

    def kept_m(self, ways: Ways) -> float:
        """Return the least gap on a way of the pairs that may come inside the margin [m]; infinite if none can.

        Args:
            ways: Extents of the ways of the joints, shape (7,) per side [rad].
        """
        return float(self._ends.on(Reach([ways])).gap_m.min(initial=math.inf))

    def passing(self, wanted: Ways, lookahead: Ways | None) -> Passing | None:
        """Return what is known of ways from here where they may be gone for every order of the joints; None where they may not.

        Ways that lead further than what was looked at for may not.

        Args:
            wanted: Extents of each joint's way through the next state and the stop from there, shape (7,) per side [rad].
            lookahead: Ways that hold the wanted ones; None where nobody asks for more.
        """
        reach = Reach([wanted] if lookahead is None else [wanted, lookahead])
        return None if (reach.goes_rad * BACK_AND_FORTH > self._far_rad).any() else self._passing(self._ends.on(reach))

    def judge(self, motion: Motion) -> Verdict:
        """Return what a motion may do.

        Args:
            motion: From where the body was looked at, within the ways that were looked at for.
        """
        kept = self._ends.on(Reach([motion.wanted] if motion.lookahead is None else [motion.wanted, motion.lookahead]))
        passing = self._passing(kept)
        limit_radps = self._limits(motion.speed_radps, kept)
        if passing is not None:
            return Verdict(
                going=ALL, limit_radps=limit_radps, pair=-1, kept_m=math.inf, has_lookahead=passing.has_lookahead
            )
        kept_m = kept.gap_m[0]
        bad = (kept_m < self._floor_m).nonzero()[0]
        least = bad[kept_m[bad].argmin()]
        is_kept = self._keeps_course(motion, ALL, self._ends, bad)
        return Verdict(
            going=ALL if is_kept else self._parting(motion, bad, np.logical_or.reduce(kept.closing(bad), axis=0)),
            limit_radps=limit_radps,
            pair=int(self._ends.numbers[least]),
            kept_m=float(kept_m[least]),
        )

    def _passing(self, kept: Kept) -> Passing | None:
        is_kept = np.logical_and.reduce(kept.gap_m >= self._floor_m, axis=1).tolist()
        if not is_kept[0]:
            return None
        return Passing(has_lookahead=is_kept[-1] and len(is_kept) > 1, limits=partial(self._limits, kept=kept))

    def _limits(self, speed_radps: Mapping[Side, Sequence[float]], kept: Kept) -> Mapping[Side, float]:
        """Return velocity limits for the next plans: where stops use more than their part of the room [rad/s]."""
        loss_m = self._ends.gap_m[0] - kept.gap_m[0]
        rows = (loss_m > self._room_m).nonzero()[0]
        if not len(rows):
            return NO_LIMIT
        speeds = np.abs([speed_radps[side] for side in Side]).reshape(JOINTS)
        closing = kept.closing(rows)
        fastest = np.maximum.reduce(closing * speeds, axis=1)
        limit = np.maximum(fastest * self._room_m.take(rows) / loss_m.take(rows), CREEP_RADPS)
        by_arm = closing.reshape(-1, len(Side), ARM_DOF).any(axis=2)
        least = np.where(by_arm, limit[:, None], math.inf).min(axis=0).tolist()
        return dict(zip(Side, least, strict=True))

    def _parting(self, motion: Motion, bad: Numbers, closing: Flags) -> Going:
        """Return which joints may go on although some pairs would come too near.

        `closing` says which joints of both arms close one of the pairs, shape (14,).
        """
        flags = dict(zip(Side, closing.reshape(len(Side), ARM_DOF).tolist(), strict=True))
        whole = {side for row in motion.together if any(any(flags[one]) for one in row) for side in row}
        going: Going = {side: tuple([side not in whole and not flag for flag in flags[side]]) for side in Side}
        is_stuck = not any(
            flag and speed for side in Side for flag, speed in zip(going[side], motion.speed_radps[side], strict=True)
        )
        if not is_stuck and self._is_sound(motion, going):
            return going
        going = self._opening(motion, bad, whole)
        return going if self._is_sound(motion, going) else NONE

    def _opening(self, motion: Motion, bad: Numbers, whole: set[Side]) -> Going:
        """Return joints that open some pairs together: all but those that close most, one after the other."""
        posture = self._model.posture(self.here)
        slopes = [posture.told(number).slopes for number in self._ends.numbers[bad].tolist()]
        opens_mps = np.array([[row[side] for side in Side] for row in slopes]).reshape(len(bad), JOINTS)
        opens_mps *= np.array([motion.speed_radps[side] for side in Side]).reshape(JOINTS)
        goes = np.repeat([side not in whole for side in Side], ARM_DOF)
        while goes.any() and (together := opens_mps[:, goes].sum(axis=1)).min() < 0.0:
            goes[np.where(goes, opens_mps[together.argmin()], math.inf).argmin()] = False
        return dict(zip(Side, map(tuple, goes.reshape(len(Side), ARM_DOF).tolist()), strict=True))

    def _is_sound(self, motion: Motion, going: Going) -> bool:
        """Whether all pairs keep what they must if some joints go on and the others brake."""
        braked = motion.braked()
        mixed = {
            side: [w if go else b for w, b, go in zip(motion.wanted[side], braked[side], going[side], strict=True)]
            for side in Side
        }
        reach = Reach([mixed])
        ends = HullEnds(self._arrays, self._parts, reach, self._margin_m)
        bad = (ends.on(reach).gap_m[0] < np.minimum(self._margin_m, ends.gap_m[0]) - TOUCHED_M).nonzero()[0]
        return not len(bad) or self._keeps_course(motion, going, ends, bad)

    def _keeps_course(self, motion: Motion, going: Going, ends: HullEnds, bad: Numbers) -> bool:
        """Return whether some pairs keep what they must if some joints go on and the others brake, and then all brake."""
        if motion.course is None:
            return False
        floor_m = np.zeros(len(self._parts.first))
        floor_m[ends.numbers] = np.minimum(self._margin_m, ends.gap_m[0]) - TOUCHED_M
        course = motion.course(going)
        setpoints = course.setpoints()
        begins, ways = course.pieces(PIECES) if setpoints is None else (setpoints, [STILL])
        reach = Reach(ways)
        along = HullEnds(self._parts.stand(begins), self._parts, reach, self._margin_m, ends.numbers[bad])
        return not (along.on(reach).gap_m < floor_m[along.numbers]).any()
