"""A straight motion as a whole: for one arm and for both, judged before it begins, refused with the place that cannot be."""

from __future__ import annotations

import math
import random

import pytest

from gateway.core.motion.joints.braking import Braking
from gateway.core.motion.lines import line_plan as module
from gateway.core.motion.lines.line import line_to
from gateway.core.motion.lines.line_curve import Coarse
from gateway.core.motion.lines.line_path import Unstoppable
from gateway.core.motion.lines.line_plan import Body, plan_lines
from gateway.errors import Code, Refusal
from gateway.kinematics.arm import ArmModel
from gateway.kinematics.correction import ArmCorrection, corrected
from gateway.kinematics.description import nominal
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side
from tests.changed import replace
from tests.core.lines import DT_S, FREE, LIMITS, beside, finished, going, off_line, planned, random_way, setpoints, used
from tests.kinematics.bodies import ARMS, difference, nudged
from tests.kinematics.guarded_arms import model
from tests.thoroughness import either

L, R = Side.LEFT, Side.RIGHT


def test_both_arms_go_straight_and_end_together():
    """One clock: at each instant both are at the same part of their ways."""
    targets = {L: beside(L, (0.05, 0.0, 0.1)), R: beside(R, (0.0, -0.03, -0.05))}
    paths, _ = finished(plan_lines({side: going(side, target) for side, target in targets.items()}, FREE, 1.0))
    assert isinstance(paths, dict)
    assert paths[L].duration_s == paths[R].duration_s
    for side, path in paths.items():
        line = line_to(ARMS[side].forward(HOME_Q_RAD[side]), targets[side])
        assert max(used(setpoints(path), LIMITS[side])) <= 1.0 + 1e-6
        for n in range(1, math.floor(path.duration_s / DT_S)):
            assert off_line(side, path.at(n * DT_S)[0], line.at(path.clock.at(n * DT_S)[0])) < 1e-4


def test_less_speed_takes_more_time():
    """Half the velocities and accelerations of poses: not less than 1.2 times as long."""
    target = beside(L, (0.05, 0.0, 0.1))
    assert planned(target, speed=0.5).duration_s > 1.2 * planned(target).duration_s


def test_more_places_are_taken_where_the_joints_turn_more():
    """A line that twelve steps are too few for is followed all the same."""
    rng, finer = random.Random(4), 0
    for _ in range(either(40, 200)):
        q_rad, target = random_way(rng, L)
        path = planned(target, q_rad)
        if isinstance(path, Refusal):
            continue
        line = line_to(ARMS[L].forward(q_rad), target)
        finer += len(path.curve.times_s) > len(module.parts_for([line]))
    assert finer > 0


def test_joints_that_turn_too_sharply_are_refused(monkeypatch):
    """No number of places was enough: the place is named, and what else to do."""
    asked = []

    def coarse(side, arm, line, elbow, q_rad, parts, limits):
        asked.append(len(parts))
        yield
        return Coarse(0.5)

    monkeypatch.setattr(module, "solve", coarse)
    refusal = planned(beside(L, (0.05, 0.0, 0.1)))
    assert (refusal.code, refusal.field, refusal.unit) == (Code.NO_STRAIGHT_WAY, "left_arm", "of the way")
    assert "at 50% of the way" in refusal.message
    assert asked == [15, 27, 51]


def test_a_refusal_of_the_curve_or_of_the_clock_is_that_of_the_plan():
    """Outside the limits; and too fast for weak joints."""
    assert planned(beside(L, (0.4, 0.3, 0.5))).code is Code.NO_STRAIGHT_WAY
    one = going(L, beside(L, (0.0, 0.0, 0.15)))
    weak = Braking(replace(LIMITS[L], v_radps=0.003), DT_S)
    refusal, _ = finished(plan_lines({L: replace(one, start=replace(one.start, space=weak))}, FREE, 1.0))
    assert refusal.code is Code.NO_STRAIGHT_WAY


def test_what_has_to_stay_free_is_looked_at_with_the_other_arm_where_it_is():
    """The same line of the left hand: free beside a right arm at home, refused where that one is in the way."""
    to_the_right = beside(L, (0.0, -0.12, 0.0))
    apart = Body(model=model(), margin_m=0.02, q_rad=HOME_Q_RAD)
    assert not isinstance(planned(to_the_right, body=apart), Refusal)
    far = Body(model=model(), margin_m=0.6, q_rad=HOME_Q_RAD)
    nearest = model().posture(HOME_Q_RAD).nearest()
    refusal = planned(to_the_right, body=far)
    assert isinstance(refusal, Refusal) == (
        model().posture({**HOME_Q_RAD, L: planned(to_the_right).end_rad}).nearest().gap_m < nearest.gap_m - 1e-6
    )
    in_the_way = ARMS[R].solution(
        replace(beside(R, (0.0, 0.0, 0.0)), p_m=(beside(R, (0, 0, 0)).p_m[0], 0.06, beside(R, (0, 0, 0)).p_m[2])),
        HOME_Q_RAD[R],
    )
    assert in_the_way is not None
    beside_it = Body(model=model(), margin_m=0.02, q_rad={**HOME_Q_RAD, R: in_the_way.q_rad})
    blocked = planned(beside(L, (0.0, -0.2, 0.0)), body=beside_it)
    assert isinstance(blocked, Refusal)
    assert (blocked.code, blocked.unit) == (Code.COLLISION_AHEAD, "m")
    assert "of the way" in blocked.message


def test_a_motion_that_an_arm_could_not_stop_becomes_slower(monkeypatch):
    """Until it can; all arms with it."""
    looked = []

    def twice(path, braking):
        looked.append(path.duration_s)
        yield
        return None if len(looked) > 2 else Unstoppable(joint=3, part=0.4, q_rad=0.26, dq_radps=-0.4)

    target = beside(L, (0.05, 0.0, 0.1))
    usual = planned(target).duration_s
    monkeypatch.setattr(module, "unstoppable", twice)
    assert planned(target).duration_s == pytest.approx(1.3**2 * usual)


def test_one_that_can_never_be_stopped_is_refused(monkeypatch):
    """Joint, where it is, its limits and the place."""

    def never(path, braking):
        yield
        return Unstoppable(joint=3, part=0.4, q_rad=0.26, dq_radps=-0.4)

    monkeypatch.setattr(module, "unstoppable", never)
    refusal = planned(beside(L, (0.05, 0.0, 0.1)))
    assert (refusal.code, refusal.field, refusal.value, refusal.unit) == (
        Code.NO_STRAIGHT_WAY,
        "left_arm[3]",
        "0.26",
        "rad",
    )
    assert "at 40% of the way" in refusal.message


def test_no_way_is_a_path_without_duration():
    """The end effector is there already."""
    path = planned(beside(L, (0.0, 0.0, 0.0)))
    assert path.duration_s == 0.0
    assert path.at(0.0)[0] == pytest.approx(HOME_Q_RAD[L], abs=1e-9)


def test_a_plan_is_cut_into_small_pieces():
    """None of them does more than some places, middles or setpoints at once."""
    _, pieces = finished(plan_lines({L: going(L, beside(L, (0.1, 0.02, 0.12)))}, FREE, 1.0))
    assert 20 < pieces < 400


def test_an_arm_without_even_nearly_a_closed_form_is_refused_before_any_work():
    """Numbers of a user's own, whose axes miss each other by far: what is off is told."""
    arm = ArmModel(nudged(L, 5, xyz_m=(0.1, 0.05, 0.0), rpy_rad=(0.5, 0.0, 0.0)), L)
    one = replace(going(L, beside(L, (0.05, 0.0, 0.0))), arm=arm)
    refusal, pieces = finished(plan_lines({L: one}, FREE, 1.0))
    assert (refusal.code, pieces) == (Code.NO_STRAIGHT_WAY, 1)
    assert "closed form" in refusal.message


def test_a_calibrated_arm_goes_straight_by_its_own_numbers():
    """Joint zeros that are off, as `ta2 identify` finds them: the line is that of the corrected arm, within 0.1 mm."""
    offsets = ArmCorrection(offsets_rad=(0.01, -0.02, 0.015, 0.003, -0.01, 0.02, 0.004))
    arm = ArmModel(corrected(nominal(), L, offsets), L)
    assert arm.shape.is_exact
    begin = arm.forward(HOME_Q_RAD[L])
    target = replace(begin, p_m=tuple(p + d for p, d in zip(begin.p_m, (0.05, 0.02, 0.06), strict=True)))
    paths, _ = finished(plan_lines({L: replace(going(L, target), arm=arm)}, FREE, 1.0))
    assert isinstance(paths, dict)
    line = line_to(begin, target)
    assert max(used(setpoints(paths[L]), LIMITS[L])) <= 1.0 + 1e-6
    for n in range(1, math.floor(paths[L].duration_s / DT_S)):
        is_at = arm.chain.forward(paths[L].at(n * DT_S)[0])
        assert max(difference(is_at, line.at(paths[L].clock.at(n * DT_S)[0]))) < 1e-4
