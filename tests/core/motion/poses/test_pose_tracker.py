"""One end effector along a trajectory of poses: near to it, inside every limit, whatever came before and comes after."""

from __future__ import annotations

import math
import random

import pytest

from gateway.core.motion.poses.pose_follower import followed
from gateway.core.motion.poses.pose_state import PoseDynamics
from gateway.core.motion.poses.pose_tracker import PoseTracker
from gateway.core.motion.poses.pose_trajectory import interpolate_poses
from gateway.core.motion.poses.quaternion import angle_rad
from gateway.core.motion.tracker import Outcome
from tests.core.pose_judge import DT, HOME, LIMITS, about, judge, posed

DYNAMICS = PoseDynamics(LIMITS, DT)
AT_HOME = posed(HOME[:3], HOME[3:])


def swing(count=90, rate=1.5, size_m=0.05, turn_rad=0.2, phase_s=0.0, base=HOME, dt_s=1 / 30):
    """A swing in position and orientation that begins at `base`."""
    poses = []
    for n in range(count):
        s = 1.0 - math.cos(rate * (n * dt_s + phase_s))
        x, y, z = base[:3]
        poses.append((x + size_m * s, y - 0.5 * size_m * s, z, *about((0.0, 1.0, 1.0), turn_rad * s)))
    return interpolate_poses(poses, [n * dt_s for n in range(count)])


def way(trajectory, start_s=0.0, *, rests=True, lead=None):
    """A way along a trajectory with the usual limits."""
    return PoseTracker(DYNAMICS, trajectory, start_s, rests=rests, lead=lead)


class Walker:
    """Takes the steps of one way after the other, and keeps every setpoint."""

    def __init__(self, state=AT_HOME):
        self.state = state
        self.sent = [state.values] * 3

    def step(self, tracker, count=1):
        """Take steps; return whether the way went on."""
        for _ in range(count):
            state = tracker.step(self.state)
            if state is None:
                return False
            self.take(state)
        return True

    def take(self, state):
        """Take a state as a reference does."""
        self.state = DYNAMICS.settle(state, self.state)
        self.sent.append(self.state.values)

    def until_end(self, tracker, limit=1000):
        """Step until the way has ended; return how."""
        for _ in range(limit):
            if not self.step(tracker) or tracker.outcome is not None:
                return tracker.outcome
        raise AssertionError(f"still under way at {tracker.time_s} s")


def test_poses_are_followed_to_rest_at_the_last_one():
    """Within some millimetres all the way, exactly at the end, a little after its time."""
    trajectory, walker = swing(), Walker()
    tracker = way(trajectory)
    assert not tracker.has_joined
    while tracker.outcome is None:
        walker.step(tracker)
        wanted = tracker.place_in(0.0)
        if tracker.time_s > 0.6:
            assert tracker.has_joined and math.dist(wanted[:3], walker.state.values[:3]) < 0.006
            assert angle_rad(wanted[3:], walker.state.values[3:]) < 0.03
    assert tracker.outcome is Outcome.DONE and tracker.progress == 1.0 and tracker.time_s < trajectory.duration_s + 0.4
    assert walker.state.values[:3] == pytest.approx(trajectory.points[-1][:3], abs=1e-9)
    assert walker.step(tracker) and walker.sent[-1] == walker.sent[-2]
    judge(walker.sent, LIMITS)


def test_an_open_end_is_an_underrun_without_a_successor():
    """At speed at the last pose; the arm has to brake."""
    walker, tracker = Walker(), way(swing(count=40), rests=False)
    assert walker.until_end(tracker) is Outcome.UNDERRUN and tracker.step(walker.state) is None
    assert math.hypot(*walker.state.v[:3]) > 0.03 and abs(tracker.time_s - 1.3) <= 2 * DT
    for state in DYNAMICS.halt(walker.state).states:
        walker.take(state)
    judge(walker.sent, LIMITS)


def test_a_chunk_is_replaced_in_mid_motion_without_a_stop():
    """Five times a second, each from 0.3 s ago, a little beside the last."""
    rng, walker = random.Random(2), Walker()
    speeds = []
    for n in range(20):
        age_s = 0.3 if n > 2 else 0.0
        beside = tuple(x + rng.uniform(-0.001, 0.001) for x in HOME[:3]) + HOME[3:]
        tracker = way(swing(40, 0.6, 0.2, phase_s=max(0.2 * n - age_s, 0.0), base=beside), age_s, rests=False)
        assert walker.step(tracker, 14)
        speeds.append(math.hypot(*walker.state.v[:3]))
    judge(walker.sent, LIMITS)
    assert min(speeds[5:]) > 0.03


def test_before_a_start_in_the_future_the_arm_goes_on_or_rests():
    """With the trajectory under way; without one it comes to rest and waits."""
    first, walker = way(swing(rate=0.8), rests=False), Walker()
    assert walker.step(first, 40) and first.under_way is first
    second = way(swing(rate=0.8, phase_s=1.0), -0.4, lead=first)
    assert second.is_waiting and second.under_way is first and second.progress == 0.0
    expected = second.origin(walker.state.values, HOME)
    assert walker.step(second, 28) and math.dist(expected[:3], walker.state.values[:3]) < 0.006
    assert walker.step(second, 2) and not second.is_waiting and second.origin(HOME, HOME) == HOME

    alone = way(swing(), -2.0)
    rest = DYNAMICS.halted(walker.state)
    assert alone.under_way is None and alone.origin(walker.state.values, rest) == rest
    assert walker.step(alone, 120) and walker.state.is_at_rest
    assert math.dist(walker.state.values[:3], rest[:3]) < 0.01

    over = way(swing(count=4), rests=False)
    waits = way(swing(), -1.0, lead=over)
    assert walker.step(waits, 60) and waits.under_way is None and walker.state.is_at_rest
    judge(walker.sent, LIMITS)


def test_an_end_effector_far_from_its_trajectory_counts_as_joined_after_a_second():
    """So that a path tolerance is not waited for for ever."""
    here = posed((0.3, 0.1, 0.1), HOME[3:])
    walker, tracker = Walker(here), way(swing(rate=0.2))
    walker.step(tracker, 60)
    assert not tracker.has_joined
    walker.step(tracker, 20)
    assert tracker.has_joined


def test_what_lies_ahead_is_kept_inside_the_reach():
    """Axis by axis ahead may be outside although every pose is inside."""
    radius = 0.5499
    poses = [
        (radius * math.cos(0.4 * n / 30), radius * math.sin(0.4 * n / 30), 0.0, 0.0, 0.0, 0.0, 1.0) for n in range(60)
    ]
    trajectory = interpolate_poses(poses, [n / 30 for n in range(60)])
    walker = Walker(posed(poses[0][:3], poses[0][3:]))
    assert walker.until_end(way(trajectory)) is Outcome.DONE
    judge(walker.sent, LIMITS)


def farthest(a_mps2, v_mps, direction):
    """How far an arm gets from a swing of so much acceleration and speed at most [m]; every limit is kept."""
    rate, base = a_mps2 / v_mps, (0.1, 0.1, -0.2)
    size_m, count = v_mps / rate, math.ceil(4.0 * math.pi / rate * 30)
    along = [c / math.hypot(*direction) for c in direction]
    swings = (size_m * (1.0 - math.cos(rate * n / 30)) for n in range(count))
    poses = [(*(x + s * c for x, c in zip(base, along, strict=True)), *HOME[3:]) for s in swings]
    trajectory = interpolate_poses(poses, [n / 30 for n in range(count)])
    tracker, walker, most = way(trajectory), Walker(posed(base, HOME[3:])), 0.0
    while tracker.outcome is None:
        walker.step(tracker)
        most = max(most, math.dist(tracker.place_in(0.0)[:3], walker.state.values[:3]))
    judge(walker.sent, LIMITS)
    return most


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (1.0, -0.5, 0.0), (1.0, 1.0, 1.0)])
@pytest.mark.parametrize("part", [0.3, 0.6, 0.98])
def test_poses_that_ask_for_no_more_than_is_followed_are_near(direction, part):
    """Within 15 mm, whatever the direction."""
    _, v_mps, a_mps2, _, _ = followed(DYNAMICS)
    assert farthest(0.98 * a_mps2, part * v_mps, direction) < 0.015


def test_poses_that_ask_for_all_that_the_limits_allow_would_be_far_away():
    """By centimetres: why such a trajectory is refused."""
    assert farthest(0.98 * LIMITS.a_mps2, 0.2, (1.0, 0.0, 0.0)) > 0.04
