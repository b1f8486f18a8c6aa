"""Stopping: how far a joint goes until it stands, both ways, when it stops as quickly as its limits allow.

A stop is the quickest change of velocity to zero under limits of acceleration and jerk: jerk, constant acceleration, jerk
back. A joint that moves one way and accelerates the other may turn round on the way, so that a stop has an extent with two
ends, not one length.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

__all__ = ["STAYS", "Extent", "stop_extent", "way_extent"]

Extent = tuple[float, float]
"""How far a joint goes back (at most 0) and forth (at least 0) [rad]."""

STAYS: Extent = (0.0, 0.0)


def stop_extent(v: float, a: float, a_max: float, j_max: float) -> Extent:
    """Return how far a joint goes while it stops.

    Args:
        v: Velocity [rad/s].
        a: Acceleration [rad/s²], at most `a_max` in size.
        a_max: Acceleration limit [rad/s²].
        j_max: Jerk limit [rad/s³].
    """
    if v == 0.0 and a == 0.0:
        return STAYS
    # What is left of the velocity when the acceleration is taken back at once says which way to brake; mirrored to brake down.
    sign = -1.0 if v + a * abs(a) / (2.0 * j_max) < 0.0 else 1.0
    v, a = sign * v, sign * a
    peak = math.sqrt(max(j_max * v + 0.5 * a * a, 0.0))
    hold_s = 0.0
    if peak > a_max:
        hold_s, peak = (v + (0.5 * a * a - a_max * a_max) / j_max) / a_max, a_max
    first_s, last_s = max((a + peak) / j_max, 0.0), peak / j_max
    ahead = first_s * (v + first_s * (0.5 * a - first_s * j_max / 6.0))
    # The rest counted backwards from standstill.
    ahead += j_max * last_s * (last_s * last_s / 6.0 + 0.5 * hold_s * (last_s + hold_s))
    low, high = (ahead, 0.0) if ahead < 0.0 else (0.0, ahead)
    if v < 0.0:  # it goes back first, and turns in the first phase
        turn_s = (a - math.sqrt(max(a * a + 2.0 * j_max * v, 0.0))) / j_max
        low = min(low, turn_s * (v + turn_s * (0.5 * a - turn_s * j_max / 6.0)))
    return (low, high) if sign > 0.0 else (-high, -low)


def way_extent(from_rad: float, through: Sequence[float], stop: Extent) -> Extent:
    """Return how far a joint goes from a position through some others, at the last of which its stop begins.

    Args:
        from_rad: Where the body was looked at [rad].
        through: Positions that follow, at least one [rad].
        stop: Extent of the stop from the last of them [rad].
    """
    low, high = through[-1] + stop[0], through[-1] + stop[1]
    for q in (from_rad, *through):
        if q < low:
            low = q
        elif q > high:
            high = q
    return low - from_rad, high - from_rad
