"""Slope: how a commanded velocity gets from where it is to where it is wanted, component by component.

The robot ramps its chassis up by 0.3 and down by 0.6 (manual §4.5) and has no jerk limit. What is commanded here keeps
inside those ramps and limits the jerk besides, so that the robot can follow it at any moment: what it was told last is
what it does. A component that is wanted the other way comes to rest first, because its limits change there.

Closed form (`braking.ramp`), so that it cannot fail. It knows no clock: each `step` is one nominal period.
"""

from __future__ import annotations

from gateway.core.motion.joints.braking import advance, ramp
from gateway.values import Vector

__all__ = ["Slope"]

TINY = 1e-9
"""Rounding of a velocity [1/s] and of an acceleration [1/s²]: nearer than this it has arrived."""


class Slope:
    """The velocity of some independent components.

    Args:
        width: How many.
        up: Acceleration while a component grows in size [1/s²].
        down: Deceleration while it shrinks [1/s²].
        jerk: Jerk limit [1/s³].
        period_s: Time between two steps [s].
    """

    def __init__(self, width: int, *, up: float, down: float, jerk: float, period_s: float) -> None:
        self._rest: Vector = (0.0,) * width
        self._up, self._down, self._jerk = up, down, jerk
        self._period_s = period_s
        self.velocity: Vector = self._rest
        """What was commanded last."""
        self._rates: Vector = self._rest

    @property
    def is_at_rest(self) -> bool:
        """Whether nothing moves, and nothing is about to."""
        return not any(self.velocity) and not any(self._rates)

    def halt(self) -> None:
        """Be at rest at once: what a stop frame tells the robot."""
        self.velocity = self._rates = self._rest

    def step(self, wanted: Vector) -> Vector:
        """Advance by one period towards a velocity; return the one to command. Never raises.

        Args:
            wanted: Finite, as many as there are components.
        """
        pairs = [self._next(v, a, to) for v, a, to in zip(self.velocity, self._rates, wanted, strict=True)]
        self.velocity = tuple([v for v, _ in pairs])
        self._rates = tuple([a for _, a in pairs])
        return self.velocity

    def _next(self, v: float, a: float, wanted: float) -> tuple[float, float]:
        goal = wanted if v * wanted >= 0.0 else 0.0
        missing = goal - (v + a * abs(a) / (2.0 * self._jerk))
        limit = self._up if missing * (v or goal) > 0.0 else self._down
        _, v, a = advance(0.0, v, a, ramp(v, a, goal, limit, self._jerk), self._period_s)
        return (goal, 0.0) if abs(v - goal) < TINY and abs(a) < TINY else (v, a)
