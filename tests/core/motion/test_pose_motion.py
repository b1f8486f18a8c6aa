"""One end effector's reference: one continuous motion within every limit, whatever is asked of it, in whatever order."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.core.motion.joints.passage import Outcome
from gateway.core.motion.joints.solver import NoPlan
from gateway.core.motion.motion import PlanFailed, ReferenceMode
from gateway.core.motion.pose_motion import PoseReference, plan_poses
from gateway.core.motion.poses import pose_follower
from gateway.core.motion.poses.pose_state import PoseState
from gateway.core.motion.poses.pose_trajectory import interpolate_poses
from gateway.core.motion.poses.quaternion import angle_rad
from gateway.values import Side
from tests.core.pose_judge import DT, HARD, HOME, LIMITS, WEAK, about, any_pose, even_pose, judge

LEFT, RIGHT = Side.LEFT, Side.RIGHT
HOLD, PATH, FOLLOW, BRAKE = ReferenceMode.HOLD, ReferenceMode.PATH, ReferenceMode.FOLLOW, ReferenceMode.BRAKE
GOAL = (0.10, -0.10, -0.20, *about((0.0, 1.0, 1.0), 1.0))


def reference(limits=LIMITS, period_s=DT, values=HOME) -> PoseReference:
    """An arm at home that has not moved yet."""
    made = PoseReference(limits, period_s)
    made.seed(values)
    return made


def go(arm, goal=GOAL, speed=1.0):
    """Begin a path of this arm alone."""
    path = plan_poses({LEFT: arm}, {LEFT: goal}, speed)[LEFT]
    arm.start(path)
    return path


def steps(arm, count):
    """The next setpoints."""
    return [arm.step() for _ in range(count)]


def test_a_reference_holds_where_it_was_seeded():
    """Nothing moves before something is asked for."""
    arm = reference()
    assert steps(arm, 3) == [HOME] * 3
    assert arm.is_at_rest and arm.mode is HOLD
    assert arm.progress == 1.0
    assert arm.rest_values() == HOME


def test_a_path_is_walked_once_and_then_held():
    """Progress runs from 0 to 1; the last setpoint is the goal."""
    arm = reference()
    path = go(arm)
    assert arm.mode is PATH and arm.progress == 0.0
    sent = [HOME, HOME, HOME, *steps(arm, 20)]
    assert 0.0 < arm.progress < 1.0
    assert math.hypot(*arm.rates[:3]) > 0.0 and any(arm.forces)
    sent += steps(arm, math.ceil(path.duration_s / DT))
    judge(sent, LIMITS)
    assert arm.mode is HOLD and arm.progress == 1.0
    assert arm.values[:3] == GOAL[:3]
    assert angle_rad(arm.values[3:], GOAL[3:]) < 1e-9


def test_braking_on_a_path_stays_on_its_line():
    """And ends at rest; a second brake changes nothing."""
    arm = reference()
    go(arm)
    sent = [HOME, HOME, *steps(arm, 40)]
    rest = arm.rest_values()
    arm.brake()
    arm.brake()
    assert arm.mode is BRAKE
    while arm.mode is BRAKE:
        sent.append(arm.step())
    judge(sent, LIMITS)
    assert arm.values == rest
    for values in sent:
        assert math.dist(HOME[:3], values[:3]) + math.dist(values[:3], GOAL[:3]) == pytest.approx(
            0.2 * math.sqrt(2), abs=1e-9
        )
    arm.brake()
    assert arm.mode is HOLD


def test_a_target_is_followed_and_a_path_goes_on_from_there():
    """A stream, then a path from its motion, then another stream."""
    arm = reference()
    sent = [HOME, HOME, HOME]
    arm.follow(GOAL, 0.5)
    sent += steps(arm, 30)
    assert arm.mode is FOLLOW and arm.is_limited
    go(arm, HOME)
    sent += steps(arm, 25)
    arm.follow((0.2, 0.2, 0.2, *HOME[3:]))
    sent += steps(arm, 300)
    judge(sent, LIMITS)
    assert arm.values == (0.2, 0.2, 0.2, *HOME[3:])


def test_a_followed_target_is_wished_for_and_may_be_bounded():
    """The wish is full speed towards it; with a bound it takes longer, on the same way to the same place."""
    steps = []
    for bound in (1.0, 0.3):
        arm = reference()
        arm.follow(GOAL)
        assert math.hypot(*arm.wish()[:3]) == pytest.approx(0.999 * LIMITS.v_mps)
        arm.bound(bound)
        steps.append(0)
        while arm.values != GOAL:
            arm.step()
            steps[-1] += 1
    assert steps[1] > 2 * steps[0]


def test_a_path_to_where_it_rests_is_no_path():
    """The reference goes on holding."""
    arm = reference()
    go(arm, HOME)
    assert arm.mode is HOLD


def test_a_path_planned_from_another_state_is_refused():
    """Nothing has changed: the reference goes on with what it did."""
    arm = reference()
    path = plan_poses({LEFT: arm}, {LEFT: GOAL})[LEFT]
    go(arm)
    arm.step()
    with pytest.raises(PlanFailed, match="another state"):
        arm.start(path)
    assert arm.mode is PATH


@pytest.mark.parametrize("bad", [HOME[:6], (0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), (*HOME[:3], 0.0, 0.0, 0.0, 0.5)])
def test_a_start_or_a_target_that_is_none_changes_nothing(bad):
    """Shape, reach and norm."""
    arm = reference()
    for ask in (arm.seed, arm.follow, lambda values: arm.enter(values, (0.0,) * 6, (0.0,) * 6)):
        with pytest.raises(PlanFailed):
            ask(bad)
    with pytest.raises(PlanFailed):
        arm.follow(HOME, 1.1)
    assert arm.mode is HOLD and arm.values == HOME


def test_the_sign_of_the_quaternion_goes_on_whatever_a_course_gives():
    """A course may give either sign."""

    @dataclass
    class Flipping:
        start: PoseState
        duration_s: float = 5 * DT

        def at(self, time_s):
            sign = -1.0 if round(time_s / DT) % 2 else 1.0
            return PoseState(HOME[:3], tuple(sign * c for c in HOME[3:]))

    arm = reference()
    arm.start(Flipping(arm.state))
    judge([HOME, *steps(arm, 8)], LIMITS)


def test_ruckigs_complaints_are_told(monkeypatch):
    """The arm brakes for those setpoints."""
    arm = reference()
    arm.follow(GOAL)
    sent = [HOME, HOME, *steps(arm, 20)]

    def none(*_):
        raise NoPlan("no plan today")

    monkeypatch.setattr(pose_follower, "solve", none)
    sent += steps(arm, 3)
    judge(sent, LIMITS)
    assert arm.faults == 3 and arm.last_fault == "no plan today"


# ------------------------------------------------------------------------------------------------ taking a motion over


def test_a_motion_taken_over_brakes_from_its_last_setpoint():
    """Another reference goes on from the state of the first one, and stops where that one would have."""
    first = reference()
    first.follow(GOAL)
    sent = [HOME, HOME, *steps(first, 40)]
    second = PoseReference(LIMITS, DT)
    second.enter(first.values, first.rates, first.forces)
    assert second.mode is BRAKE
    while second.mode is BRAKE:
        sent.append(second.step())
    judge(sent, LIMITS)
    assert second.values == pytest.approx(first.rest_values(), abs=1e-12)


def test_a_setpoint_taken_over_is_repeated_to_the_last_bit():
    """Its quaternion is not normalised anew, which would round it; only one that is off is."""
    place, quat = (
        (0.11, -0.19, -0.43),
        (0.28062750292422917, 0.09557118569993164, -0.7530281712979346, 0.5874205702034183),
    )
    for n in range(200):
        arm = reference()
        held = (*place, *(c * (1.0 + (n - 100) * 1e-16) for c in quat))
        arm.enter(held, (0.0,) * 6, (0.0,) * 6)
        assert steps(arm, 2) == [held] * 2
    arm.enter((*place, *(c * 1.0001 for c in quat)), (0.0,) * 6, (0.0,) * 6)
    assert math.hypot(*arm.values[3:]) == pytest.approx(1.0, abs=1e-15)


def test_a_motion_at_rest_taken_over_is_held():
    """There is nothing to brake; the sign of the quaternion stays."""
    opposite = (*HOME[:3], *(-c for c in HOME[3:]))
    arm = PoseReference(LIMITS, DT)
    arm.enter(opposite, (0.0,) * 6, (0.0,) * 6)
    assert arm.mode is HOLD and arm.values == opposite


@pytest.mark.parametrize(
    ("rates", "forces", "blamed"),
    [
        ((0.3, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0,) * 6, "linear velocity"),
        ((0.0, 0.0, 0.0, 0.6, 0.6, 0.0), (0.0,) * 6, "angular velocity"),
        ((0.0,) * 6, (0.0, 2.0, 0.0, 0.0, 0.0, 0.0), "linear acceleration"),
        ((0.0,) * 6, (0.0, 0.0, 0.0, 0.0, 0.0, 6.0), "angular acceleration"),
        ((math.nan, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0,) * 6, ""),
        ((0.0,) * 6, (0.0,) * 5, ""),
    ],
)
def test_a_motion_outside_the_limits_is_not_taken_over(rates, forces, blamed):
    """It cannot be ours; nothing has changed."""
    arm = reference()
    with pytest.raises(PlanFailed) as caught:
        arm.enter(HOME, rates, forces)
    assert caught.value.joint == blamed
    assert arm.mode is HOLD


def test_a_motion_that_would_leave_the_reach_is_not_taken_over():
    """No setpoint of ours is one that cannot stop inside; at the end of the reach, at rest, one may be."""
    arm = reference()
    edge = (0.55 + 1e-10, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    with pytest.raises(PlanFailed, match="cannot stop"):
        arm.enter(edge, (0.2, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0,) * 6)
    assert arm.values == HOME
    arm.enter(edge, (0.0,) * 6, (0.0,) * 6)
    assert arm.values[0] == edge[0]


# ------------------------------------------------------------------------------------------------ anything in any order


@pytest.mark.parametrize("limits", [LIMITS, HARD, WEAK])
@pytest.mark.parametrize("after", [1, 5, 9, 11, 14, 20, 40])
def test_a_target_as_far_along_each_axis_leaves_room_to_brake(limits, after):
    """All axes accelerate at their shares; whoever brakes or begins a path then stays below the speed limit."""
    target = (0.10, -0.10, -0.40, *about((1.0, 1.0, 1.0), 1.5))
    for end in ("brake", "path"):
        arm = reference(limits)
        arm.follow(target)
        sent = [HOME] * 3 + steps(arm, after)
        arm.brake() if end == "brake" else go(arm, HOME)
        sent += steps(arm, 400)
        assert arm.is_at_rest
        judge(sent, limits)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    limits=st.sampled_from((LIMITS, HARD, WEAK)),
    rate_hz=st.sampled_from((50.0, 70.0, 77.0)),
)
def test_whatever_is_asked_the_setpoints_keep_every_limit(seed, limits, rate_hz):
    """Paths, targets anywhere, brakes and takeovers at any moment: norms of three differences, reach and sign."""
    rng = random.Random(seed)
    period_s = 1.0 / rate_hz
    arm = reference(limits, period_s, any_pose(rng))
    sent = [arm.values] * 3

    def pose():
        return any_pose(rng) if rng.random() < 0.5 else even_pose(rng, arm.values)

    for _ in range(6):
        asked = rng.random()
        if asked < 0.35:
            go(arm, pose(), rng.choice((1.0, 0.3)))
        elif asked < 0.7:
            for _ in range(rng.choice((1, 10))):
                arm.follow(pose(), rng.choice((1.0, 0.4)))
                sent += steps(arm, rng.choice((1, 5)))
        elif asked < 0.85:
            arm.brake()
        else:
            other = PoseReference(limits, period_s)
            other.enter(arm.values, arm.rates, arm.forces)
            arm = other
        sent += steps(arm, rng.choice((1, 10, 80)))
    arm.brake()
    sent += steps(arm, 300)
    assert arm.is_at_rest
    judge(sent, limits, period_s)


# --------------------------------------------------------------------------------------------------- trajectories


def swing(count=60, rate=1.2):
    """A smooth swing from home, in position and orientation."""
    swings = [1.0 - math.cos(rate * n / 30) for n in range(count)]
    poses = [(0.30 + 0.04 * s, 0.10, -0.20 - 0.02 * s, *about((0.0, 0.0, 1.0), 0.2 * s)) for s in swings]
    return interpolate_poses(poses, [n / 30 for n in range(count)])


def track(arm, trajectory, start_s=0.0, *, rests=True):
    """Follow a trajectory."""
    passage = arm.prepare(trajectory, start_s, rests=rests)
    arm.track(passage)
    return passage


def test_a_trajectory_of_poses_is_followed_to_rest_at_its_end():
    """Progress rises from 0 to 1; then it is held."""
    arm = reference()
    passage = track(arm, swing())
    sent, seen = [HOME] * 3, []
    assert arm.mode is ReferenceMode.CHUNK
    while arm.mode is ReferenceMode.CHUNK:
        sent.append(arm.step())
        seen.append(arm.progress)
    assert seen == sorted(seen) and 0.0 < seen[0] < 0.02 and seen[-1] == 1.0
    assert (arm.mode, arm.is_at_rest, arm.passage) == (HOLD, True, passage)
    judge([*sent, *steps(arm, 3)], LIMITS)
    assert math.dist(arm.values[:3], swing().points[-1][:3]) < 1e-9


def test_a_trajectory_of_poses_that_runs_out_leaves_the_arm_braking():
    """Smoothly; what happened stays to be seen until something else is asked for."""
    arm = reference()
    passage = track(arm, swing(), rests=False)
    judge([HOME, HOME, HOME, *steps(arm, 250)], LIMITS)
    assert arm.passage is passage and passage.outcome is Outcome.UNDERRUN and arm.mode is HOLD
    arm.brake()
    assert arm.passage is None


def test_a_trajectory_of_poses_takes_over_from_any_motion_and_any_motion_from_it():
    """A path, a followed target, a brake, another trajectory, one that waits: each without a step."""
    arm = reference()
    go(arm)
    sent = [HOME, HOME, HOME, *steps(arm, 15)]
    track(arm, swing(), rests=False)
    sent += steps(arm, 40)
    waiting = track(arm, swing(rate=1.0), -0.2)
    assert waiting.is_waiting and waiting.under_way is not None
    assert math.dist(arm.origin(waiting)[:3], arm.values[:3]) < 0.1
    sent += steps(arm, 40)
    arm.follow(GOAL)
    sent += steps(arm, 20)
    track(arm, swing(), -0.1)
    sent += steps(arm, 30)
    arm.brake()
    sent += steps(arm, 60)
    go(arm)
    judge([*sent, *steps(arm, 40)], LIMITS)
    assert arm.passage is None
