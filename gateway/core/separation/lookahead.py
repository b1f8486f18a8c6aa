"""Lookahead: wider ways of both arms, judged along with those of a tick, so that the next ticks need no judgement, or less.

What keeps the margin for every order of the joints keeps it on every way inside. So joints are given room as far as they are
bound for, at most: to their target or the end of their path, and as far as they get at their speed. Where that much is not
free, half is asked for, and so on; where hardly anything is, nobody asks for some ticks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from gateway.core.motion.space import State
from gateway.kinematics.separation.judgement import Ways
from gateway.kinematics.separation.stopping import Extent
from gateway.values import Side, Vector

__all__ = ["Lookahead", "wider"]

MOST_RAD = 0.8
"""Room beyond the wanted way that is asked for at most, per joint and direction [rad]."""
LEAST_RAD = 0.01
"""Asking for less saves nothing [rad]."""
GROWS, SHRINKS = 1.5, 0.5
SPEED_S = 0.08
"""A joint is given room for as long at its speed, where its target is not further: targets move on [s]."""
STRAY_RAD = 0.004
"""What is asked for both ways, at most [rad]."""
TIGHT_TICKS = 8
"""For so many ticks after there was hardly any room nobody asks for it."""

Wanted = Mapping[Side, State]
Both = Mapping[Side, Vector]


class Lookahead:
    """What was found free beyond what was asked."""

    def __init__(self) -> None:
        self._free: list[Extent] | None = None
        """Where every joint of both arms may be, in any mixture [rad]; None where that is not known."""
        self._most_rad = MOST_RAD
        self._tight = 0

    def drop(self) -> None:
        """Forget what was free: it is not known any more."""
        self._free = None

    def holds(self, here: Both, ways: Ways) -> bool:
        """Whether ways lie inside what was found free.

        Args:
            here: Where the joints are, shape (7,) per side [rad].
            ways: How far they may go from there, likewise [rad].
        """
        if self._free is None:
            return False
        for (low, high), (lowest, highest) in zip(_places(here, ways), self._free, strict=True):
            if low < lowest or high > highest:
                return False
        return True

    def ask(self, here: Both, ways: Ways, wanted: Wanted, aims: Both) -> Ways | None:
        """Return what to ask for in this tick [rad]; None where there is hardly any room. Arguments as for `wider`."""
        if self._tight:
            self._tight -= 1
            return None
        return wider(here, ways, wanted, aims, self._most_rad)

    def keep(self, here: Both, lookahead: Ways | None, *, is_free: bool) -> None:
        """Keep what was found free; ask for more next time, or for less.

        Args:
            here: Where the joints were, shape (7,) per side [rad].
            lookahead: What was asked for.
            is_free: Whether that is free.
        """
        self._free = None
        if lookahead is None:
            return
        if is_free:
            self._free = list(_places(here, lookahead))
            self._most_rad = min(GROWS * self._most_rad, MOST_RAD)
        elif self._most_rad > LEAST_RAD:
            self._most_rad *= SHRINKS
        else:
            self._tight = TIGHT_TICKS


def wider(here: Both, ways: Ways, wanted: Wanted, aims: Both, most_rad: float) -> Ways:
    """Return ways that hold those of the next ticks as well [rad].

    Args:
        here: Where the joints are, shape (7,) per side [rad].
        ways: How far they may go from there in this tick, likewise [rad].
        wanted: For the arms that are moved, their next states.
        aims: For the same arms where they are bound for, shape (7,) each [rad].
        most_rad: How much wider they are at most, per joint and direction [rad].
    """
    found = dict(ways)
    stray = min(STRAY_RAD, most_rad)
    for side, (_, speeds, _) in wanted.items():
        row = []
        for q, (low, high), v, to in zip(here[side], ways[side], speeds, aims[side], strict=True):
            back = min(max(low - (to - q), -SPEED_S * v, stray), most_rad)
            forth = min(max((to - q) - high, SPEED_S * v, stray), most_rad)
            row.append((low - back, high + forth))
        found[side] = row
    return found


def _places(here: Both, ways: Ways) -> Iterator[Extent]:
    """Yield where each joint of both arms may be [rad]."""
    for side in Side:
        for q, (low, high) in zip(here[side], ways[side], strict=True):
            yield q + low, q + high
