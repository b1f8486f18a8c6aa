"""The clock of a straight motion: inside the limits of poses and of joints everywhere, slowed down where joints need it."""

from __future__ import annotations

import random

import pytest

from gateway.core.motion.lines import line_clock as module
from gateway.core.motion.lines.line import line_to
from gateway.core.motion.lines.line_clock import SLOWEST, LineClock, Reins, clock_for
from gateway.core.motion.lines.line_curve import Coarse, parts_for, solve
from gateway.core.motion.lines.line_elbow import chosen
from gateway.core.motion.poses.pose_path import plan_pose_paths
from gateway.core.motion.solver import NoPlan
from gateway.core.motion.space import Start
from gateway.errors import Code, Refusal
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side
from tests.changed import replace
from tests.core.lines import HOME, LIMITS, POSES, beside, finished, random_way
from tests.core.pose_judge import posed
from tests.kinematics.bodies import ARMS
from tests.thoroughness import either

L, R = Side.LEFT, Side.RIGHT
WILD = replace(LIMITS[L], v_radps=100.0, a_radps2=1e4, j_radps3=1e6)
"""Joints that limit nothing."""


def drawn(target, q_rad=HOME_Q_RAD[L], side=L, finer=1, parts=()):
    """A line and the joints along it."""
    line = line_to(ARMS[side].forward(q_rad), target)
    elbow, _ = finished(chosen(ARMS[side], line, q_rad, LIMITS[side]))
    work = solve(side, ARMS[side], line, elbow, q_rad, parts or parts_for([line], finer), LIMITS[side])
    return line, finished(work)[0]


def clock(target, joints=LIMITS[L], speed=1.0, q_rad=HOME_Q_RAD[L]):
    """The clock of the left arm alone, and its curve."""
    line, curve = drawn(target, q_rad)
    found, _ = finished(clock_for({L: line}, {L: curve}, {L: Reins(POSES[L], joints)}, speed))
    return found, curve


def derivatives(found, curve, time_s):
    """Velocity, acceleration and jerk of the joints at an instant, the jerk by differences."""
    step = 1e-5

    def state(t_s):
        part, rate, force = found.at(t_s)
        _, slopes, bends = curve.at(part)
        pairs = list(zip(slopes, bends, strict=True))
        return [a * rate for a, _ in pairs], [b * rate * rate + a * force for a, b in pairs]

    v, a = state(time_s)
    after = state(time_s + step)[1]
    return v, a, [(y - x) / step for x, y in zip(a, after, strict=True)]


@pytest.mark.parametrize("speed", [1.0, 0.3])
def test_joints_that_limit_nothing_leave_the_time_of_a_pose_motion(speed):
    """The same duration as an arm in end-effector mode needs for the same way, and no slowness."""
    target = ARMS[L].forward([q + 0.2 for q in HOME_Q_RAD[L][:6]] + [0.3])
    found, _ = clock(target, WILD, speed)
    start = Start(posed(HOME[L].p_m, HOME[L].quat_xyzw), POSES[L])
    path = plan_pose_paths({L: start}, {L: target.values}, speed)[L]
    assert found.duration_s == pytest.approx(path.duration_s, rel=1e-6)
    assert (found.stretch, found.slowness) == (1.0, pytest.approx(1.0))


def test_no_limit_of_a_joint_is_exceeded_at_any_instant():
    """Velocity, acceleration and jerk of every joint, not only at setpoints; random lines, slow or not."""
    rng, found, slowed = random.Random(8), 0, 0
    for _ in range(either(25, 200)):
        q_rad, target = random_way(rng, L)
        line, curve = drawn(target, q_rad, finer=2)
        if isinstance(curve, (Refusal, Coarse)):
            continue
        judged, _ = finished(clock_for({L: line}, {L: curve}, {L: Reins(POSES[L], LIMITS[L])}, 1.0))
        if isinstance(judged, Refusal):
            continue
        found, slowed = found + 1, slowed + (judged.stretch > 1.0)
        for _ in range(60):
            v, a, j = derivatives(judged, curve, rng.uniform(0.0, judged.duration_s - 1e-4))
            assert max(map(abs, v)) <= LIMITS[L].v_radps * (1 + 1e-9)
            assert max(map(abs, a)) <= LIMITS[L].a_radps2 * (1 + 1e-6)
            assert max(map(abs, j)) <= LIMITS[L].j_radps3 * (1 + 1e-3)
    assert found > 10
    assert slowed > 3


def test_two_arms_share_the_clock_of_the_slower_one():
    """The arm with the longer way sets the time; the other one goes along."""
    lines, curves = {}, {}
    for side, by in ((L, 0.02), (R, 0.12)):
        lines[side] = line_to(HOME[side], beside(side, (0.0, 0.0, by)))
    parts = parts_for(list(lines.values()))
    for side in (L, R):
        target = lines[side].at(1.0).pose
        curves[side] = drawn(target, HOME_Q_RAD[side], side, parts=parts)[1]
    reins = {side: Reins(POSES[side], LIMITS[side]) for side in (L, R)}
    both, _ = finished(clock_for(lines, curves, reins, 1.0))
    alone, _ = finished(clock_for({R: lines[R]}, {R: curves[R]}, {R: reins[R]}, 1.0))
    assert both.duration_s == pytest.approx(alone.duration_s)


def test_no_way_takes_no_time():
    """The end effector is there already: nothing to plan, nothing to wait for."""
    found, _ = clock(HOME[L])
    assert (found.law, found.duration_s, found.at(0.0)) == (None, 0.0, (1.0, 0.0, 0.0))


def test_a_line_for_which_joints_are_too_slow_is_refused_with_the_worst_place():
    """Joint, its velocity, the limit, the unit; and how many times slower it would be."""
    refusal, _ = clock(beside(L, (0.0, 0.0, 0.15)), replace(LIMITS[L], v_radps=0.01, a_radps2=1e4, j_radps3=1e6))
    assert isinstance(refusal, Refusal)
    assert (refusal.code, refusal.unit, refusal.bound) == (Code.NO_STRAIGHT_WAY, "rad/s", "0.01")
    assert refusal.field.startswith("left_arm[")
    assert f"{SLOWEST:g} times is the bound" in refusal.message


@pytest.mark.parametrize(
    ("limits", "unit"), [({"a_radps2": 1e-3}, "rad/s²"), ({"j_radps3": 1e-3, "a_radps2": 1e4}, "rad/s³")]
)
def test_acceleration_and_jerk_slow_it_down_as_well(limits, unit):
    """Whichever of them asks for most is told."""
    refusal, _ = clock(beside(L, (0.0, 0.0, 0.15)), replace(LIMITS[L], v_radps=100.0, **limits))
    assert isinstance(refusal, Refusal)
    assert refusal.unit in {"rad/s", unit}
    assert "slowed down to fit" in refusal.message


def test_a_slower_clock_is_the_same_motion():
    """At the same part after so much more time, with rates that fit."""
    found, _ = clock(beside(L, (0.0, 0.0, 0.1)))
    slow = found.slower(2.0)
    assert slow.duration_s == pytest.approx(2.0 * found.duration_s)
    part, rate, force = found.at(0.4)
    assert slow.at(0.8) == pytest.approx((part, rate / 2.0, force / 4.0))
    assert slow.slowness == pytest.approx(2.0 * found.slowness)


def test_what_ruckig_cannot_plan_is_a_refusal(monkeypatch):
    """Never an exception in the tick."""

    def none(*_):
        raise NoPlan("it is tired")

    monkeypatch.setattr(module, "solve", none)
    refusal, _ = clock(beside(L, (0.0, 0.0, 0.1)))
    assert (refusal.code, "it is tired" in refusal.message) == (Code.PLAN_FAILED, True)


def test_an_arm_that_only_holds_has_no_part_in_the_pace():
    """One arm goes, the other one is there already: its joints ask for nothing."""
    going, curve = drawn(beside(L, (0.0, 0.0, 0.1)))
    parts = curve.times_s
    stays, held = drawn(HOME[R], HOME_Q_RAD[R], R, parts=parts)
    still = replace(held, peaks=tuple((*p[:2], 0.0, *p[3:]) for p in held.peaks))
    reins = {side: Reins(POSES[side], LIMITS[side]) for side in (L, R)}
    both, _ = finished(clock_for({L: going, R: stays}, {L: curve, R: still}, reins, 1.0))
    alone, _ = finished(clock_for({L: going}, {L: curve}, {L: reins[L]}, 1.0))
    assert both.duration_s == pytest.approx(alone.duration_s, rel=1e-6)


def test_the_end_of_the_way_has_a_time_whatever_rounding_does():
    """A law that ends a hair before the end: its own end."""
    law = clock(beside(L, (0.0, 0.0, 0.1)))[0].law
    assert module._time_s(law, 1.01) == law.duration
    assert LineClock(law=law).duration_s == law.duration
