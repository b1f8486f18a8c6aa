"""The rule by which parts of the body may come together: they stop with 2 cm left, and can always part again."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import pytest

from gateway.kinematics.separation.approach import Approach
from gateway.kinematics.separation.judgement import Motion
from gateway.kinematics.separation.stopping import STAYS
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import Side
from tests.kinematics.guarded_arms import (
    DT_S,
    LIMITS,
    MARGIN_M,
    MEET,
    ROUNDING_M,
    GuardedArms,
    free_posture,
    model,
    random_joints,
)
from tests.thoroughness import either


def test_the_target_of_these_tests_would_be_a_collision():
    """Without the rule both arms run into each other: what the other tests show is not that nothing was near."""
    arms = GuardedArms(HOME_Q_RAD, *LIMITS[0], is_guarded=False)
    arms.stream(MEET, 6.0)
    assert arms.least_m < -0.05


@pytest.mark.parametrize("limits", LIMITS)
def test_arms_that_stream_towards_each_other_stop_with_two_centimetres_left_and_part_again(limits):
    """Whatever the limits: 2 cm are kept all the way, the arms come near it, stand, and go home again."""
    arms = GuardedArms(HOME_Q_RAD, *limits)
    arms.stream(MEET, 20.0 if limits[0] < 0.3 else 8.0)
    assert arms.least_m >= MARGIN_M - ROUNDING_M
    assert arms.gap.gap_m < MARGIN_M + 0.01
    assert {arms.gap.first.partition("_")[0], arms.gap.second.partition("_")[0]} == {"left", "right"}
    assert arms.off_rad(MEET) > 0.05
    arms.stream(HOME_Q_RAD, 25.0 if limits[0] < 0.3 else 10.0)
    assert arms.off_rad(HOME_Q_RAD) < 1e-9
    assert arms.least_m >= MARGIN_M - ROUNDING_M


@pytest.mark.thorough
def test_any_postures_streamed_at_any_limits_keep_the_margin_and_what_is_near_can_part():
    """Random postures inside the joints' limits, targets in collision or not, limits anywhere in the config's range."""
    rng = random.Random(7)
    refused = parted = 0
    for number in range(either(14, 32)):
        start, target = free_posture(rng), random_joints(rng)
        limits = (math.exp(rng.uniform(-1.0, math.log(3.0))), rng.uniform(1.0, 15.0), rng.uniform(5.0, 300.0))
        arms = GuardedArms(start, *limits)
        arms.stream(target, 4.0)
        refused += arms.refused > 0
        assert arms.least_m >= MARGIN_M - ROUNDING_M, (number, limits, arms.gap)
        if arms.gap.gap_m < MARGIN_M + 0.01 and len(model().posture(arms.q_rad).within(MARGIN_M + 0.02)) == 1:
            goal, before_m = _apart(arms.q_rad, arms.gap), arms.gap.gap_m
            parted += 1
            arms.stream(goal, 6.0)
            assert arms.off_rad(goal) < 1e-9 and arms.gap.gap_m > before_m, (number, limits, arms.gap)
        arms.stream(random_joints(rng), 0.5)
        arms.stream(start, 4.0)
        assert arms.least_m >= MARGIN_M - ROUNDING_M, (number, limits, arms.gap)
    assert refused and parted


def _apart(q_rad, near):
    """Return joint angles that are further along the gap's slopes, inside the limits."""
    return {
        side: [
            min(max(q + 0.3 * slope, low), high)
            for q, slope, low, high in zip(
                q_rad[side], near.slopes[side], JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side], strict=True
            )
        ]
        for side in Side
    }


def test_setpoints_stay_within_velocity_acceleration_and_jerk_whatever_the_rule_does():
    """Braking and going on joint by joint, tick by tick, is never harder than the limits (DESIGN §8, 1)."""
    arms = GuardedArms(HOME_Q_RAD, *LIMITS[0])
    arms.stream(MEET, 5.0)
    arms.stream(HOME_Q_RAD, 4.0)
    assert arms.refused
    for side in Side:
        for k in range(7):
            row = [state[side][0][k] for state in arms.states]
            for order, limit in enumerate(LIMITS[0], start=1):
                row = [(b - a) / DT_S for a, b in pairwise(row)]
                assert max(map(abs, row)) <= limit * (1.0 + 1e-5), (side, k, order)


def test_the_kept_gap_holds_for_every_order_in_which_joints_may_go():
    """Random ways of random joints, both directions: no point of the box is nearer than what was said."""
    rng, rule, told = random.Random(3), Approach(model()), 0
    for _ in range(either(150, 1000)):
        q_rad = free_posture(rng, 0.0)
        size = rng.choice([0.01, 0.05, 0.2])
        ways = {
            side: [
                (-rng.uniform(0.0, size) * rng.random() ** 3, rng.uniform(0.0, size)) if rng.random() < 0.6 else STAYS
                for _ in range(7)
            ]
            for side in Side
        }
        kept_m = min(rule.look(q_rad, ways).kept_m(ways), MARGIN_M)
        told += kept_m < MARGIN_M
        for _ in range(15):
            there = {
                side: [
                    q + rng.choice((*way, rng.uniform(*way))) for q, way in zip(q_rad[side], ways[side], strict=True)
                ]
                for side in Side
            }
            assert model().posture(there).nearest().gap_m >= kept_m - 1e-9
    assert told


def test_parts_inside_the_margin_may_part_and_may_not_come_nearer():
    """However a robot came there: what opens goes on, what closes stands."""
    rng, rule, seen = random.Random(11), Approach(model()), 0
    still = {side: [STAYS] * 7 for side in Side}
    while seen < 20:
        q_rad = random_joints(rng)
        posture = model().posture(q_rad)
        near = posture.nearest()
        if not 0.002 < near.gap_m < 0.015 or len(posture.within(MARGIN_M)) > 1:
            continue
        seen += 1
        side, k = max(((s, k) for s in Side for k in range(7)), key=lambda at: abs(near.slopes[at[0]][at[1]]))
        for sign in (1.0, -1.0):
            goes = math.copysign(1e-4, sign * near.slopes[side][k])
            ways = {s: list(row) for s, row in still.items()}
            ways[side][k] = (min(goes, 0.0), max(goes, 0.0))
            motion = Motion(wanted=ways, braked=lambda: still, speed_radps={s: (0.1,) * 7 for s in Side})
            verdict = rule.look(q_rad, ways).judge(motion)
            assert verdict.going[side][k] == (sign > 0.0)
            assert sum(not goes for row in verdict.going.values() for goes in row) == (sign < 0.0)


def test_far_from_everything_nothing_is_limited():
    """At home, slow motions of all joints: free, without a velocity limit."""
    ways = {side: [(-0.001, 0.001)] * 7 for side in Side}
    motion = Motion(wanted=ways, braked=lambda: ways, speed_radps={side: (0.05,) * 7 for side in Side})
    look = Approach(model()).look(HOME_Q_RAD, ways)
    verdict = look.judge(motion)
    assert look.is_free and verdict.is_free and verdict.pair == -1 and verdict.kept_m == math.inf
    assert all(limit == math.inf for limit in verdict.limit_radps.values())


def test_all_joints_brake_where_even_the_brakes_would_come_inside_the_margin():
    """A way that is told late, too far for its own brakes: nobody goes on beside it."""
    rng, rule = random.Random(13), Approach(model())
    q_rad = free_posture(rng)
    posture = model().posture(q_rad)
    near = posture.nearest()
    side, k = max(((s, k) for s in Side for k in range(7)), key=lambda at: abs(near.slopes[at[0]][at[1]]))
    ways = {s: [STAYS] * 7 for s in Side}
    ways[side][k] = (-0.5, 0.5)
    motion = Motion(wanted=ways, braked=lambda: ways, speed_radps={s: (1.0,) * 7 for s in Side})
    verdict = rule.look(q_rad, ways).judge(motion)
    assert not any(goes for row in verdict.going.values() for goes in row)
    assert verdict.kept_m < MARGIN_M and posture.told(verdict.pair).gap_m >= near.gap_m
