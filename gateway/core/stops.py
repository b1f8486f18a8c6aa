"""Stops: how the joints of both arms go when they take one step and then all brake, at once, as quickly as they can.

That is what remains for arms that must not go on, whatever moves them: each joint's stop is a course of its own, and all begin
in the same instant, so that where the joints are together is known for every instant (`kinematics.judgement.Course`).
"""

from __future__ import annotations

from collections.abc import Mapping

from gateway.core.braking import JointLimits, Ramp, advance, duration, ramp
from gateway.core.path import State
from gateway.kinematics.judgement import Ways
from gateway.kinematics.stopping import Extent, stop_extent
from gateway.values import Side, Vector

__all__ = ["Stops"]

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

    def at(self, time_s: float) -> dict[Side, Vector]:
        """Return where the joints are [rad]; between the beginning and the end of the step: at its end.

        Args:
            time_s: Since the beginning [s].
        """
        if time_s <= 0.0:
            return dict(self._here)
        found, after_s = dict(self._here), self._after(time_s)
        for side, joints in self._joints.items():
            found[side] = tuple([advance(q, v, a, stop, after_s)[0] for q, v, a, stop in joints])
        return found

    def ways(self, from_s: float, to_s: float) -> dict[Side, list[Extent]]:
        """Return how far the joints go in between from where they are at `from_s`: at most, back and forth [rad].

        Args:
            from_s: Begin [s].
            to_s: End [s]; of a time within the step its end counts.
        """
        return {
            side: [self._way(self._here[side][k], joint, from_s, to_s) for k, joint in enumerate(self._joints[side])]
            if side in self._joints
            else list(self._adrift[side])
            for side in Side
        }

    def _way(self, here: float, joint: Joint, from_s: float, to_s: float) -> Extent:
        q, v, a, stop = joint
        begin = here
        if from_s > 0.0:
            q, v, a = advance(q, v, a, stop, self._after(from_s))
            begin = q
        if v * ramp(v, a, 0.0, self._a_max, self._j_max)[3] > 0.0:
            # It moves one way and accelerates the other already: it turns back, and may end anywhere in between.
            low, high = stop_extent(v, a, self._a_max, self._j_max)
        else:
            end = advance(joint[0], joint[1], joint[2], stop, self._after(to_s))[0]
            low, high = min(end - q, 0.0), max(end - q, 0.0)
        return min(q + low - begin, 0.0), max(q + high - begin, 0.0)

    def _after(self, time_s: float) -> float:
        return max(time_s - self._period_s, 0.0)
