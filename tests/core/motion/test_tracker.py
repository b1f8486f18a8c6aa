"""What trackers of joints and of poses share: the trajectory's own clock, waiting for it, and how it ends."""

from __future__ import annotations

import math

import pytest

from gateway.core.motion.joints.braking import REST, Braking, JointLimits
from gateway.core.motion.joints.tracker import JointTracker
from gateway.core.motion.joints.trajectory import interpolate
from gateway.core.motion.poses.pose_state import PoseDynamics
from gateway.core.motion.poses.pose_tracker import PoseTracker
from gateway.core.motion.poses.pose_trajectory import interpolate_poses
from gateway.core.motion.space import State
from gateway.core.motion.tracker import Outcome
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import Side
from tests.core import pose_judge

LOWER, UPPER = JOINT_LOWER_RAD[Side.LEFT], JOINT_UPPER_RAD[Side.LEFT]
JOINTS = JointLimits(v_radps=1.0, a_radps2=3.0, j_radps3=20.0, lower_rad=LOWER, upper_rad=UPPER)
SWINGS = [0.03 * (1.0 - math.cos(n / 30)) for n in range(60)]
TIMES_S = [n / 30 for n in range(60)]
HOME = HOME_Q_RAD[Side.LEFT]


class Joints:
    """A swing of two joints from home."""

    space = Braking(JOINTS, 0.01)
    state = State(HOME, REST, REST)
    trajectory = interpolate([(*HOME[:2], HOME[2] + s, *HOME[3:]) for s in SWINGS], TIMES_S)
    make = JointTracker


class Poses:
    """A swing of an end effector from home."""

    space = PoseDynamics(pose_judge.LIMITS, 0.01)
    state = pose_judge.posed(pose_judge.HOME[:3])
    trajectory = interpolate_poses([(0.30 + s, 0.10, -0.20, 0.0, 0.0, 0.0, 1.0) for s in SWINGS], TIMES_S)
    make = PoseTracker


@pytest.fixture(params=[Joints, Poses])
def kind(request):
    """A space, an arm at rest in it, and a trajectory from there."""
    return request.param


def way(kind, start_s=0.0, *, rests=True, lead=None):
    """A way along the trajectory, begun unless it waits."""
    tracker = kind.make(kind.space, kind.trajectory, start_s, rests=rests, lead=lead)
    assert tracker.is_sound and (tracker.is_waiting or tracker.begin(kind.state))
    return tracker


def run(tracker, state, steps):
    """The state after some steps; all of them are there."""
    for _ in range(steps):
        state = tracker.step(state)
        assert state is not None
    return state


def test_progress_and_position_are_those_of_the_trajectory_s_own_clock(kind):
    """0 before it begins, below 1 until the arm rests at its end."""
    late = kind.make(kind.space, kind.trajectory, 0.5, rests=True)
    assert late.progress == pytest.approx(0.5 / (59 / 30)) and late.time_s == 0.5
    assert late.place_in(0.1) == kind.trajectory.at(0.6)[0]
    assert way(kind, -1.0).progress == 0.0
    assert kind.make(kind.space, kind.trajectory, 99.0, rests=True).progress < 1.0


def test_it_is_done_at_rest_at_the_last_point_and_stays_there(kind):
    """Whatever is asked of it then."""
    tracker, state = way(kind), kind.state
    while tracker.outcome is None:
        state = run(tracker, state, 1)
    assert tracker.outcome is Outcome.DONE and tracker.progress == 1.0 and state.is_at_rest and tracker.has_joined
    assert state.values == pytest.approx(kind.trajectory.points[-1], abs=1e-7) and tracker.step(state) is state


def test_an_open_end_leaves_the_arm_to_its_brakes(kind):
    """UNDERRUN when the points are over; nothing comes after it."""
    tracker, state, count = way(kind, rests=False), kind.state, 0
    while (following := tracker.step(state)) is not None:
        state, count = following, count + 1
    assert tracker.outcome is Outcome.UNDERRUN and abs(count * 0.01 - 59 / 30) < 0.02
    assert tracker.step(state) is None and tracker.progress < 1.0


def test_before_a_start_in_the_future_the_arm_goes_on_with_what_it_follows(kind):
    """Where it will be when the next one begins is foreseen; from then on nothing leads it but that."""
    first = way(kind, rests=False)
    state = run(first, kind.state, 40)
    second = way(kind, -0.305, lead=first)
    assert second.is_waiting and second.under_way is first
    foreseen = second.origin(state.values, kind.state.values)
    state = run(second, state, 30)
    assert not second.is_waiting and state.values == pytest.approx(foreseen, abs=0.01)
    state = run(second, state, 1)
    assert second.under_way is second and second.origin(state.values, ()) == state.values


def test_an_arm_that_waits_and_follows_nothing_comes_to_rest(kind):
    """Also where what it followed runs out meanwhile."""
    first = way(kind, 1.5, rests=False)
    state = run(first, kind.state, 20)
    assert not state.is_at_rest
    alone = way(kind, -1.005)
    rest = kind.space.halted(state)
    assert alone.under_way is None and alone.origin(state.values, rest) == rest
    assert run(alone, state, 90).is_at_rest
    waits = way(kind, -1.505, lead=first)
    assert run(waits, state, 140).is_at_rest and waits.under_way is None
