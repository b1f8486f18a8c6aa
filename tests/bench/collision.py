"""Collision: distances of all pairs of the body beside pinocchio's (coal's capsules), and the rule by which arms approach.

Without pinocchio the peer is brute force in numpy: all pairs at once, a few array operations.
"""

from __future__ import annotations

import random
import statistics
import time
from collections.abc import Callable, Mapping
from unittest.mock import patch

import numpy as np

from gateway.core.separation.spacing import Spacing
from gateway.kinematics.clearance import ordinary
from gateway.kinematics.collision import CollisionModel
from gateway.kinematics.description import nominal
from gateway.robot.limits import HOME_Q_RAD
from gateway.settings.settings import ArmSettings
from gateway.values import Side, Vector
from tests.bench.table import Row
from tests.kinematics.guarded_arms import GuardedArms, random_joints
from tests.kinematics.peer import has_pinocchio, pinocchio_least
from tests.spaced import SpacedPair

__all__ = ["collision_rows"]

GOAL_US = 150.0
COUNT = 300
A_RADPS2, J_RADPS3 = 3.0, 20.0
"""Limits of a joint by default [rad/s², rad/s³]."""

Both = Mapping[Side, Vector]


def collision_rows(count: int = COUNT) -> list[Row]:
    """Measure postures anywhere inside the limits, and ordinary streaming from home.

    Args:
        count: Postures; three times as many ticks.
    """
    model = CollisionModel(nominal())
    rng = random.Random(count)
    postures = [random_joints(rng) for _ in range(count)]
    ours_us = _median_us(lambda q: model.posture(q).nearest(), postures)
    peer_name, peer = ("pinocchio", pinocchio_least(model)) if has_pinocchio() else ("numpy", _numpy(model))
    off_m = max(abs(model.posture(q).nearest().gap_m - gap) for q in postures if (gap := peer(q)) > 0.0)
    peer_us = _median_us(peer, postures)
    rows = [
        Row(
            name=f"nearest of {len(model.pairs)} pairs, both arms",
            ours=f"p50 {ours_us:.0f} us",
            peer=f"{peer_name} {peer_us:.0f} us, {off_m:.0e} m apart",
            ratio=f"{peer_us / ours_us:.1f}x",
            goal=f"<= {GOAL_US:g} us",
            good=ours_us <= GOAL_US and off_m < 1e-6,
        )
    ]
    # Asked anew for each setpoint: the engine asks only when the arms leave what was found free, see below.
    for name, v_radps in (("at 0.3 rad/s", 0.3), ("at 1 rad/s", 1.0)):
        taken = sorted(_rule_us(v_radps, count))
        p50, p90 = taken[len(taken) // 2], taken[int(0.9 * len(taken))]
        rows.append(
            Row(
                name=f"rule of approach with distances, both arms {name}",
                ours=f"p50 {p50:.0f}, p90 {p90:.0f} us",
            )
        )
    for name, v_radps in (("at 0.3 rad/s", 0.3), ("at 1 rad/s", 1.0)):
        taken = sorted(_kept_apart_us(v_radps, count))
        p50, p90, p99 = (taken[int(part * len(taken))] for part in (0.5, 0.9, 0.99))
        rows.append(
            Row(
                name=f"arms kept apart in the tick, both streaming {name}",
                ours=f"p50 {p50:.0f}, p90 {p90:.0f}, p99 {p99:.0f}, mean {statistics.fmean(taken):.0f} us",
                goal=f"p50 <= {GOAL_US:g} us",
                good=p50 <= GOAL_US,
            )
        )
    return rows


def _kept_apart_us(v_radps: float, count: int) -> list[float]:
    """Return what the engine spends on keeping arms apart in each tick [us], in processor time of this thread.

    Both hands stream from place to place before the body, a new one every second. What the setpoints themselves cost is not
    in it.
    """
    pair = SpacedPair(ArmSettings(v_radps=v_radps))
    places = list(ordinary(nominal()))
    random.Random(1).shuffle(places)
    pair.lead(HOME_Q_RAD, 12.0)
    arms, look, taken = pair.coordinator.body.joint_arms, Spacing.look, []

    def timed(spacing: Spacing, now_ns: int) -> None:
        for arm in arms.values():
            arm.reference.ahead()
        begun = time.thread_time_ns()
        look(spacing, now_ns)
        taken.append((time.thread_time_ns() - begun) / 1e3)

    with patch.object(Spacing, "look", timed):
        for place in places[: max(1, count // 30)]:
            for _ in range(20):
                for side in Side:
                    pair.target(pair.epoch, pair.streams[side], place[side])
                pair.run(0.05)
    return taken


def _rule_us(v_radps: float, count: int) -> list[float]:
    """Return what a tick's judgement takes [us], all joints streaming to targets anywhere, a new one every second."""
    rng = random.Random(1)
    arms = GuardedArms(HOME_Q_RAD, v_radps, A_RADPS2, J_RADPS3)
    while len(arms.judged_us) < 3 * count:
        arms.stream(random_joints(rng), 1.0)
    return arms.judged_us


def _numpy(model: CollisionModel) -> Callable[[Both], float]:
    """Return the distance of all pairs at once; posture as ours."""
    first, second = (np.array([pair[n] for pair in model.pairs]) for n in (0, 1))
    radii = np.array([pair[3] for pair in model.pairs])

    def least(q_rad: Both) -> float:
        pieces = np.array(model.posture(q_rad).segments)
        a, b = pieces[first], pieces[second]
        r, u, v = a[:, :3] - b[:, :3], a[:, 3:6], b[:, 3:6]
        uu, vv, uv = a[:, 6], b[:, 6], np.einsum("ij,ij->i", u, v)
        ur, vr = np.einsum("ij,ij->i", u, r), np.einsum("ij,ij->i", v, r)
        wide = np.maximum(uu * vv - uv * uv, 1e-15)
        s = np.clip((uv * vr - ur * vv) / wide, 0.0, 1.0)
        t = np.clip((uv * s + vr) / vv, 0.0, 1.0)
        s = np.clip((uv * t - ur) / uu, 0.0, 1.0)
        return float((np.linalg.norm(r + s[:, None] * u - t[:, None] * v, axis=1) - radii).min())

    return least


def _median_us(call: Callable[[Both], object], postures: list[Both]) -> float:
    taken = []
    for q_rad in postures:
        begun = time.perf_counter_ns()
        call(q_rad)
        taken.append((time.perf_counter_ns() - begun) / 1e3)
    return statistics.median(taken)
