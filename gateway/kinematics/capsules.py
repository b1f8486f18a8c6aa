"""Capsules: the body's hull, and which of its parts can meet.

A capsule is all that lies within a radius of a straight line: what is fastest to compare. The sizes are those of
`capsules.toml`, each with what it rests on; most are guesses, so that a user who has measured a robot gives better ones.

Pairs that need no watching are left out, each with a reason (`Hull.skipped`): parts of one link, parts that a joint joins,
and parts that only the lift moves against each other.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from gateway.values import Side, ValueRefused, Vector

if sys.version_info >= (3, 11):
    import tomllib
else:  # the same parser under its old name
    import tomli as tomllib

__all__ = ["DATA_FILE", "Capsule", "Hull", "Pair", "hull"]

DATA_FILE = Path(__file__).with_name("capsules.toml")
"""Sizes, with what they rest on."""

CHEST, BASE = "chest", "base"
NOTHING: Vector = (0.0, 0.0, 0.0)

WRIST = (
    frozenset({"forearm", "wrist_camera"}),
    frozenset({"forearm", "upper_finger"}),
    frozenset({"forearm", "lower_finger"}),
)
JOINED = {
    frozenset({"shoulder", "upper"}): "joints 1 and 2 join them",
    frozenset({"upper", "forearm"}): "joint 4 joins them",
    frozenset({"forearm", "palm"}): "joints 6 and 7 join them",
    **dict.fromkeys(WRIST, "the ranges of joints 6 and 7 keep them apart"),
}


class Capsule(Struct, frozen=True, kw_only=True):
    """One part of the hull.

    Attributes:
        name: Of the part, its side in front where there are two: `left_forearm`, `torso`.
        part: The same without the side.
        side: Which arm it belongs to; None for the middle.
        frame: `arm`: shoulder frame of its side with the arm at zero, as described; `chest`; or `base` (`base_link`).
        after: Joint that moves it last, 1 to 7; 0 for a part that no joint moves.
        from_m: One end of its line, shape (3,) [m].
        to_m: The other, shape (3,) [m].
        radius_m: Around the line [m].
        opens: How far it goes per metre of the gripper's opening, shape (3,).
    """

    name: str
    part: str
    side: Side | None
    frame: str
    after: int
    from_m: Vector
    to_m: Vector
    radius_m: float
    opens: Vector = NOTHING


class Pair(Struct, frozen=True, kw_only=True):
    """Two parts, and why they are not watched; `why` is empty for those that are."""

    first: Capsule
    second: Capsule
    why: str = ""


class Hull(Struct, frozen=True, kw_only=True):
    """All parts.

    Attributes:
        capsules: The parts: first those of the left arm, then of the right one, then those that no joint moves.
        margin_m: What has to stay free between any two [m].
    """

    capsules: tuple[Capsule, ...]
    margin_m: float

    @property
    def watched(self) -> tuple[Pair, ...]:
        """Pairs that can meet."""
        return tuple(pair for pair in self._pairs() if not pair.why)

    @property
    def skipped(self) -> tuple[Pair, ...]:
        """Pairs that are left out, each with the reason."""
        return tuple(pair for pair in self._pairs() if pair.why)

    def with_radii(self, radius_m: Mapping[str, float]) -> Hull:
        """Return the hull with other radii.

        Args:
            radius_m: By name of a part: `torso`, `left_palm`, or `palm` for both [m].

        Raises:
            ValueRefused: There is no such part, or a radius is not above 0.
        """
        known = {name for capsule in self.capsules for name in (capsule.name, capsule.part)}
        for name, value in radius_m.items():
            if name not in known:
                raise ValueRefused(f"the hull has no part {name!r}; there are {', '.join(sorted(known))}")
            if not (math.isfinite(value) and value > 0.0):
                raise ValueRefused(f"radius of {name}: {value} m is not above 0")
        return replace(
            self,
            capsules=tuple(
                replace(c, radius_m=radius_m.get(c.name, radius_m.get(c.part, c.radius_m))) for c in self.capsules
            ),
        )

    def _pairs(self) -> Iterator[Pair]:
        for first, second in combinations(self.capsules, 2):
            yield Pair(first=first, second=second, why=_why(first, second))


@cache
def hull() -> Hull:
    """Return the hull of our own data file."""
    with DATA_FILE.open("rb") as file:
        table = tomllib.load(file)
    arms = [_capsule(name, row, "arm", side) for side in Side for name, row in table["arm"].items()]
    rest = [
        _capsule(name, row, frame, side)
        for frame in (CHEST, BASE)
        for name, row in table[frame].items()
        for side in (tuple(Side) if row.get("sided") else (None,))
    ]
    return Hull(capsules=(*arms, *rest), margin_m=table["margin_m"])


def _capsule(part: str, row: Mapping[str, Any], frame: str, side: Side | None) -> Capsule:
    mirror = -1.0 if side is Side.RIGHT else 1.0
    begin, end, opens = ((x, mirror * y, z) for x, y, z in (row["from_m"], row["to_m"], row.get("opens", NOTHING)))
    return Capsule(
        name=part if side is None else f"{side}_{part}",
        part=part,
        side=side,
        frame=frame,
        after=row.get("after", 0),
        from_m=begin,
        to_m=end,
        radius_m=row["radius_m"],
        opens=opens,
    )


def _why(a: Capsule, b: Capsule) -> str:
    """Return why a pair needs no watching; empty if it does."""
    if not a.after and not b.after:
        return "no joint of an arm moves them"
    if a.side is not b.side:
        return ""
    if a.after == b.after:
        return "one link"
    return JOINED.get(frozenset({a.part, b.part}), "")
