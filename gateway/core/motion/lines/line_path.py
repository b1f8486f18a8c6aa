"""Line path: one arm's part of a straight motion: the state of its joints as a function of the path's own time.

A course for `JointReference`, as `Path` is: it begins in the exact state of the reference, at rest, its position, velocity and
acceleration are continuous, and it ends at rest. `line_clock.py` sees to it that its velocity, acceleration and jerk keep
their limits everywhere, `objection` that every setpoint is stoppable (`braking.py`).
"""

from __future__ import annotations

import math
from collections.abc import Generator

from msgspec import Struct

from gateway.core.motion.joints.braking import REST, Braking
from gateway.core.motion.lines.line_clock import LineClock
from gateway.core.motion.lines.line_curve import Curve
from gateway.core.motion.space import State
from gateway.values import ARM_DOF, Vector

__all__ = ["LinePath", "Unstoppable", "unstoppable"]

LOOKED_AT = 6
"""Setpoints that are looked at in one piece."""


class LinePath(Struct, frozen=True, kw_only=True):
    """One arm's part of a plan. The clock is shared by all arms of it; each arm keeps its own time.

    Attributes:
        start: The state at time 0, at rest; only a reference in exactly this state may enter.
        curve: Joints by the part of the way.
        clock: The part by time.
    """

    start: State
    curve: Curve
    clock: LineClock

    @property
    def duration_s(self) -> float:
        """Time from rest to rest, the same for all arms [s]."""
        return self.clock.duration_s

    @property
    def duration_ns(self) -> int:
        """The same [ns]."""
        return round(self.duration_s * 1e9)

    @property
    def end_rad(self) -> Vector:
        """Where this arm comes to rest, shape (7,) [rad]."""
        return self.curve.points[-1]

    def at(self, time_s: float) -> State:
        """Return the state `time_s` after the start; exactly at rest from `duration_s` on."""
        if time_s >= self.duration_s:
            return State(self.end_rad, REST, REST)
        part, rate, force = self.clock.at(time_s)
        q_rad, slopes, bends = self.curve.at(part)
        square = rate * rate
        return State(
            q_rad,
            tuple([slope * rate for slope in slopes]),
            tuple([bend * square + slope * force for bend, slope in zip(bends, slopes, strict=True)]),
        )


class Unstoppable(Struct, frozen=True, kw_only=True):
    """A setpoint from which a joint could not stop inside its limits.

    Attributes:
        joint: Its index.
        part: Of the way.
        q_rad: Where the joint is [rad].
        dq_radps: How quickly it turns [rad/s].
    """

    joint: int
    part: float
    q_rad: float
    dq_radps: float


def unstoppable(path: LinePath, braking: Braking) -> Generator[None, None, Unstoppable | None]:
    """Look for the first setpoint of a path from which a joint could not stop inside its limits, piece by piece."""
    near = [n for n in range(ARM_DOF) if not braking.is_far(n, *path.curve.peaks[n][:2])]
    if not near:
        return None
    for step in range(1, math.ceil(path.duration_s / braking.period_s)):
        time_s = step * braking.period_s
        q, v, a = path.at(time_s)
        for n in near:
            if not braking.can_stop(n, q[n], v[n], a[n]):
                return Unstoppable(joint=n, part=path.clock.at(time_s)[0], q_rad=q[n], dq_radps=v[n])
        if step % LOOKED_AT == 0:
            yield
    return None
