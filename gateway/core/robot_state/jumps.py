"""What no arm can have moved to: samples that jump are refused, until the jump has lasted and is the new truth.

Rules
    * A sample may differ from the last believed one by what the bound allows in the time between the two, plus a margin.
      Once one is refused that time stands still: else every jump became plausible by waiting, before the part is dead
      and anybody has noticed.
    * That time is told by our clock. Stamps are the robot's word, or that of somebody on its network: a clock that steps
      ahead would make any jump plausible. They only make it less: where they say that less time has passed, less has.
    * A stall of the link makes arrivals lie: what was queued in it comes at once. But then the time was there before, as
      a gap of arrivals of which the first queued sample took only what its stamp says. What is left of the gap is *spare*
      for those behind it. So from the last sample before a stall on, no more time is given out than has passed on our
      clock, and no sample gets more than its stamp claims. Only a gap gives spare time, never more than itself, and for
      a second at most: a clock that runs slow, or is set back, cannot save any up.
    * A rival that goes on plausibly within itself for the seeding time, which is longer than a part lives without
      samples, is believed: the encoder was set, or we believed the wrong one first. That is told.

Distances are counted in seconds: how long an arm would need for them at its bound. Knows no topics, states or clocks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from operator import mul, sub
from typing import NamedTuple

from msgspec import Struct

from gateway.core.robot_state.arrival import Recent
from gateway.settings.settings import EnableSettings
from gateway.values import Vector

__all__ = ["JOINTS", "JUMP_RADPS", "POSES", "JumpGuard", "Kind", "Posture"]

MS = 1_000_000
S = 1_000_000_000

JUMP_RADPS = 10.0
"""Faster than a joint of this robot moves: three times our hard limit, and about what a forearm in free fall reaches
(sqrt(2 g h)/L with h = L = 0.25 m: 9 rad/s). The motors' 17-38 rad/s are no bound for what the links do."""
JUMP_MPS = 5.5
"""An end effector at the greatest reach, 0.55 m (manual §4.0.4), turned by one such joint."""
GAP_BUCKET_NS = 100 * MS
"""The longest gap of arrivals is that of ten of these."""

TURN_RADPS = 30.0
"""Three wrist joints turning the same way."""


class Posture(NamedTuple):
    """A sample of an arm: seven joints [rad], or position [m] and quaternion; with its times [ns].

    Attributes:
        values: Shape (7,).
        received_ns: Local arrival.
        stamp_ns: On the robot's clock; the arrival where the type has none.
    """

    values: Vector
    received_ns: int
    stamp_ns: int


class Kind(Struct, frozen=True):
    """What a posture's numbers mean.

    Attributes:
        steps: How far each part of a posture is from another, in its unit.
        parts: Name, unit and bound of the speed per part.
        margin_s: For noise and for jitter of arrival, as time at the bound [s].
    """

    steps: Callable[[Vector, Vector], list[float]]
    parts: tuple[tuple[str, str, float], ...]
    margin_s: float


def _joint_steps(old: Vector, new: Vector) -> list[float]:
    return [*map(abs, map(sub, new, old))]


def _pose_steps(old: Vector, new: Vector) -> list[float]:
    """Return distance [m] and angle [rad]; the sign of a quaternion means nothing."""
    cosine = min(1.0, abs(sum(map(mul, old[3:], new[3:]))))
    return [math.dist(old[:3], new[:3]), 2.0 * math.acos(cosine)]


JOINTS = Kind(_joint_steps, tuple((f"joint {n}", "rad", JUMP_RADPS) for n in range(1, 8)), 0.01)
"""0.1 rad are a joint's margin."""
POSES = Kind(_pose_steps, (("the position", "m", JUMP_MPS), ("the orientation", "rad", TURN_RADPS)), 0.02)
"""0.11 m and 0.6 rad are a pose's: it has no stamp, so a burst cannot be told from a jump."""


class JumpGuard:
    """Judges the samples of one topic.

    Args:
        kind: What their numbers mean.
        settings: How long a rival must last, and how old a part may become.
    """

    __slots__ = (
        "_allowed_ns",
        "_believed",
        "_gaps",
        "_kind",
        "_rival",
        "_rival_since_ns",
        "_settings",
        "_slowness",
        "_spare_ns",
        "jumped",
    )

    def __init__(self, kind: Kind, settings: EnableSettings) -> None:
        self._kind = kind
        self._slowness = [1.0 / bound for _, _, bound in kind.parts]
        self._settings = settings
        self.jumped = ""
        """What the latest believed posture is away from, when it was believed because it lasted; empty otherwise."""
        self.believe(None)

    def believe(self, posture: Posture | None) -> None:
        """Compare with this from now on; with None believe whatever comes next."""
        self._believed, self._rival_since_ns = posture, 0
        self._allowed_ns: int | None = None
        self._spare_ns = 0
        self._gaps = Recent(max, GAP_BUCKET_NS)
        self._rival: Posture | None = None

    def why_not(self, new: Posture) -> str:
        """Believe a posture and return nothing, or return why it is refused."""
        old, rival, self.jumped = self._believed, self._rival, ""
        if old is None:
            self.believe(new)
            return ""
        arrived_ns = new.received_ns - old.received_ns
        allowed_ns = _passed_ns(old, new, self._spare_ns) if self._allowed_ns is None else self._allowed_ns
        allowed_s = allowed_ns / S + self._kind.margin_s
        steps = self._kind.steps(old.values, new.values)
        if self._needed_s(steps) <= allowed_s:
            if self._allowed_ns is None:
                self._gaps.add(new.received_ns, arrived_ns)
                left_ns = max(0, self._spare_ns + arrived_ns - allowed_ns)
                self._spare_ns = min(left_ns, self._gaps.extreme(new.received_ns, 0))
                self._believed, self._rival = new, None
            else:
                self.believe(new)
            return ""
        if rival is None or not self._goes_on(rival, new):
            self._rival_since_ns = new.received_ns
        needed_s = [*map(mul, steps, self._slowness)]
        part = needed_s.index(max(needed_s))
        name, unit, bound = self._kind.parts[part]
        ago_ms = (new.received_ns - old.received_ns) / MS
        away = f"{name} is {steps[part]:.3f} {unit} away from where it was {ago_ms:.0f} ms ago"
        if new.received_ns - self._rival_since_ns >= self._settings.seed_ns:
            self.believe(new)
            self.jumped = f"{away}; it stays there and is believed from now on"
            return ""
        self._rival, self._allowed_ns = new, allowed_ns
        return (
            f"{away}, at most {allowed_s * bound:.3f} {unit} is plausible "
            f"({bound:g} {unit}/s and {self._kind.margin_s * bound:g} {unit} of noise)"
        )

    def _needed_s(self, steps: list[float]) -> float:
        needed_s: float = max(map(mul, steps, self._slowness))
        return needed_s

    def _goes_on(self, rival: Posture, new: Posture) -> bool:
        unbroken = new.received_ns - rival.received_ns <= self._settings.stale_ns
        needed_s = self._needed_s(self._kind.steps(rival.values, new.values))
        return unbroken and needed_s <= _passed_ns(rival, new, 0) / S + self._kind.margin_s


def _passed_ns(old: Posture, new: Posture, spare_ns: int) -> int:
    """Return the time in which an arm can have moved between two samples: what arrivals allow, or less by the stamps [ns].

    Stamps that do not go on were set back, and tell nothing.
    """
    arrived_ns, stamped_ns = new.received_ns - old.received_ns + spare_ns, new.stamp_ns - old.stamp_ns
    return min(arrived_ns, stamped_ns) if stamped_ns > 0 else arrived_ns - spare_ns
