"""How joints go when they take a step and then all brake: against the brakes that the references really use."""

from __future__ import annotations

import random
from itertools import pairwise

import pytest

from gateway.core.motion.joints.braking import JointLimits
from gateway.core.motion.joints.stops import MOST_SETPOINTS, Stops
from gateway.core.motion.motion import JointReference
from gateway.kinematics.separation.stopping import STAYS
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import Side

L, R = Side.LEFT, Side.RIGHT
DT = 0.01


def moving(side, rng, steps):
    """Return an arm on its way somewhere, after some setpoints."""
    limits = JointLimits(
        v_radps=rng.choice([0.5, 1.0, 3.0]),
        a_radps2=rng.choice([3.0, 15.0]),
        j_radps3=rng.choice([20.0, 300.0]),
        lower_rad=JOINT_LOWER_RAD[side],
        upper_rad=JOINT_UPPER_RAD[side],
    )
    arm = JointReference(limits, DT)
    arm.seed(HOME_Q_RAD[side])
    for step in range(steps):
        if step % 17 == 0:
            arm.follow([rng.uniform(a, b) for a, b in zip(limits.lower_rad, limits.upper_rad, strict=True)])
        arm.step()
    return arm


def stops(arm, other):
    """Return the course of an arm that takes its next setpoint and brakes, beside one that drifts."""
    here = {L: arm.values, R: HOME_Q_RAD[R]}
    return Stops(here, {L: arm.ahead()}, {L: [STAYS] * 7, R: other}, arm.space.limits, DT)


@pytest.mark.parametrize("seed", range(12))
def test_the_course_is_that_of_the_brakes(seed):
    """Setpoint by setpoint of a reference that takes the step and is then told to brake."""
    rng = random.Random(seed)
    arm = moving(L, rng, rng.randint(1, 60))
    course = stops(arm, [STAYS] * 7)
    times_s = [DT * (1 + n) for n in range(int(course.duration_s / DT + 0.5))]
    begins, ways = course.pieces([min(time_s / course.duration_s, 1.0) for time_s in times_s])
    assert len(begins) == len(ways) == len(times_s) + 1 and begins[0] == {L: arm.values, R: HOME_Q_RAD[R]}
    arm.step()
    arm.brake()
    for begin in begins[1:]:
        assert begin[L] == pytest.approx(arm.values, abs=1e-9) and begin[R] == HOME_Q_RAD[R]
        arm.step()
    arm.step()
    assert arm.is_at_rest


@pytest.mark.parametrize("seed", range(12))
def test_the_ways_hold_the_course_in_each_piece(seed):
    """Also where a joint turns round on the way; the other arm may be anywhere on its own."""
    rng, turned = random.Random(seed), 0
    drift = [(-0.01 * n, 0.02 * n) for n in range(7)]
    for _ in range(20):
        course = stops(moving(L, rng, rng.randint(1, 60)), drift)
        parts = sorted(rng.random() for _ in range(3))
        fine = sorted({*parts, *(n / 200 for n in range(201))})
        begins, ways = course.pieces(parts)
        places, _ = course.pieces(fine)
        assert all(way[R] == drift for way in ways)
        for number, (low_part, high_part) in enumerate(pairwise((0.0, *parts, 1.0))):
            for part, place in zip(fine, places[1:], strict=True):
                if low_part <= part <= high_part:
                    for q, to, (low, high) in zip(begins[number][L], place[L], ways[number][L], strict=True):
                        assert low - 1e-9 <= to - q <= high + 1e-9
        turned += any(low < 0.0 < high for way in ways for low, high in way[L])
    assert turned or seed


@pytest.mark.parametrize("seed", range(12))
def test_a_short_course_is_told_setpoint_by_setpoint(seed):
    """Those of the brakes, until all joints stand; a longer one is not, nor one beside an arm that drifts."""
    rng, setpoints = random.Random(seed), None
    while setpoints is None:
        arm = moving(L, rng, rng.randint(0, 4))
        setpoints = stops(arm, [STAYS] * 7).setpoints()
    assert len(setpoints) <= MOST_SETPOINTS
    arm.step()
    arm.brake()
    for place in setpoints:
        assert place[L] == pytest.approx(arm.values, abs=1e-9) and place[R] == HOME_Q_RAD[R]
        arm.step()
    assert arm.is_at_rest
    assert stops(moving(L, rng, 0), [(0.0, 1e-4)] * 7).setpoints() is None
    course = stops(arm, [STAYS] * 7)
    while course.duration_s < DT * (MOST_SETPOINTS + 1):
        course = stops(moving(L, rng, 40), [STAYS] * 7)
    assert course.setpoints() is None


def test_arms_that_nobody_moves_take_no_time_but_the_step():
    """Both only drift."""
    here = {side: HOME_Q_RAD[side] for side in Side}
    still = {side: [STAYS] * 7 for side in Side}
    course = Stops(here, {}, still, moving(L, random.Random(1), 0).space.limits, DT)
    assert course.duration_s == DT and course.pieces([0.5]) == ([here, here], [still, still])
