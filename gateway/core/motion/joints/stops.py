"""Stops: how the joints of both arms go when they take one step and then all brake, at once, as quickly as they can.

That is what remains for arms that must not go on, whatever moves them: each joint's stop is a course of its own, and all begin
in the same instant, so that where the joints are together is known for every instant (`kinematics.judgement.Course`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gateway.core.motion.joints.braking import JointLimits, Ramp, advance, duration, ramp
from gateway.core.motion.space import State
from gateway.kinematics.separation.judgement import Ways
from gateway.kinematics.separation.stopping import STAYS, Extent, stop_extent
from gateway.values import Side, Vector

__all__ = ["MOST_SETPOINTS", "Stops"]

MOST_SETPOINTS = 12
"""A course of so many setpoints, or fewer, is told setpoint by setpoint."""

ROUNDING = 1e-9
"""Of a number of setpoints."""

Joint = tuple[float, float, float, Ramp]
"""Position [rad], velocity [rad/s] and acceleration [rad/s²] after the step, and the stop from there."""


class Stops:
    """One step and the stop after it.

    Args:
        here: Where the joints are, per side shape (7,) [rad].
        after: Per arm that is moved, its state after the step.
        adrift: For the other arm how far its joints may go from where they are, at any time [rad].
        limits: Of the joints that are moved; velocity, acceleration and jerk are those of both arms.
        period_s: Duration of the step [s].

    Attributes:
        duration_s: Until all joints stand [s].
    """

    def __init__(
        self,
        here: Mapping[Side, Vector],
        after: Mapping[Side, State],
        adrift: Ways,
        limits: JointLimits,
        period_s: float,
    ) -> None:
        self._here = here
        self._adrift = adrift
        self._period_s = period_s
        self._a_max, self._j_max = limits.a_radps2, limits.j_radps3
        self._joints: dict[Side, list[Joint]] = {
            side: [(q, v, a, ramp(v, a, 0.0, self._a_max, self._j_max)) for q, v, a in zip(*state, strict=True)]
            for side, state in after.items()
        }
        stops_s = [duration(stop) for joints in self._joints.values() for *_, stop in joints]
        self.duration_s = period_s + max(stops_s, default=0.0)

    def pieces(self, parts: Sequence[float]) -> tuple[list[Mapping[Side, Vector]], list[Ways]]:
        """Return the course in pieces: where the joints are when each begins [rad], and how far they go in it from there [rad].

        Args:
            parts: Where pieces are parted: parts of the course's duration, between 0 and 1, ascending. What would be within
                the step is at its end.
        """
        times_s = [max(part * self.duration_s - self._period_s, 0.0) for part in (*parts, 1.0)]
        rows: dict[Side, list[tuple[list[float], list[Extent]]]] = {
            side: [
                self._course(q, joint, times_s) for q, joint in zip(self._here[side], self._joints[side], strict=True)
            ]
            for side in self._joints
        }
        begins: list[Mapping[Side, Vector]] = []
        ways: list[Ways] = []
        for number in range(len(times_s)):
            begins.append(
                {
                    side: tuple([row[0][number] for row in rows[side]]) if side in rows else self._here[side]
                    for side in Side
                }
            )
            ways.append(
                {side: [row[1][number] for row in rows[side]] if side in rows else self._adrift[side] for side in Side}
            )
        return begins, ways

    def setpoints(self) -> list[Mapping[Side, Vector]] | None:
        """Return where the joints are at each setpoint of a short course [rad]; None of a long one, or if an arm drifts."""
        count = math.ceil(self.duration_s / self._period_s - ROUNDING)
        drifts = any(way != STAYS for side in Side if side not in self._joints for way in self._adrift[side])
        if count > MOST_SETPOINTS or drifts:
            return None
        found: list[Mapping[Side, Vector]] = []
        for number in range(count):
            places = {
                side: tuple([advance(q, v, a, stop, number * self._period_s)[0] for q, v, a, stop in joints])
                for side, joints in self._joints.items()
            }
            found.append({**self._here, **places})
        return found

    def _course(self, here: float, joint: Joint, times_s: Sequence[float]) -> tuple[list[float], list[Extent]]:
        """Return where a joint is when each piece begins [rad], and how far it goes in it [rad]; pieces end at these times."""
        q, v, a, stop = joint
        begins, ways, begin = [], [], here
        for time_s in times_s:
            ahead = advance(*joint[:3], stop, time_s)
            if v * ramp(v, a, 0.0, self._a_max, self._j_max)[3] > 0.0:
                # It moves one way and accelerates the other already: it turns back, and may end anywhere in between.
                low, high = stop_extent(v, a, self._a_max, self._j_max)
            else:
                low, high = min(ahead[0] - q, 0.0), max(ahead[0] - q, 0.0)
            begins.append(begin)
            ways.append((min(q + low - begin, 0.0), max(q + high - begin, 0.0)))
            q, v, a = ahead
            begin = q
        return begins, ways
