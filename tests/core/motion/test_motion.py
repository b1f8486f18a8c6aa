"""One arm's reference, of joints or of poses: one continuous motion within every limit, whatever is asked in any order."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.core.motion import follower
from gateway.core.motion.joints.trajectory import interpolate
from gateway.core.motion.motion import (
    JointLimits,
    JointReference,
    PlanFailed,
    PoseReference,
    ReferenceMode,
    plan,
    plan_poses,
)
from gateway.core.motion.poses.pose_trajectory import interpolate_poses
from gateway.core.motion.solver import NoPlan
from gateway.core.motion.space import State
from gateway.core.motion.tracker import Outcome
from gateway.robot.limits import (
    HARD_A_RADPS2,
    HARD_J_RADPS3,
    HARD_V_RADPS,
    HOME_Q_RAD,
    JOINT_LOWER_RAD,
    JOINT_UPPER_RAD,
)
from gateway.values import ARM_DOF, Side
from tests.core import pose_judge
from tests.core.pose_judge import about

DT = 0.01
LEFT, RIGHT = Side.LEFT, Side.RIGHT
HOME = HOME_Q_RAD
LOWER, UPPER = JOINT_LOWER_RAD, JOINT_UPPER_RAD
DEFAULT = (1.0, 3.0, 20.0)
HARD = (HARD_V_RADPS, HARD_A_RADPS2, HARD_J_RADPS3)
REST = (0.0,) * ARM_DOF
HOLD, PATH, FOLLOW, CHUNK, BRAKE = ReferenceMode
TOLERANCE = 1e-6
"""Part of a limit by which a finite difference may exceed it: rounding and ruckig's own accuracy (1e-10 was measured)."""


def reference(side=LEFT, bounds=DEFAULT, period_s=DT) -> JointReference:
    """An arm at home that has not moved yet."""
    v, a, j = bounds
    limits = JointLimits(v_radps=v, a_radps2=a, j_radps3=j, lower_rad=LOWER[side], upper_rad=UPPER[side])
    made = JointReference(limits, period_s)
    made.seed(HOME[side])
    return made


def posing(limits=pose_judge.LIMITS, period_s=pose_judge.DT, values=pose_judge.HOME) -> PoseReference:
    """An end effector at home that has not moved yet."""
    made = PoseReference(limits, period_s)
    made.seed(values)
    return made


def at_home(index: int, value: float, side=LEFT) -> tuple[float, ...]:
    """The home position with one joint elsewhere."""
    return (*HOME[side][:index], value, *HOME[side][index + 1 :])


def check(setpoints, limits: JointLimits, dt=DT) -> None:
    """Differences of setpoints keep velocity, acceleration and jerk of each joint."""
    for n in range(ARM_DOF):
        q = [setpoint[n] for setpoint in setpoints]
        for bound in (limits.v_radps * dt, limits.a_radps2 * dt**2, limits.j_radps3 * dt**3):
            q = [y - x for x, y in pairwise(q)]
            assert max(map(abs, q), default=0.0) <= bound * (1 + TOLERANCE)


class Recorder:
    """Steps a reference and judges every setpoint it hands out."""

    def __init__(self, arm: JointReference):
        self.arm = arm
        self.setpoints = [arm.values]

    def step(self, count=1):
        """Take steps, each judged on its own: inside the limits, and braking from it would end inside as well."""
        limits = self.arm.space.limits
        for _ in range(count):
            self.setpoints.append(self.arm.step())
            assert self.setpoints[-1] is self.arm.values
            for q_rad in (self.arm.values, self.arm.rest_values()):
                joints = zip(q_rad, limits.lower_rad, limits.upper_rad, strict=True)
                assert all(lower <= q <= upper for q, lower, upper in joints)
        return self

    def until_rest(self, limit=4000):
        """Step until nothing moves."""
        for _ in range(limit):
            self.step()
            if self.arm.is_at_rest and self.arm.mode in (HOLD, FOLLOW):
                return self
        raise AssertionError(f"still moving after {limit} steps: {self.arm.mode}, {self.arm.rates}")

    def check(self):
        """Judge the differences of all setpoints."""
        check(self.setpoints, self.arm.space.limits, self.arm.period_s)
        return self


def go(arm: JointReference, goal, speed=1.0) -> None:
    """Follow a path of one arm."""
    arm.start(plan({LEFT: arm}, {LEFT: goal}, speed)[LEFT])


# --------------------------------------------------------------------------------------------------- hold, seed


def test_a_reference_is_inside_its_limits_before_it_is_seeded():
    """Where 0 is outside, at the limit."""
    limits = JointLimits(v_radps=1, a_radps2=3, j_radps3=20, lower_rad=LOWER[RIGHT], upper_rad=UPPER[RIGHT])
    assert JointReference(limits, DT).step() == (0.0, 0.0, 0.0, -0.25, 0.0, 0.0, 0.0)


def test_a_seed_jumps_and_ends_everything():
    """In mid-motion too: the stream is silent when it is used."""
    arm = reference()
    go(arm, UPPER[LEFT])
    Recorder(arm).step(30)
    arm.seed(LOWER[LEFT])
    assert (arm.values, arm.mode, arm.is_at_rest, arm.progress) == (LOWER[LEFT], HOLD, True, 1.0)
    assert arm.step() == LOWER[LEFT]


# -------------------------------------------------------------------------------------------------------- paths


@pytest.mark.parametrize("speed", [1.0, 0.3])
def test_both_arms_of_a_plan_end_on_the_same_step(speed):
    """Each arm keeps its own time, and they need the same number of setpoints; from motion as well."""
    arms = {side: reference(side) for side in Side}
    records = {side: Recorder(arm) for side, arm in arms.items()}
    arms[LEFT].follow(UPPER[LEFT])
    records[LEFT].step(40)
    goals = {LEFT: at_home(0, -1.0), RIGHT: at_home(6, 0.0, RIGHT)}
    paths = plan(arms, goals, speed)
    assert paths[LEFT].duration_ns == paths[RIGHT].duration_ns
    ends = {}
    for side in Side:
        arms[side].start(paths[side])
        while arms[side].mode is PATH:
            records[side].step()
            ends[side] = ends.get(side, 0) + 1
        records[side].check()
        assert arms[side].values == pytest.approx(goals[side], abs=3e-8)
    assert ends[LEFT] == ends[RIGHT]


@pytest.mark.parametrize("bounds", [DEFAULT, HARD])
@pytest.mark.parametrize("speed", [0.01, 0.1, 0.5, 1.0])
def test_moves_at_any_speed_keep_all_limits(bounds, speed):
    """From the smallest factor to the largest, with the default limits and with the hard ones."""
    arm = reference(bounds=bounds)
    goal = tuple(q + 0.02 + speed * 0.5 * (upper - q - 0.02) for q, upper in zip(HOME[LEFT], UPPER[LEFT], strict=True))
    go(arm, goal, speed)
    record = Recorder(arm).until_rest(20_000).check()
    fastest = max(
        abs(y - x) for first, second in pairwise(record.setpoints) for x, y in zip(first, second, strict=True)
    )
    assert fastest <= speed * bounds[0] * DT * (1 + TOLERANCE)
    assert arm.values == goal


# ------------------------------------------------------------------------------------------------------- braking


def test_braking_at_rest_is_holding():
    """Also for a path that has not begun and for a stream that has arrived."""
    arm = reference()
    arm.brake()
    assert arm.mode is HOLD
    go(arm, UPPER[LEFT])
    arm.brake()
    assert (arm.mode, arm.step()) == (HOLD, HOME[LEFT])
    arm.follow(HOME[LEFT])
    arm.step()
    arm.brake()
    assert arm.mode is HOLD


@pytest.mark.parametrize("bounds", [DEFAULT, HARD])
@pytest.mark.parametrize("goal", [UPPER[LEFT], LOWER[LEFT]])
def test_braking_in_every_phase_of_a_move_ends_inside_and_where_it_was_said(bounds, goal):
    """At each setpoint of a move to the limits: a stop of at most v/a + 2.5·a/j, then hold."""
    v, a, j = bounds
    leader = reference(bounds=bounds)
    go(leader, goal)
    phases = 0
    while leader.mode is PATH:
        leader.step()
        phases += 1
    for phase in range(1, phases, 7):
        arm = reference(bounds=bounds)
        go(arm, goal)
        record = Recorder(arm).step(phase)
        rest_rad = arm.rest_values()
        arm.brake()
        assert arm.mode is BRAKE and arm.progress == 1.0
        steps = len(record.setpoints)
        record.until_rest()
        assert len(record.setpoints) - steps <= math.ceil((v / a + 2.5 * a / j) / DT)
        assert arm.values == pytest.approx(rest_rad, abs=1e-12)
        assert record.step(3).setpoints[-3:] == [arm.values] * 3
        record.check()


# ------------------------------------------------------------------------------------------------------- streams


def test_the_first_setpoint_of_a_stream_is_near_and_the_mode_stays_when_it_has_arrived():
    """A stream is open until something else is asked for."""
    arm = reference()
    arm.follow(at_home(0, 0.5))
    record = Recorder(arm).step()
    assert abs(arm.values[0] - 0.41) < 1e-5
    record.step(100).check()
    assert (arm.mode, arm.values, arm.is_at_rest, arm.progress) == (FOLLOW, at_home(0, 0.5), True, 1.0)


def test_a_bad_target_changes_nothing():
    """Length, finiteness, limits and factor are checked; the stream goes on to the last good one."""
    arm = reference()
    arm.follow(at_home(0, 1.0))
    record = Recorder(arm).step(20)
    for bad in ((), (0.3,) * 8, at_home(1, math.inf), at_home(3, 0.2)):
        with pytest.raises(PlanFailed, match="target"):
            arm.follow(bad)
    for speed in (0.0, 1.5, math.nan):
        with pytest.raises(PlanFailed, match="speed"):
            arm.follow(HOME[LEFT], speed)
    record.until_rest().check()
    assert arm.values == at_home(0, 1.0)


@pytest.mark.parametrize("bounds", [DEFAULT, HARD])
@pytest.mark.parametrize("every", [1, 2, 5, 20, 100])
def test_noisy_targets_at_any_rate_keep_all_limits(bounds, every):
    """100, 50, 20, 5 and 1 Hz, a wandering target with noise that often lies beyond a limit and is put on it."""
    numbers = random.Random(every)
    arm = reference(bounds=bounds)
    record, wander = Recorder(arm), list(HOME[LEFT])
    for _ in range(1500 // every):
        wander = [q + numbers.gauss(0.0, 0.06 * every**0.5) for q in wander]
        noisy = [q + numbers.gauss(0.0, 0.02) for q in wander]
        arm.follow([min(max(q, lo), up) for q, lo, up in zip(noisy, LOWER[LEFT], UPPER[LEFT], strict=True)])
        record.step(every)
    record.until_rest().check()
    assert arm._follower.faults == 0


@pytest.mark.parametrize("bounds", [DEFAULT, HARD])
def test_a_target_that_flips_at_full_speed_near_a_limit_never_crosses_it(bounds):
    """At every distance from the limit: towards it at full speed, away, and towards it again."""
    arm = reference(bounds=bounds)
    record = Recorder(arm)
    for steps in range(1, 120, 3):
        arm.follow(UPPER[LEFT])
        record.step(60)
        arm.follow(LOWER[LEFT])
        record.step(steps)
        arm.follow(UPPER[LEFT])
        record.step(3)
    record.until_rest().check()
    assert arm.values == UPPER[LEFT]


@pytest.mark.parametrize("speed", [0.01, 0.1, 0.6])
def test_a_lower_speed_in_mid_motion_slows_down_first(speed):
    """In a stream and in a path: within all limits, at the lower velocity in the end, and without overshooting."""
    for other in (lambda arm: arm.follow(at_home(0, 1.5), speed), lambda arm: go(arm, at_home(0, 1.5), speed)):
        arm = reference()
        arm.seed(at_home(0, -1.0))
        arm.follow(at_home(0, 1.5))
        record = Recorder(arm).step(90)
        assert arm.rates[0] == pytest.approx(1.0)
        other(arm)
        record.step(60)
        assert arm.rates[0] <= speed * (1 + TOLERANCE)
        record.until_rest(30_000).check()
        assert max(setpoint[0] for setpoint in record.setpoints) <= 1.5 + 1e-7
        assert arm.values[0] == pytest.approx(1.5, abs=3e-8)


def test_the_speed_of_a_stream_may_change_with_each_target():
    """Faster, slower, faster: only the velocity follows."""
    arm = reference()
    record = Recorder(arm)
    for n, speed in enumerate((1.0, 0.2, 0.5, 0.05, 1.0, 0.3) * 8):
        arm.follow((UPPER if n // 3 % 2 else LOWER)[LEFT], speed)
        record.step(17)
    record.until_rest(6000).check()


def test_a_stream_that_asks_for_too_much_is_limited_until_something_else_is_asked_for():
    """A viewer can tell why the arm is late, however often targets come."""
    arm = reference()
    for _ in range(80):
        arm.follow(UPPER[LEFT])
        arm.step()
    assert arm.is_limited
    arm.brake()
    assert not arm.is_limited


# ---------------------------------------------------------------------------------------------------- replacing


def joints_to_path(arm):
    """Ask for a path across the range."""
    go(arm, LOWER[LEFT])


def to_slow_path(arm):
    """Ask for a path at a tenth."""
    go(arm, at_home(4, -1.0), 0.1)


def to_stream(arm):
    """Ask for a target across the range."""
    arm.follow(LOWER[LEFT])


def joints_to_slow_stream(arm):
    """Ask for a target at a fifth."""
    arm.follow(at_home(4, -1.0), 0.2)


def to_brake(arm):
    """Ask for a stop."""
    arm.brake()


def to_upper(arm):
    """Begin with a move to the upper limits."""
    go(arm, UPPER[LEFT])


def to_upper_stream(arm):
    """Begin with a target at the upper limits."""
    arm.follow(UPPER[LEFT])


@pytest.mark.parametrize("bounds", [DEFAULT, HARD])
@pytest.mark.parametrize("second", [joints_to_path, to_slow_path, to_stream, joints_to_slow_stream, to_brake])
@pytest.mark.parametrize("first", [to_upper, to_upper_stream])
def test_anything_may_replace_anything_in_any_phase(first, second, bounds):
    """At phases all along the first motion; and the third replaces the second in mid-motion again."""
    for phase in (1, 4, 9, 15, 22, 31, 47, 70, 110, 150):
        arm = reference(bounds=bounds)
        record = Recorder(arm)
        first(arm)
        record.step(phase)
        second(arm)
        record.step(1 + phase % 13)
        to_stream(arm)
        record.step(7)
        joints_to_path(arm)
        record.until_rest().check()
        assert arm.values == pytest.approx(LOWER[LEFT], abs=3e-8)


actions = st.one_of(
    st.tuples(st.just("path"), st.integers(0, 2**16), st.sampled_from([1.0, 0.5, 0.1, 0.01])),
    st.tuples(st.just("follow"), st.integers(0, 2**16), st.sampled_from([1.0, 0.5, 0.1, 0.01])),
    st.tuples(st.just("brake"), st.just(0), st.just(1.0)),
)


@settings(max_examples=60, derandomize=True, deadline=None)
@given(
    bounds=st.sampled_from([DEFAULT, HARD, (0.5, 3.0, 20.0), (2.0, 10.0, 20.0)]),
    period_s=st.sampled_from([0.005, 0.01, 0.02]),
    script=st.lists(st.tuples(actions, st.sampled_from([1, 2, 3, 7, 20, 45])), min_size=1, max_size=15),
)
def test_no_order_of_requests_breaks_a_limit(bounds, period_s, script):
    """Any script of paths, targets and stops with both arms; then both brake, and end within their limits."""
    arms = {side: reference(side, bounds, period_s) for side in Side}
    records = {side: Recorder(arm) for side, arm in arms.items()}
    for (action, number, speed), steps in script:
        sides = [LEFT] if number % 3 == 0 else list(Side)
        numbers = random.Random(number)
        goals = {}
        for side in sides:
            ranges = zip(LOWER[side], UPPER[side], arms[side].values, strict=True)
            goals[side] = tuple(
                numbers.choice((low, high, q, min(q + 1e-9, high), numbers.uniform(low, high)))
                for low, high, q in ranges
            )
        if action == "path":
            for side, path in plan({side: arms[side] for side in sides}, goals, speed).items():
                arms[side].start(path)
        for side in sides:
            if action == "follow":
                arms[side].follow(goals[side], speed)
            elif action == "brake":
                arms[side].brake()
        for record in records.values():
            record.step(steps)
    for side, arm in arms.items():
        rest_rad = arm.rest_values()
        arm.brake()
        records[side].until_rest().check()
        assert arm.mode is HOLD and arm._follower.faults == 0
        assert arm.values == pytest.approx(rest_rad, abs=1e-12)


# ------------------------------------------------------------------------------------------------ looked at before it is taken


@pytest.mark.parametrize("bounds", [DEFAULT, HARD])
def test_any_joints_may_take_their_stop_instead_in_any_setpoint(bounds):
    """Mixed with the wanted state joint by joint, at random, also at a low speed factor: within every limit, and it ends."""
    rng = random.Random(5)
    arm = reference(bounds=bounds)
    recorder = Recorder(arm)
    for speed in (0.2, 1.0, 0.5):
        arm.follow(at_home(3, 0.6) if speed == 1.0 else at_home(1, 0.5), speed)
        for _ in range(150):
            wanted, stop = arm.ahead(), arm.stop_ahead()
            goes = [rng.random() < 0.7 for _ in range(ARM_DOF)]
            rows = zip(wanted, stop, strict=True)
            mixed = State(*(tuple(w if go else s for w, s, go in zip(*row, goes, strict=True)) for row in rows))
            arm.lead(mixed)
            recorder.step()
            assert arm.state == mixed and arm.mode is FOLLOW
    recorder.until_rest().check()
    assert arm.values == at_home(1, 0.5)


def test_a_bound_of_a_stream_holds_beside_its_own_factor_until_the_next_stream():
    """The lower of both counts; a bound in mid-motion slows down inside the limits."""
    arm = reference()
    recorder = Recorder(arm)
    arm.follow(at_home(3, 2.0), 0.8)
    recorder.step(60)
    assert max(map(abs, arm.rates)) == pytest.approx(0.8)
    arm.bound(0.1)
    recorder.step(60)
    assert max(map(abs, arm.rates)) == pytest.approx(0.1)
    arm.follow(at_home(3, 2.1), 0.9)
    recorder.step(10)
    assert max(map(abs, arm.rates)) == pytest.approx(0.1)
    arm.bound(1.0)
    recorder.step(50)
    assert max(map(abs, arm.rates)) == pytest.approx(0.9)
    arm.bound(0.1)
    arm.brake()
    recorder.until_rest().check()
    arm.follow(HOME[LEFT], 0.8)
    recorder.step(60).check()
    assert max(map(abs, arm.rates)) == pytest.approx(0.8)


# ------------------------------------------------------------------------------------------------ in either space


class Joints:
    """Of an arm in joint mode: where it is and may go, a path of it alone, a swing from home, and a judge."""

    home, goal = HOME[LEFT], at_home(2, 0.2)
    outside, dt = at_home(3, 0.25 - 1e-9), DT
    too_fast = (2.0,) * ARM_DOF
    make = staticmethod(reference)

    @staticmethod
    def path(arm, goal, speed=1.0):
        """A path of one arm."""
        return plan({LEFT: arm}, {LEFT: goal}, speed)[LEFT]

    @staticmethod
    def swing(rate=1.5, count=40):
        """A smooth swing of a joint from home."""
        swings = (1.0 - math.cos(rate * n / 30) for n in range(count))
        return interpolate([at_home(2, HOME[LEFT][2] + 0.1 * s) for s in swings], [n / 30 for n in range(count)])

    @staticmethod
    def judge(setpoints):
        """Differences keep the limits."""
        check(setpoints, JointLimits(v_radps=1, a_radps2=3, j_radps3=20, lower_rad=LOWER[LEFT], upper_rad=UPPER[LEFT]))


class Poses:
    """The same of an arm in end-effector mode."""

    home, goal = pose_judge.HOME, (0.10, -0.10, -0.20, *about((0.0, 1.0, 1.0), 1.0))
    outside, dt = (0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), pose_judge.DT
    too_fast = (0.3, 0.0, 0.0, 0.0, 0.0, 0.0)
    make = staticmethod(posing)

    @staticmethod
    def path(arm, goal, speed=1.0):
        """A path of one arm."""
        return plan_poses({LEFT: arm}, {LEFT: goal}, speed)[LEFT]

    @staticmethod
    def swing(rate=1.2, count=60):
        """A smooth swing from home, in position and orientation."""
        swings = [1.0 - math.cos(rate * n / 30) for n in range(count)]
        poses = [(0.30 + 0.04 * s, 0.10, -0.20 - 0.02 * s, *about((0.0, 0.0, 1.0), 0.2 * s)) for s in swings]
        return interpolate_poses(poses, [n / 30 for n in range(count)])

    @staticmethod
    def judge(setpoints):
        """Differences keep the limits as norms."""
        pose_judge.judge(setpoints, pose_judge.LIMITS)


@pytest.fixture(params=[Joints, Poses])
def kind(request):
    """Joints, then poses."""
    return request.param


def steps(arm, count):
    """The next setpoints."""
    return [arm.step() for _ in range(count)]


def track(arm, trajectory, start_s=0.0, *, rests=True):
    """Follow a trajectory that can be joined."""
    tracker = arm.prepare(trajectory, start_s, rests=rests)
    assert arm.begin(tracker) and (tracker.is_waiting or arm.origin(tracker) == arm.values)
    arm.track(tracker)
    return tracker


def test_a_reference_holds_where_it_was_seeded(kind):
    """The same setpoint again and again, at rest, with nothing pending."""
    arm = kind.make()
    assert steps(arm, 5) == [kind.home] * 5
    assert (arm.mode, arm.is_at_rest, arm.progress) == (HOLD, True, 1.0)
    assert not any(arm.rates) and not any(arm.forces) and arm.rest_values() == kind.home
    assert not arm.is_limited


def test_a_path_is_followed_to_its_end_and_then_held(kind):
    """Progress rises with each setpoint; the last one is the goal, at rest, in the period in which the path ends."""
    arm = kind.make()
    path = kind.path(arm, kind.goal)
    assert (arm.mode, steps(arm, 1)) == (HOLD, [kind.home])  # planning moves nothing
    arm.start(path)
    assert (arm.mode, arm.progress) == (PATH, 0.0)
    count = math.ceil(path.duration_s / kind.dt)
    sent, parts = [kind.home] * 3, []
    for _ in range(count - 1):
        sent += steps(arm, 1)
        parts.append(arm.progress)
    assert parts == sorted(set(parts)) and 0.0 < parts[0] and parts[-1] < 1.0 and arm.mode is PATH
    assert any(arm.rates) and any(arm.forces)
    sent += steps(arm, 1)
    assert (arm.mode, arm.progress, arm.is_at_rest) == (HOLD, 1.0, True)
    assert arm.values == pytest.approx(kind.goal, abs=1e-9)
    kind.judge([*sent, *steps(arm, 3)])


def test_a_path_to_where_the_arm_is_has_ended_at_once(kind):
    """No error, no motion, and nothing pending."""
    arm = kind.make()
    arm.start(kind.path(arm, kind.home))
    assert (arm.mode, arm.progress, arm.step()) == (HOLD, 1.0, kind.home)


def test_only_a_path_from_the_present_state_is_followed(kind):
    """A path that was planned before the last setpoint would be a jump; nothing changes."""
    arm = kind.make()
    arm.follow(kind.goal)
    sent = [kind.home, kind.home, *steps(arm, 20)]
    path = kind.path(arm, kind.home)
    sent += steps(arm, 1)
    for other in (arm, kind.make()):
        with pytest.raises(PlanFailed, match="begins in another state"):
            other.start(path)
    assert arm.mode is FOLLOW
    kind.judge([*sent, *steps(arm, 50)])


def test_where_an_arm_is_bound_for_is_the_end_of_its_path_or_its_target(kind):
    """While it follows one; else where a brake would take it."""
    arm = kind.make()
    assert arm.end_values() == kind.home
    arm.start(kind.path(arm, kind.goal))
    steps(arm, 20)
    assert arm.end_values() == arm.aim_values() == pytest.approx(kind.goal)
    arm.brake()
    assert arm.end_values() == arm.aim_values() == arm.rest_values() != kind.goal
    arm.follow(kind.goal)
    assert arm.aim_values() == pytest.approx(kind.goal) and arm.end_values() == arm.rest_values()


def test_braking_twice_is_braking_once(kind):
    """The second one does not begin anew; it ends where it was said."""
    once, twice = kind.make(), kind.make()
    for arm in (once, twice):
        arm.start(kind.path(arm, kind.goal))
        steps(arm, 30)
        arm.brake()
        assert arm.mode is BRAKE and arm.progress == 1.0
    rest = once.rest_values()
    for n in range(80):
        if n < 30:
            twice.brake()
        assert once.step() == twice.step()
    assert once.mode is twice.mode is HOLD and once.values == pytest.approx(rest, abs=1e-12)


def test_a_start_or_a_target_that_is_none_changes_nothing(kind):
    """Length, finiteness, limits and factor are checked before anything is done."""
    arm = kind.make()
    for bad in ((), kind.home[:6], (*kind.home[:6], math.nan), kind.outside):
        for ask in (arm.seed, arm.follow, lambda values, arm=arm: arm.enter(values, arm.rates, arm.forces)):
            with pytest.raises(PlanFailed):
                ask(bad)
    for speed in (0.0, 1.5, math.nan):
        with pytest.raises(PlanFailed, match="speed"):
            arm.follow(kind.goal, speed)
    with pytest.raises(PlanFailed):
        arm.enter(kind.home, kind.too_fast, arm.forces)
    assert arm.mode is HOLD and arm.is_at_rest and steps(arm, 2) == [kind.home] * 2


def test_a_fault_of_the_planner_never_leaves_a_step(kind, monkeypatch):
    """The reference brakes within its limits, and raises nothing."""
    arm = kind.make()
    arm.follow(kind.goal)
    sent = [kind.home, kind.home, *steps(arm, 30)]

    def fail(*_):
        raise NoPlan("error in step 1")

    monkeypatch.setattr(follower, "solve", fail)
    kind.judge(sent + steps(arm, 100))
    assert arm.is_at_rest and arm.mode is FOLLOW
    assert arm._follower.faults == 100


@pytest.mark.parametrize("stopped_after", [0, 1, 7, 20, 33, 60, 300])
def test_another_reference_goes_on_with_an_interrupted_motion_and_brakes(kind, stopped_after):
    """Entered with position, velocity and acceleration of its last setpoint: one continuous motion, to rest inside."""
    first, second = kind.make(), kind.make()
    first.start(kind.path(first, kind.goal))
    sent = [kind.home, kind.home, kind.home, *steps(first, stopped_after)]
    second.enter(first.values, first.rates, first.forces)
    assert second.state == first.state and second.mode is (HOLD if first.is_at_rest else BRAKE)
    kind.judge(sent + steps(second, 120))
    assert second.is_at_rest and second.mode is HOLD
    assert second.values == pytest.approx(first.rest_values(), abs=1e-12)


def test_a_trajectory_is_followed_to_rest_at_its_end(kind):
    """Progress rises from 0 to 1; then it is held."""
    arm = kind.make()
    tracker = track(arm, kind.swing())
    sent, seen = [kind.home] * 3, []
    assert arm.mode is CHUNK
    while arm.mode is CHUNK:
        sent += steps(arm, 1)
        seen.append(arm.progress)
    assert seen == sorted(seen) and 0.0 < seen[0] < 0.02 and seen[-1] == 1.0
    assert (arm.mode, arm.is_at_rest, arm.tracker) == (HOLD, True, tracker)
    assert arm.values == pytest.approx(kind.swing().points[-1], abs=1e-7)
    kind.judge([*sent, *steps(arm, 3)])


def test_a_trajectory_that_runs_out_leaves_the_arm_braking(kind):
    """In the very next setpoint, smoothly; what happened stays to be seen until something else is asked for."""
    arm = kind.make()
    tracker = track(arm, kind.swing(), rests=False)
    kind.judge([kind.home] * 3 + steps(arm, 250))
    assert arm.tracker is tracker and tracker.outcome is Outcome.UNDERRUN and arm.mode is HOLD
    arm.brake()
    assert arm.tracker is None


def test_a_trajectory_takes_over_from_any_motion_and_any_motion_from_it(kind):
    """From a path, a followed target, a brake and another trajectory, in mid-motion, each without a step."""
    arm = kind.make()
    arm.start(kind.path(arm, kind.goal))
    sent = [kind.home] * 3 + steps(arm, 15)
    track(arm, kind.swing(), rests=False)
    sent += steps(arm, 30)
    arm.follow(kind.goal, 0.5)
    sent += steps(arm, 10)
    track(arm, kind.swing(1.0))
    sent += steps(arm, 30)
    waiting = track(arm, kind.swing(0.9), -0.105)
    assert waiting.is_waiting and waiting.under_way is not None
    assert math.dist(arm.origin(waiting), arm.values) < 0.1
    sent += steps(arm, 40)
    arm.brake()
    sent += steps(arm, 2)
    again = track(arm, kind.swing(0.8), -0.305)
    assert again.under_way is None
    sent += steps(arm, 30)
    arm.start(kind.path(arm, kind.home))
    kind.judge(sent + steps(arm, 400))
    assert arm.values == pytest.approx(kind.home, abs=1e-9) and arm.tracker is None


def to_path(kind, arm):
    """Ask for a path."""
    arm.start(kind.path(arm, kind.goal))


def to_slow_stream(kind, arm):
    """Ask for a target at a fifth."""
    arm.follow(kind.goal, 0.2)


def to_home(kind, arm):
    """Ask for a target at home."""
    arm.follow(kind.home)


def to_rest(kind, arm):
    """Ask for a stop."""
    arm.brake()


@pytest.mark.parametrize("begin", [to_path, to_slow_stream, to_home])
def test_looking_ahead_changes_nothing_and_tells_what_comes(kind, begin):
    """Two arms that are asked for the same, one of which is looked at before each setpoint, twice."""
    seen, unseen = kind.make(), kind.make()
    for ask in (begin, None, to_rest, to_home, None):
        for arm in (seen, unseen):
            if ask is not None:
                ask(kind, arm)
        for _ in range(60):
            ahead = seen.ahead()
            assert seen.ahead() is ahead
            assert seen.step() == unseen.step() == ahead.values
            assert (seen.state, seen.mode) == (unseen.state, unseen.mode)


@pytest.mark.parametrize("rests", [True, False])
def test_looking_ahead_on_a_trajectory_changes_nothing(kind, rests):
    """Onto it, along it, and off its end or into its brake."""
    seen, unseen = kind.make(), kind.make()
    for arm in (seen, unseen):
        track(arm, kind.swing(), rests=rests)
    while unseen.mode is not HOLD:
        ahead = seen.ahead()
        assert seen.step() == unseen.step() == ahead.values
        assert (seen.state, seen.mode) == (unseen.state, unseen.mode)
    assert seen.tracker is not None and unseen.tracker is not None
    assert seen.tracker.outcome is unseen.tracker.outcome is (Outcome.DONE if rests else Outcome.UNDERRUN)


@pytest.mark.parametrize("ask", [to_path, to_rest, to_home])
def test_what_is_asked_for_after_a_look_ahead_counts(kind, ask):
    """The setpoint that was looked at is not taken."""
    looked, plain = kind.make(), kind.make()
    for arm in (looked, plain):
        to_slow_stream(kind, arm)
        steps(arm, 30)
    looked.ahead()
    for arm in (looked, plain):
        ask(kind, arm)
    assert looked.step() == plain.step()


def test_a_reference_that_stops_ahead_is_one_step_into_its_brake(kind):
    """Whatever moves it now; the reference itself goes on."""
    arm, braked = kind.make(), kind.make()
    for each in (arm, braked):
        each.follow(kind.goal)
        steps(each, 20)
    ahead = arm.stop_ahead()
    braked.brake()
    assert braked.step() == ahead.values and arm.mode is FOLLOW


# ------------------------------------------------------------------------------------------------ poses alone


def pose_go(arm, goal=Poses.goal, speed=1.0) -> None:
    """Begin a path of this arm alone."""
    arm.start(Poses.path(arm, goal, speed))


def test_braking_on_a_path_stays_on_its_line():
    """And ends at rest; a second brake changes nothing."""
    arm = posing()
    pose_go(arm)
    sent = [Poses.home, Poses.home, *steps(arm, 40)]
    rest = arm.rest_values()
    arm.brake()
    arm.brake()
    assert arm.mode is BRAKE
    while arm.mode is BRAKE:
        sent.append(arm.step())
    pose_judge.judge(sent, pose_judge.LIMITS)
    assert arm.values == rest
    for values in sent:
        assert math.dist(Poses.home[:3], values[:3]) + math.dist(values[:3], Poses.goal[:3]) == pytest.approx(
            0.2 * math.sqrt(2), abs=1e-9
        )
    arm.brake()
    assert arm.mode is HOLD


def test_a_followed_target_is_wished_for_and_may_be_bounded():
    """The wish is full speed towards it; with a bound it takes longer, on the same way to the same place."""
    steps = []
    for bound in (1.0, 0.3):
        arm = posing()
        arm.follow(Poses.goal)
        assert math.hypot(*arm.wish()[:3]) == pytest.approx(0.999 * pose_judge.LIMITS.v_mps)
        arm.bound(bound)
        steps.append(0)
        while arm.values != Poses.goal:
            arm.step()
            steps[-1] += 1
    assert steps[1] > 2 * steps[0]


def test_the_sign_of_the_quaternion_goes_on_whatever_a_course_gives():
    """A course may give either sign."""

    @dataclass
    class Flipping:
        start: State
        duration_s: float = 5 * Poses.dt

        def at(self, time_s):
            sign = -1.0 if round(time_s / Poses.dt) % 2 else 1.0
            return pose_judge.posed(Poses.home[:3], tuple(sign * c for c in Poses.home[3:]))

    arm = posing()
    arm.start(Flipping(arm.state))
    pose_judge.judge([Poses.home, *steps(arm, 8)], pose_judge.LIMITS)


@pytest.mark.parametrize("limits", [pose_judge.LIMITS, pose_judge.HARD, pose_judge.WEAK])
@pytest.mark.parametrize("after", [1, 5, 9, 11, 14, 20, 40])
def test_a_target_as_far_along_each_axis_leaves_room_to_brake(limits, after):
    """All axes accelerate at their shares; whoever brakes or begins a path then stays below the speed limit."""
    target = (0.10, -0.10, -0.40, *about((1.0, 1.0, 1.0), 1.5))
    for end in ("brake", "path"):
        arm = posing(limits)
        arm.follow(target)
        sent = [Poses.home] * 3 + steps(arm, after)
        arm.brake() if end == "brake" else pose_go(arm, Poses.home)
        sent += steps(arm, 400)
        assert arm.is_at_rest
        pose_judge.judge(sent, limits)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    limits=st.sampled_from((pose_judge.LIMITS, pose_judge.HARD, pose_judge.WEAK)),
    rate_hz=st.sampled_from((50.0, 70.0, 77.0)),
)
def test_whatever_is_asked_the_setpoints_keep_every_limit(seed, limits, rate_hz):
    """Paths, targets anywhere, brakes and takeovers at any moment: norms of three differences, reach and sign."""
    rng = random.Random(seed)
    period_s = 1.0 / rate_hz
    arm = posing(limits, period_s, pose_judge.any_pose(rng))
    sent = [arm.values] * 3

    def pose():
        return pose_judge.any_pose(rng) if rng.random() < 0.5 else pose_judge.even_pose(rng, arm.values)

    for _ in range(6):
        asked = rng.random()
        if asked < 0.35:
            pose_go(arm, pose(), rng.choice((1.0, 0.3)))
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
    pose_judge.judge(sent, limits, period_s)
