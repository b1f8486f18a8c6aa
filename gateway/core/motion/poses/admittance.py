"""Admittance: a virtual mass at the hand, which forces push, and which dampers and springs to its anchor hold back.

For each free axis, in the frame of the arm's poses, M dv/dt = F - D v - K x, x from the anchor. Turns are rotation vectors from
the anchor's orientation. A locked axis stays with the anchor.

Why it does not swing
    * By itself: K <= D²/(4 M) (`limits/admittance_rules.py` refuses more) makes both roots real. The step is implicit,
      v' = (M v + h (F - K x)) / (M + h D + h² K) and x' = x + h v': its roots are 1 / (1 - h r) for a root r < 0, between 0 and
      1 whatever h. So whatever is permitted creeps home, and neither swings nor grows.
    * Held by something of stiffness E (a person, or the arm's own servos against a table), whose force comes late by a chain of
      lags and delays, T in all: the loop is E / (M s² + D s + K) with a phase lag p <= w T more. Where it comes round in phase,
      |K - M w² + j D w| = D w / sin p, so that its gain is E sin p / (D w) <= E T / D. Hence D >= E T is enough, whatever M and
      K. `LEAST_DAMPING` are such D for the E and T that `admittance_rules.py` names.
    * Setpoints lag behind what they follow (`follower.py`), the more the faster, and are part of T. So what is followed is
      where the mass will be after that lag, but never beyond where it would coast to without a force, v M / D.
    * Nothing winds up: the mass is never faster than setpoints may be, nor beyond the reach; it knows no integral of a force.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from gateway.core.motion.poses.pose_follower import followed
from gateway.core.motion.poses.pose_state import REST6, PoseDynamics
from gateway.core.motion.poses.pose_tracker import lag_s
from gateway.core.motion.poses.quaternion import exp, multiply, turn, unit
from gateway.values import Vector

__all__ = ["VirtualMass"]

MOST_TURN_RAD = 1.0
"""A hand is not turned further from its anchor [rad]: beyond, rotation vectors are no coordinates of moments any more."""
INSIDE = 1.0 - 1e-9
"""Rounding must not put what is at the end of the reach outside."""

LINEAR, ANGULAR = slice(0, 3), slice(3, 6)


class VirtualMass:
    """What a stream of one arm feels like.

    Args:
        mass: Per axis x, y, z [kg], then about them [kg·m²]; None for an axis that is locked.
        damping: Likewise [N·s/m, N·m·s/rad].
        stiffness: Likewise [N/m, N·m/rad].

    Attributes:
        anchor: Where its springs lead and locked axes are: x, y, z [m], qx, qy, qz, qw.
        place: Where it is, likewise; empty while it does not move.
        force: What pushed it last [N], then turned it [N·m].
    """

    def __init__(self, mass: Sequence[float | None], damping: Vector, stiffness: Vector) -> None:
        self._axes = tuple(zip(mass, damping, stiffness, strict=True))
        self.anchor: Vector = ()
        self.rest(())

    def rest(self, place: Vector) -> None:
        """Begin anew at rest: at a pose, or nowhere."""
        self.place: Vector = place
        self.force: Vector = REST6
        self._v: Vector = REST6

    def step(self, dynamics: PoseDynamics, force: Vector, share: float) -> Vector:
        """Move by one period; return the pose to be followed.

        Args:
            dynamics: Limits of the setpoints that follow it.
            force: What pushes it [N], then turns it [N·m], shape (6,).
            share: Part of the speed limits that it may use, 0 < share <= 1.
        """
        reach_m, top_mps, _, top_radps, _ = followed(dynamics)
        h = dynamics.period_s
        place, anchor = self.place, self.anchor
        away = [a - b for a, b in zip(place[:3], anchor[:3], strict=True)]
        away += turn(anchor[3:], place[3:])
        v = [0.0] * 6
        for n, (m, d, k) in enumerate(self._axes):
            if m is None:
                away[n] = 0.0
            else:
                v[n] = (m * self._v[n] + h * (force[n] - k * away[n])) / (m + h * d + h * h * k)
        for axes, top in ((LINEAR, top_mps), (ANGULAR, top_radps)):
            over = math.hypot(*v[axes]) / (share * top)
            if over > 1.0:
                v[axes] = [x / over for x in v[axes]]
        away = [x + h * dx for x, dx in zip(away, v, strict=True)]
        turned_rad = math.hypot(*away[ANGULAR])
        if turned_rad > MOST_TURN_RAD:
            away[ANGULAR] = [x * MOST_TURN_RAD / turned_rad for x in away[ANGULAR]]
        self._v, self.force = tuple(v), force
        self.place = _pose(anchor, away, reach_m)
        lags = [lag_s(abs(dx), dynamics.linear) for dx in v[LINEAR]]
        lags += [lag_s(math.hypot(*v[ANGULAR]), dynamics.angular)] * 3
        coasts = [0.0 if m is None else m / d for m, d, _ in self._axes]
        ahead = [x + dx * min(lag, coast) for x, dx, lag, coast in zip(away, v, lags, coasts, strict=True)]
        return _pose(anchor, ahead, reach_m)


def _pose(anchor: Vector, away: Sequence[float], reach_m: float) -> Vector:
    """Return the pose that far away from the anchor [m, rad], moved to the end of the reach where it is beyond."""
    p_m = [x + dx for x, dx in zip(anchor[:3], away[:3], strict=True)]
    far_m = math.hypot(*p_m)
    if far_m > reach_m * INSIDE:
        p_m = [x * reach_m * INSIDE / far_m for x in p_m]
    return (*p_m, *unit(multiply(exp(tuple(away[3:])), anchor[3:])))
