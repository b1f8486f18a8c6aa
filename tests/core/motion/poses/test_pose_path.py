"""Paths of end effectors: exactly straight, position and orientation on one clock, all arms ending together."""

from __future__ import annotations

import math
import random

import pytest

from gateway.core.motion.poses import pose_path as module
from gateway.core.motion.poses.pose_path import plan_pose_paths
from gateway.core.motion.poses.pose_state import PoseDynamics
from gateway.core.motion.poses.quaternion import angle_rad
from gateway.core.motion.solver import NoPlan
from gateway.core.motion.space import PlanFailed, Start
from gateway.values import Side
from tests.core.pose_judge import DT, HARD, HOME, LIMITS, WEAK, about, any_pose, judge, posed

LEFT, RIGHT = Side.LEFT, Side.RIGHT
HERE = posed(HOME[:3], HOME[3:])


def begin(state=HERE, limits=LIMITS, period_s=DT):
    """Where one arm is."""
    return Start(state, PoseDynamics(limits, period_s))


def one(goal, state=HERE, speed=1.0, limits=LIMITS):
    """The path of the left arm alone."""
    return plan_pose_paths({LEFT: begin(state, limits)}, {LEFT: goal}, speed)[LEFT]


def setpoints(path, period_s=DT, more=3):
    """What a stream sends along a path, and after it."""
    return [path.at(n * period_s).values for n in range(math.ceil(path.duration_s / period_s) + more)]


@pytest.mark.parametrize("limits", [LIMITS, HARD, WEAK])
def test_a_path_from_rest_is_straight_within_the_limits_and_ends_at_the_goal(limits):
    """On the line between the positions and the arc between the orientations, the same part of both at each instant."""
    rng = random.Random(3)
    for _ in range(10):
        start, goal = posed(any_pose(rng)[:3], HOME[3:]), any_pose(rng)
        path = one(goal, start, limits=limits)
        sent = setpoints(path)
        judge([start.values] * 3 + sent, limits)
        assert path.at(path.duration_s).values[:3] == goal[:3]
        assert angle_rad(sent[-1][3:], goal[3:]) < 1e-9
        whole_m, whole_rad = math.dist(start.values[:3], goal[:3]), angle_rad(start.values[3:], goal[3:])
        for values in sent:
            moved, turned = (
                math.dist(start.values[:3], values[:3]) / whole_m,
                angle_rad(start.values[3:], values[3:]) / whole_rad,
            )
            assert moved == pytest.approx(turned, abs=1e-6)
            assert math.dist(start.values[:3], values[:3]) + math.dist(values[:3], goal[:3]) == pytest.approx(
                whole_m, abs=1e-12
            )


def test_a_long_path_uses_the_whole_speed():
    """0.5 m at 0.25 m/s with both ramps: the cruise is at the limit."""
    path = one((-0.20, 0.10, -0.20, *HOME[3:]))
    assert max(math.hypot(*path.at(n * DT).v[:3]) for n in range(200)) == pytest.approx(0.25, rel=2e-3)
    assert 2.0 < path.duration_s < 2.7
    assert path.duration_ns == round(path.duration_s * 1e9)


def test_a_turn_alone_and_a_way_alone_are_paths_too():
    """The other of the two stays exactly where it is."""
    turned = one((*HOME[:3], *about((1.0, 1.0, 0.0), 0.7)))
    assert all(values[:3] == HOME[:3] for values in setpoints(turned))
    moved = one((0.1, 0.1, -0.2, *HOME[3:]))
    assert all(values[3:] == HOME[3:] for values in setpoints(moved))


def test_no_way_takes_no_time():
    """The goal is where it rests: nothing is planned."""
    path = one(HOME)
    assert path.duration_s == 0.0
    assert path.at(0.0).values == HOME


def test_half_a_turn_takes_one_of_the_two_ways():
    """Never both, never through nothing."""
    path = one((*HOME[:3], 0.0, 0.0, 1.0, 0.0))
    judge(setpoints(path), LIMITS)
    assert angle_rad(path.end.values[3:], (0.0, 0.0, 1.0, 0.0)) < 1e-9


def test_two_arms_end_together():
    """The one with the shorter way takes as long, and both keep their limits."""
    starts = {LEFT: begin(), RIGHT: begin(posed((0.1, -0.3, 0.0), HOME[3:]))}
    goals = {LEFT: (0.0, 0.1, -0.2, *HOME[3:]), RIGHT: (0.1, -0.25, 0.0, *about((1.0, 0.0, 0.0), 2.0))}
    paths = plan_pose_paths(starts, goals, 1.0)
    assert paths[LEFT].duration_s == paths[RIGHT].duration_s
    for path in paths.values():
        judge(setpoints(path), LIMITS)


def test_a_path_from_motion_stops_first():
    """The lead is the stop of the moving arm; an arm at rest waits for it; then both go straight."""
    state = posed(HOME[:3], HOME[3:], (0.1, 0.1, -0.05, 0.2, -0.3, 0.1), (0.3, -0.2, 0.1, 0.5, 0.1, -1.0))
    starts = {LEFT: begin(state), RIGHT: begin(posed((0.1, -0.3, 0.0), HOME[3:]))}
    goals = {LEFT: (0.2, 0.0, 0.1, *about((1.0, 0.0, 0.0), 0.5)), RIGHT: (0.1, -0.1, 0.0, *HOME[3:])}
    paths = plan_pose_paths(starts, goals, 1.0)
    left, right = setpoints(paths[LEFT]), setpoints(paths[RIGHT])
    judge(left, LIMITS)
    judge(right, LIMITS)
    waited = round(paths[LEFT].lead_s / DT)
    assert waited == len(paths[LEFT].lead.states) > 5
    assert right[:waited] == [right[0]] * waited
    assert paths[LEFT].at(0.0) == paths[LEFT].start == state
    assert paths[LEFT].at(paths[LEFT].lead_s - DT) == paths[LEFT].lead.states[-2]
    assert left[-1][:3] == goals[LEFT][:3]


def test_a_stop_without_a_way_after_it_is_a_path():
    """The goal is where the arm comes to rest."""
    state = posed(HOME[:3], HOME[3:], (0.1, 0.0, 0.0, 0.0, 0.0, 0.0))
    rest = PoseDynamics(LIMITS, DT).halt(state).end
    path = one(rest.values, state)
    assert path.duration_s == pytest.approx(path.lead_s)
    judge(setpoints(path), LIMITS)
    assert path.at(DT) == path.lead.states[0]
    assert path.at(path.duration_s).values == rest.values


def test_a_speed_factor_scales_velocity_and_from_rest_the_acceleration():
    """A fifth of the speed: five times as long or more, softer from the start."""
    goal = (0.0, 0.1, -0.2, *HOME[3:])
    fast, slow = one(goal), one(goal, speed=0.2)
    assert slow.duration_s > 3.5 * fast.duration_s
    assert max(math.hypot(*slow.at(n * DT).a[:3]) for n in range(400)) <= 0.2 * LIMITS.a_mps2


def test_a_goal_that_is_none_is_refused():
    """With the arm that it is for."""
    with pytest.raises(PlanFailed) as caught:
        one((0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert caught.value.joint == "left arm reach"


def test_goals_must_fit_the_arms_and_the_speed_must_be_a_factor():
    """Nothing is planned for an arm that is not there, nor faster than the limits."""
    for starts, goals, speed in (
        ({}, {}, 1.0),
        ({LEFT: begin()}, {RIGHT: HOME}, 1.0),
        ({LEFT: begin()}, {LEFT: HOME}, 1.5),
    ):
        with pytest.raises(PlanFailed):
            plan_pose_paths(starts, goals, speed)


def test_a_plan_that_is_not_found_is_told(monkeypatch):
    """With ruckig's own words."""

    def none(*_):
        raise NoPlan("no plan today")

    monkeypatch.setattr(module, "solve", none)
    with pytest.raises(PlanFailed, match="no plan today"):
        one((0.0, 0.1, -0.2, *HOME[3:]))
