"""Straight lines for tests: both arms with their limits, a generator run to its end, and what setpoints use of the limits."""

from __future__ import annotations

import math
import random
from collections.abc import Generator, Sequence
from itertools import pairwise
from typing import TypeVar

from gateway.core.body.body import Body as Streams
from gateway.core.motion.joints.braking import Braking, JointLimits
from gateway.core.motion.lines.line_plan import Body, Going, plan_lines
from gateway.core.motion.space import Start
from gateway.kinematics.placement import Placement
from gateway.robot.limits import HOME_Q_RAD
from gateway.settings.settings import Settings
from gateway.values import EePose, Side, Vector
from tests.kinematics.bodies import ARMS, difference, samples

__all__ = [
    "DT_S",
    "FREE",
    "HOME",
    "LIMITS",
    "POSES",
    "beside",
    "finished",
    "going",
    "off_line",
    "planned",
    "random_way",
    "rest",
    "setpoints",
    "used",
]

T = TypeVar("T")
DT_S = 0.01
HOME = {side: ARMS[side].forward(HOME_Q_RAD[side]) for side in Side}
STREAMS = Streams(Settings())
LIMITS: dict[Side, JointLimits] = {side: STREAMS.joint_arms[side].reference.space.limits for side in Side}
POSES = {side: STREAMS.pose_arms[side].reference.space for side in Side}
FREE = Body(model=None, margin_m=0.02, q_rad={})
"""Nothing is watched."""


def finished(work: Generator[None, None, T]) -> tuple[T, int]:
    """Run work to its end; return what it returns, and how many pieces it took."""
    pieces = 1
    while True:
        try:
            next(work)
        except StopIteration as end:
            return end.value, pieces
        pieces += 1


def rest(side: Side, q_rad: Vector) -> Start[Braking]:
    """An arm at rest."""
    reference = Streams(Settings()).joint_arms[side].reference
    reference.seed(q_rad)
    return reference.here


def beside(side: Side, by_m: Vector) -> EePose:
    """A pose beside home, turned as at home."""
    p_m = tuple(p + d for p, d in zip(HOME[side].p_m, by_m, strict=True))
    return EePose(p_m=p_m, quat_xyzw=HOME[side].quat_xyzw)


def going(side: Side, target: EePose, q_rad: Vector | None = None) -> Going:
    """One arm that goes from joints, from home where none are given."""
    start = rest(side, HOME_Q_RAD[side] if q_rad is None else q_rad)
    return Going(arm=ARMS[side], start=start, target=target, poses=POSES[side])


def planned(target: EePose, q_rad: Vector | None = None, side: Side = Side.LEFT, speed: float = 1.0, body: Body = FREE):
    """The plan of one arm, or why there is none."""
    found, _ = finished(plan_lines({side: going(side, target, q_rad)}, body, speed))
    return found if not isinstance(found, dict) else found[side]


def random_way(rng: random.Random, side: Side, far_rad: float = 0.3) -> tuple[Vector, EePose]:
    """Joints anywhere, and the pose of others not far from them."""
    (q_rad,) = samples(side, 1, seed=rng.randrange(1 << 30))
    there = [
        min(max(q + rng.gauss(0.0, far_rad), low), high)
        for q, low, high in zip(q_rad, ARMS[side].lower_rad, ARMS[side].upper_rad, strict=True)
    ]
    return q_rad, ARMS[side].forward(there)


def setpoints(path) -> list[Vector]:
    """What a stream sends along a path: from rest before it to rest after it."""
    count = math.ceil(path.duration_s / DT_S) + 3
    return [path.start.values] * 3 + [path.at(n * DT_S)[0] for n in range(1, count)]


def used(sent: Sequence[Vector], limits: JointLimits) -> tuple[float, float, float]:
    """Which part of the limits of velocity, acceleration and jerk setpoints use, by their differences."""
    parts: list[float] = []
    rows = sent
    for order, bound in enumerate((limits.v_radps, limits.a_radps2, limits.j_radps3), start=1):
        rows = [tuple(b - a for a, b in zip(one, two, strict=True)) for one, two in pairwise(rows)]
        parts.append(max(abs(x) for row in rows for x in row) / DT_S**order / bound)
    return parts[0], parts[1], parts[2]


def off_line(side: Side, q_rad: Vector, wanted: Placement) -> float:
    """How far joints put the end effector from where it should be [m, rad: the greater]."""
    return max(difference(ARMS[side].chain.forward(q_rad), wanted))
