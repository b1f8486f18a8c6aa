"""Tolerances of a trajectory: how far each joint may be from where it should be, on the way and at the end, and how long.

Three of them, as trajectory controllers have them:

* *Path*: per joint, between the measured position and the trajectory at the same instant, from the time on at which the
  arm has joined it until its last point. A joint without one is only guarded as any motion is (tracking error).
* *Goal*: per joint, between the measured position and the last point, to be kept for the settling time. A joint
  without one has the configured tolerance.
* *Goal time*: how long after the last point that may take; it counts from the planned end on the clock, so that a
  trajectory that was held up anywhere on its way is too late as well.

For poses there are two in place of seven: of the position [m] and of the orientation [rad].

The arm lags behind its setpoints, and a path tolerance must leave room for that (some 50 ms times the velocity).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from msgspec import Struct

from gateway.codes import Code
from gateway.core.motion.bounds import outside, wrong_count
from gateway.core.motion.poses.quaternion import angle_rad
from gateway.errors import Refusal
from gateway.values import ARM_DOF, Side, Space, Vector

__all__ = ["Deviation", "PerJoint", "Tolerances", "apart", "check_tolerances", "first_beyond"]

S = 1_000_000_000

PerJoint = tuple[float | None, ...]
"""Per joint a tolerance [rad], or one of the position [m] and one of the orientation [rad]; None where there is none."""

PARTS = {Space.JOINT: tuple(f"joint {n}" for n in range(1, ARM_DOF + 1)), Space.POSE: ("position", "orientation")}
UNITS = {Space.JOINT: ("rad",) * ARM_DOF, Space.POSE: ("m", "rad")}
"""What tolerances are of, and their units, in their order."""

LEAST = 1e-4
MOST = 0.5
"""Of a tolerance [rad, m]."""
LEAST_NS = S // 10
MOST_NS = 60 * S


class Tolerances(Struct, frozen=True, kw_only=True):
    """What a trajectory is judged by; checked.

    Attributes:
        path: Per arm, and joint or part of the pose, on the way [rad, m]; infinite where there is none.
        goal: The same at the end.
        goal_time_ns: How long after its planned end it may settle [ns].
        space: In which they are meant.
    """

    path: Mapping[Side, Vector]
    goal: Mapping[Side, Vector]
    goal_time_ns: int
    space: Space = Space.JOINT


class Deviation(Struct, frozen=True, kw_only=True):
    """A part of an arm that is not where it should be.

    Attributes:
        part: `joint 1` to `joint 7`, `position` or `orientation`.
        off: How far it is off [unit].
        bound: How far it may be off [unit].
        unit: `rad` or `m`.
    """

    part: str
    off: float
    bound: float
    unit: str

    def __str__(self) -> str:
        """Say which part, and how far it is off."""
        return f"{self.part} is {self.off:.4f} {self.unit}"


def apart(space: Space, wanted: Vector, measured: Vector) -> Vector:
    """Return how far apart two places are: per joint [rad], or position and orientation [m, rad]."""
    if space is Space.JOINT:
        return tuple([abs(want - is_at) for want, is_at in zip(wanted, measured, strict=True)])
    return math.dist(wanted[:3], measured[:3]), angle_rad(wanted[3:], measured[3:])


def first_beyond(space: Space, wanted: Vector, measured: Vector, tolerance: Vector) -> Deviation | None:
    """Return the first part that is farther from where it should be than it may; None when all are near enough."""
    offs = apart(space, wanted, measured)
    for part, unit, off, bound in zip(PARTS[space], UNITS[space], offs, tolerance, strict=True):
        if not off <= bound:
            return Deviation(part=part, off=off, bound=bound, unit=unit)
    return None


def check_tolerances(
    sides: Sequence[Side],
    path: Mapping[Side, PerJoint],
    goal: Mapping[Side, PerJoint],
    goal_time_ns: int | None,
    settled: Vector,
    settle_timeout_ns: int,
    space: Space = Space.JOINT,
) -> Tolerances | Refusal:
    """Return the tolerances to judge by, or what is wrong with those that were asked for.

    A tolerance is in [0.0001, 0.5]: one for each joint [rad], for poses two [m, rad]. A goal time is 0.1 to 60 s.
    What is not given is unbounded on the way, and as configured at the end (`settled`, `settle_timeout_ns`).
    """
    for name, asked in (("path_tolerance", path), ("goal_tolerance", goal)):
        for side, values in asked.items():
            refusal = _check(f"{name}.{side}", values, space) if side in sides else _stranger(name, side)
            if refusal is not None:
                return refusal
    if goal_time_ns is not None and not LEAST_NS <= goal_time_ns <= MOST_NS:
        hint = "stay inside the bound, or leave it away for the configured time"
        span_s = LEAST_NS / S, MOST_NS / S
        return outside("the goal time", goal_time_ns / S, *span_s, "s", field="goal_time_ns", hint=hint)
    nothing: PerJoint = (None,) * len(settled)
    free = (math.inf,) * len(settled)
    return Tolerances(
        path={side: _filled(path.get(side, nothing), free) for side in sides},
        goal={side: _filled(goal.get(side, nothing), settled) for side in sides},
        goal_time_ns=settle_timeout_ns if goal_time_ns is None else goal_time_ns,
        space=space,
    )


def _filled(values: PerJoint, otherwise: Vector) -> Vector:
    return tuple([other if value is None else value for value, other in zip(values, otherwise, strict=True)])


def _stranger(name: str, side: Side) -> Refusal:
    return Refusal(
        code=Code.WRONG_SHAPE,
        message=f"{name} is given for the {side} arm, which does not move",
        field=f"{name}.{side}",
    )


def _check(name: str, values: PerJoint, space: Space) -> Refusal | None:
    parts = PARTS[space]
    if len(values) != len(parts):
        return wrong_count(name, len(values), len(parts), name, ", ".join(parts))
    for index, (part, unit, value) in enumerate(zip(parts, UNITS[space], values, strict=True)):
        if value is None or LEAST <= value <= MOST:
            continue
        hint = "stay inside the bound, or give none for a part that has no tolerance of its own"
        return outside(f"{name} for {part}", value, LEAST, MOST, unit, field=f"{name}[{index}]", hint=hint)
    return None
