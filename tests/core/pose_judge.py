"""Poses for tests, and a judge of setpoints: linear and angular differences against the limits, as norms."""

from __future__ import annotations

import math
import random
from itertools import pairwise

from gateway.core.motion.poses.pose_state import REST6
from gateway.core.motion.poses.quaternion import dot, exp, multiply, turn, unit
from gateway.core.motion.space import State
from gateway.settings.settings import PoseSettings

LIMITS = PoseSettings(v_mps=0.25, a_mps2=1.5, j_mps3=10.0, w_radps=0.8, dw_radps2=5.0, ddw_radps3=30.0, reach_m=0.55)
HARD = PoseSettings(v_mps=0.5, a_mps2=5.0, j_mps3=100.0, w_radps=1.5, dw_radps2=15.0, ddw_radps3=300.0, reach_m=0.55)
WEAK = PoseSettings(v_mps=0.5, a_mps2=0.3, j_mps3=1.0, w_radps=1.5, dw_radps2=2.25, ddw_radps3=3.4, reach_m=0.55)
"""As fast as allowed with the least acceleration and jerk that a turn needs."""
DT = 1.0 / 70.0
TOLERANCE = 1e-6
"""Part of a limit by which a difference may exceed it: rounding."""

HOME = (0.30, 0.10, -0.20, 0.0, 0.0, 0.0, 1.0)


def posed(p_m, quat_xyzw=HOME[3:], v=REST6, a=REST6) -> State:
    """A state of an end effector, at rest where nothing is said of its motion."""
    return State((*p_m, *quat_xyzw), v, a)


def about(axis, angle_rad):
    """The quaternion of a turn about an axis."""
    half, length = 0.5 * angle_rad, math.hypot(*axis)
    return (*(math.sin(half) * c / length for c in axis), math.cos(half))


def any_pose(rng: random.Random, reach_m=0.55):
    """Anywhere in the reach, half of the time near its end; any orientation, in either sign."""
    direction = [rng.gauss(0.0, 1.0) for _ in range(3)]
    part = rng.random() ** (1.0 / rng.choice((3.0, 30.0)))
    scale = 0.9999999 * reach_m * part / math.hypot(*direction)
    return (*(scale * c for c in direction), *unit(tuple(rng.gauss(0.0, 1.0) for _ in range(4))))


def even_pose(rng: random.Random, values, reach_m=0.55):
    """Beside a pose, as far along one axis as along another: three axes at their shares move along a line then."""
    part = rng.choice((1.0, 1.0, rng.uniform(0.1, 1.0)))
    moved_m, turned_rad = ([rng.choice((-1, 0, 1)) for _ in range(3)] for _ in range(2))
    step_m, step_rad = rng.choice((0.001, 0.01, 0.07, 0.3)), rng.choice((0.001, 0.05, 0.6, 1.5))
    p_m = [x + step_m * n for x, n in zip(values[:3], (part * moved_m[0], *moved_m[1:]), strict=True)]
    scale = min(1.0, 0.9999999 * reach_m / max(math.hypot(*p_m), 1e-9))
    turn_rad = tuple(step_rad * n for n in (turned_rad[0], part * turned_rad[1], turned_rad[2]))
    return (*(scale * x for x in p_m), *multiply(exp(turn_rad), tuple(values[3:])))


def rates(setpoints, period_s):
    """Linear and angular velocities between setpoints."""
    linear = [tuple((y - x) / period_s for x, y in zip(a[:3], b[:3], strict=True)) for a, b in pairwise(setpoints)]
    angular = [tuple(c / period_s for c in turn(a[3:], b[3:])) for a, b in pairwise(setpoints)]
    return linear, angular


def judge(setpoints, limits: PoseSettings, period_s=DT, reach_m=None) -> None:
    """Differences keep velocity, acceleration and jerk as norms; the sign never flips; the reach is kept, or another one."""
    bounds = (
        (limits.v_mps, limits.a_mps2, limits.j_mps3),
        (limits.w_radps, limits.dw_radps2, limits.ddw_radps3),
    )
    for values, group in zip(rates(setpoints, period_s), bounds, strict=True):
        for bound in group:
            assert max((math.hypot(*value) for value in values), default=0.0) <= bound * (1.0 + TOLERANCE)
            values = [tuple((y - x) / period_s for x, y in zip(a, b, strict=True)) for a, b in pairwise(values)]
    assert all(dot(a[3:], b[3:]) > 0.0 for a, b in pairwise(setpoints))
    assert all(math.hypot(*p[:3]) <= (reach_m or limits.reach_m) + 1e-9 for p in setpoints)
    assert all(abs(math.hypot(*p[3:]) - 1.0) < 1e-12 for p in setpoints)
