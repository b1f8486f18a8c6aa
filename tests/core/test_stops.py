"""How joints go when they take a step and then all brake: against the brakes that the references really use."""

from __future__ import annotations

import random

import pytest

from gateway.core.braking import JointLimits
from gateway.core.motion import JointReference
from gateway.core.stops import Stops
from gateway.kinematics.stopping import STAYS
from gateway.robot import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
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
    here = {L: arm.q_rad, R: HOME_Q_RAD[R]}
    return Stops(here, {L: arm.ahead()}, {L: [STAYS] * 7, R: other}, arm.limits, DT)


@pytest.mark.parametrize("seed", range(12))
def test_the_course_is_that_of_the_brakes(seed):
    """Setpoint by setpoint of a reference that takes the step and is then told to brake."""
    rng = random.Random(seed)
    arm = moving(L, rng, rng.randint(1, 60))
    course = stops(arm, [STAYS] * 7)
    assert course.at(0.0) == {L: arm.q_rad, R: HOME_Q_RAD[R]}
    assert course.at(0.3 * DT)[L] == pytest.approx(arm.ahead()[0], abs=1e-12)  # of a time within the step: its end
    arm.step()
    arm.brake()
    time_s = DT
    while not arm.is_at_rest:
        assert course.at(time_s)[L] == pytest.approx(arm.q_rad, abs=1e-9)
        arm.step()
        time_s += DT
    assert course.duration_s <= time_s + 1e-9 and course.at(time_s)[L] == pytest.approx(arm.q_rad, abs=1e-9)
    assert course.at(time_s)[R] == HOME_Q_RAD[R]


@pytest.mark.parametrize("seed", range(12))
def test_the_ways_hold_the_course_between_any_two_times(seed):
    """Also where a joint turns round on the way; the other arm may be anywhere on its own."""
    rng, turned = random.Random(seed), 0
    drift = [(-0.01 * n, 0.02 * n) for n in range(7)]
    for _ in range(20):
        course = stops(moving(L, rng, rng.randint(1, 60)), drift)
        begin, end = sorted(rng.choice([0.0, 0.5 * DT, rng.uniform(DT, course.duration_s)]) for _ in range(2))
        ways, at = course.ways(begin, end), course.at(begin)[L]
        assert ways[R] == drift
        times = [DT + (max(end, DT) - DT) * n / 50 for n in range(51)] if begin <= DT else []
        times += [begin + (end - begin) * n / 50 for n in range(51)] if begin > 0.0 else []
        for time_s in times:
            there = course.at(max(time_s, DT))[L]
            for q, to, (low, high) in zip(at, there, ways[L], strict=True):
                assert low - 1e-9 <= to - q <= high + 1e-9
        turned += any(low < 0.0 < high for low, high in ways[L])
    assert turned or seed


def test_arms_that_nobody_moves_take_no_time_but_the_step():
    """Both only drift."""
    here = {side: HOME_Q_RAD[side] for side in Side}
    still = {side: [STAYS] * 7 for side in Side}
    course = Stops(here, {}, still, moving(L, random.Random(1), 0).limits, DT)
    assert course.duration_s == DT and course.at(1.0) == here and course.ways(0.0, 1.0) == still
