"""One arm's reference: one continuous motion within every limit, whatever is asked of it, in whatever order."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway import robot
from gateway.core.motion.joints import follower
from gateway.core.motion.joints.passage import Outcome
from gateway.core.motion.joints.solver import NoPlan
from gateway.core.motion.joints.trajectory import interpolate
from gateway.core.motion.motion import JointLimits, JointReference, PlanFailed, ReferenceMode, plan
from gateway.values import ARM_DOF, Side

DT = 0.01
LEFT, RIGHT = Side.LEFT, Side.RIGHT
HOME = robot.HOME_Q_RAD
LOWER, UPPER = robot.JOINT_LOWER_RAD, robot.JOINT_UPPER_RAD
DEFAULT = (1.0, 3.0, 20.0)
HARD = (robot.HARD_V_RADPS, robot.HARD_A_RADPS2, robot.HARD_J_RADPS3)
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


def at_home(index: int, value: float, side=LEFT) -> tuple[float, ...]:
    """The home position with one joint elsewhere."""
    return (*HOME[side][:index], value, *HOME[side][index + 1 :])


class Recorder:
    """Steps a reference and judges every setpoint it hands out."""

    def __init__(self, arm: JointReference):
        self.arm = arm
        self.setpoints = [arm.q_rad]

    def step(self, count=1):
        """Take steps, each judged on its own: inside the limits, and braking from it would end inside as well."""
        limits = self.arm.limits
        for _ in range(count):
            self.setpoints.append(self.arm.step())
            assert self.setpoints[-1] is self.arm.q_rad
            for q_rad in (self.arm.q_rad, self.arm.rest_q_rad()):
                joints = zip(q_rad, limits.lower_rad, limits.upper_rad, strict=True)
                assert all(lower <= q <= upper for q, lower, upper in joints)
        return self

    def until_rest(self, limit=4000):
        """Step until nothing moves."""
        for _ in range(limit):
            self.step()
            if self.arm.is_at_rest and self.arm.mode in (HOLD, FOLLOW):
                return self
        raise AssertionError(f"still moving after {limit} steps: {self.arm.mode}, {self.arm.dq_radps}")

    def check(self):
        """Judge the differences of all setpoints."""
        limits, dt = self.arm.limits, self.arm.period_s
        for n in range(ARM_DOF):
            q = [setpoint[n] for setpoint in self.setpoints]
            for bound in (limits.v_radps * dt, limits.a_radps2 * dt**2, limits.j_radps3 * dt**3):
                q = [y - x for x, y in pairwise(q)]
                assert max(map(abs, q), default=0.0) <= bound * (1 + TOLERANCE)
        return self


def go(arm: JointReference, goal, speed=1.0) -> None:
    """Follow a path of one arm."""
    arm.start(plan({LEFT: arm}, {LEFT: goal}, speed)[LEFT])


# --------------------------------------------------------------------------------------------------- hold, seed


def test_a_reference_holds_where_it_was_seeded():
    """The same setpoint again and again, at rest, with nothing pending."""
    arm = reference()
    assert Recorder(arm).step(5).setpoints == [HOME[LEFT]] * 6
    assert (arm.mode, arm.is_at_rest, arm.progress) == (HOLD, True, 1.0)
    assert (arm.dq_radps, arm.ddq_radps2, arm.rest_q_rad()) == (REST, REST, HOME[LEFT])
    assert (arm.is_limited, arm.last_fault, arm.faults) == (False, "", 0)


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
    assert (arm.q_rad, arm.mode, arm.is_at_rest, arm.progress) == (LOWER[LEFT], HOLD, True, 1.0)
    assert arm.step() == LOWER[LEFT]


def test_a_bad_seed_changes_nothing():
    """Length, finiteness and limits; also a hair outside: who seeds puts a start on its limit first."""
    arm = reference()
    for bad in ((), (0.3,) * 6, at_home(2, math.nan), at_home(3, 0.25 - 1e-9)):
        with pytest.raises(PlanFailed, match="start"):
            arm.seed(bad)
    assert arm.step() == HOME[LEFT]


# -------------------------------------------------------------------------------------------------------- paths


def test_a_path_is_followed_to_its_end_and_then_held():
    """Progress rises with each setpoint; the last one is the goal, at rest, in the period in which the path ends."""
    arm = reference()
    path = plan({LEFT: arm}, {LEFT: at_home(0, 1.0)})[LEFT]
    arm.start(path)
    assert (arm.mode, arm.progress) == (PATH, 0.0)
    steps = math.ceil(path.duration_s / DT)
    assert steps * DT > path.duration_s  # it ends inside a period
    record, parts = Recorder(arm), []
    for _ in range(steps - 1):
        record.step()
        parts.append(arm.progress)
    assert parts == sorted(set(parts)) and 0.0 < parts[0] and parts[-1] < 1.0
    assert arm.mode is PATH
    record.step()
    assert (arm.mode, arm.progress, arm.q_rad, arm.is_at_rest) == (HOLD, 1.0, at_home(0, 1.0), True)
    record.step(5).check()
    assert record.setpoints[-5:] == [at_home(0, 1.0)] * 5


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
        assert arms[side].q_rad == pytest.approx(goals[side], abs=3e-8)
    assert ends[LEFT] == ends[RIGHT]


def test_a_path_to_where_the_arm_is_has_ended_at_once():
    """No error, no motion, and nothing pending."""
    arm = reference()
    go(arm, HOME[LEFT])
    assert (arm.mode, arm.progress, arm.step()) == (HOLD, 1.0, HOME[LEFT])


def test_only_a_path_from_the_present_state_is_followed():
    """A path that was planned before the last setpoint would be a jump; nothing changes."""
    arm = reference()
    arm.follow(UPPER[LEFT])
    record = Recorder(arm).step(20)
    path = plan({LEFT: arm}, {LEFT: HOME[LEFT]})[LEFT]
    record.step()
    with pytest.raises(PlanFailed, match="begins in another state"):
        arm.start(path)
    with pytest.raises(PlanFailed, match="begins in another state"):
        reference().start(path)
    assert arm.mode is FOLLOW
    record.step(50).check()


def test_planning_moves_nothing():
    """A plan that is not started has no effect."""
    arm = reference()
    plan({LEFT: arm}, {LEFT: UPPER[LEFT]})
    assert (arm.mode, arm.step()) == (HOLD, HOME[LEFT])


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
    assert arm.q_rad == goal


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
        rest_rad = arm.rest_q_rad()
        arm.brake()
        assert arm.mode is BRAKE and arm.progress == 1.0
        steps = len(record.setpoints)
        record.until_rest()
        assert len(record.setpoints) - steps <= math.ceil((v / a + 2.5 * a / j) / DT)
        assert arm.q_rad == pytest.approx(rest_rad, abs=1e-12)
        assert record.step(3).setpoints[-3:] == [arm.q_rad] * 3
        record.check()


def test_braking_twice_is_braking_once():
    """The second one does not begin anew."""
    once, twice = reference(), reference()
    for arm in (once, twice):
        go(arm, UPPER[LEFT])
        Recorder(arm).step(50)
        arm.brake()
    for n in range(80):
        if n < 30:
            twice.brake()
        assert once.step() == twice.step()
    assert once.mode is twice.mode is HOLD


# ------------------------------------------------------------------------------------------------------- streams


def test_the_first_setpoint_of_a_stream_is_near_and_the_mode_stays_when_it_has_arrived():
    """A stream is open until something else is asked for."""
    arm = reference()
    arm.follow(at_home(0, 0.5))
    record = Recorder(arm).step()
    assert abs(arm.q_rad[0] - 0.41) < 1e-5
    record.step(100).check()
    assert (arm.mode, arm.q_rad, arm.is_at_rest, arm.progress) == (FOLLOW, at_home(0, 0.5), True, 1.0)


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
    assert arm.q_rad == at_home(0, 1.0)


def test_a_bad_first_target_does_not_begin_a_stream():
    """The mode is as it was."""
    arm = reference()
    with pytest.raises(PlanFailed):
        arm.follow(at_home(3, 0.2))
    with pytest.raises(PlanFailed):
        arm.follow(HOME[LEFT], 2.0)
    assert arm.mode is HOLD


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
    assert arm.faults == 0


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
    assert arm.q_rad == UPPER[LEFT]


@pytest.mark.parametrize("speed", [0.01, 0.1, 0.6])
def test_a_lower_speed_in_mid_motion_slows_down_first(speed):
    """In a stream and in a path: within all limits, at the lower velocity in the end, and without overshooting."""
    for other in (lambda arm: arm.follow(at_home(0, 1.5), speed), lambda arm: go(arm, at_home(0, 1.5), speed)):
        arm = reference()
        arm.seed(at_home(0, -1.0))
        arm.follow(at_home(0, 1.5))
        record = Recorder(arm).step(90)
        assert arm.dq_radps[0] == pytest.approx(1.0)
        other(arm)
        record.step(60)
        assert arm.dq_radps[0] <= speed * (1 + TOLERANCE)
        record.until_rest(30_000).check()
        assert max(setpoint[0] for setpoint in record.setpoints) <= 1.5 + 1e-7
        assert arm.q_rad[0] == pytest.approx(1.5, abs=3e-8)


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


def test_a_fault_of_the_planner_never_leaves_a_step(monkeypatch):
    """The reference brakes within its limits, says why, and raises nothing."""
    arm = reference()
    arm.follow(UPPER[LEFT])
    record = Recorder(arm).step(40)

    def fail(*_):
        raise NoPlan("error in step 1")

    monkeypatch.setattr(follower, "solve", fail)
    record.step(100).check()
    assert arm.is_at_rest and arm.mode is FOLLOW
    assert (arm.last_fault, arm.faults) == ("error in step 1", 100)


# ---------------------------------------------------------------------------------------------------- replacing


def to_path(arm):
    """Ask for a path across the range."""
    go(arm, LOWER[LEFT])


def to_slow_path(arm):
    """Ask for a path at a tenth."""
    go(arm, at_home(4, -1.0), 0.1)


def to_stream(arm):
    """Ask for a target across the range."""
    arm.follow(LOWER[LEFT])


def to_slow_stream(arm):
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
@pytest.mark.parametrize("second", [to_path, to_slow_path, to_stream, to_slow_stream, to_brake])
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
        to_path(arm)
        record.until_rest().check()
        assert arm.q_rad == pytest.approx(LOWER[LEFT], abs=3e-8)


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
            ranges = zip(LOWER[side], UPPER[side], arms[side].q_rad, strict=True)
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
        rest_rad = arm.rest_q_rad()
        arm.brake()
        records[side].until_rest().check()
        assert arm.mode is HOLD and arm.faults == 0
        assert arm.q_rad == pytest.approx(rest_rad, abs=1e-12)


@pytest.mark.parametrize("stopped_after", [1, 7, 20, 33, 60, 200])
def test_another_reference_goes_on_with_an_interrupted_motion_and_brakes(stopped_after):
    """Entered with position, velocity and acceleration of its last setpoint: one continuous motion, to rest inside."""
    first = reference()
    recorder = Recorder(first)
    first.start(plan({LEFT: first}, {LEFT: at_home(1, HOME[LEFT][1] - 0.5)})[LEFT])
    recorder.step(stopped_after)
    second = reference()
    second.enter(first.q_rad, first.dq_radps, first.ddq_radps2)
    assert (second.q_rad, second.dq_radps, second.ddq_radps2) == (first.q_rad, first.dq_radps, first.ddq_radps2)
    assert second.mode is (HOLD if first.is_at_rest else BRAKE)
    recorder.arm = second
    recorder.step(120)
    assert second.is_at_rest and second.mode is HOLD
    v, a, j = DEFAULT
    for order, bound in ((1, v * DT), (2, a * DT**2), (3, j * DT**3)):
        rows = [list(q_rad) for q_rad in recorder.setpoints]
        for _ in range(order):
            rows = [[b - a for a, b in zip(x, y, strict=True)] for x, y in pairwise(rows)]
        assert max(abs(x) for row in rows for x in row) <= bound * (1 + 1e-3) + 1e-12


def test_a_state_that_cannot_be_entered_changes_nothing():
    """Too fast to be one of our setpoints."""
    arm = reference()
    with pytest.raises(PlanFailed, match="too fast"):
        arm.enter(HOME[LEFT], (2.0,) * ARM_DOF, REST)
    assert (arm.q_rad, arm.is_at_rest) == (HOME[LEFT], True)


# --------------------------------------------------------------------------------------------------- trajectories


def swing(count=40, size=0.1, rate=1.5):
    """A smooth swing of two joints from home."""
    points = [at_home(2, HOME[LEFT][2] + size * (1.0 - math.cos(rate * n / 30))) for n in range(count)]
    return interpolate(points, [n / 30 for n in range(count)])


def track(arm: JointReference, trajectory, start_s=0.0, *, rests=True):
    """Follow a trajectory that can be joined."""
    passage = arm.prepare(trajectory, start_s, rests=rests)
    assert arm.begin(passage) and (passage.is_waiting or arm.origin(passage) == arm.q_rad)
    arm.track(passage)
    return passage


def test_a_trajectory_is_followed_to_rest_at_its_end():
    """Progress rises from 0 to 1; then it is held."""
    arm = reference()
    passage = track(arm, swing())
    recorder = Recorder(arm)
    assert arm.mode is CHUNK
    seen = []
    while arm.mode is CHUNK:
        recorder.step()
        seen.append(arm.progress)
    assert seen == sorted(seen) and 0.0 < seen[0] < 0.02 and seen[-1] == 1.0
    assert (arm.mode, arm.is_at_rest, arm.passage) == (HOLD, True, passage)
    assert arm.q_rad == pytest.approx(swing().points[-1], abs=1e-7)
    recorder.step(3).check()


def test_a_trajectory_that_runs_out_leaves_the_arm_braking():
    """In the very next setpoint, smoothly; what happened stays to be seen until something else is asked for."""
    arm = reference()
    passage = track(arm, swing(), rests=False)
    recorder = Recorder(arm).step(160)
    recorder.until_rest().check()
    assert arm.passage is passage and passage.outcome is Outcome.UNDERRUN and arm.mode is HOLD
    arm.brake()
    assert arm.passage is None


def test_a_trajectory_takes_over_from_any_motion_and_any_motion_from_it():
    """From a path, a followed target, a brake and another trajectory, in mid-motion, each without a step."""
    arm = reference()
    recorder = Recorder(arm)
    go(arm, at_home(2, 0.4))
    recorder.step(15)
    track(arm, swing(), rests=False)
    recorder.step(30)
    arm.follow(at_home(2, 0.1))
    recorder.step(10)
    track(arm, swing(size=0.12))
    recorder.step(30)
    waiting = track(arm, swing(size=0.09), -0.1)
    assert waiting.is_waiting and waiting.under_way is not None
    recorder.step(40)
    arm.brake()
    recorder.step(2)
    again = track(arm, swing(size=0.08), -0.3)
    assert again.under_way is None
    recorder.step(30)
    go(arm, HOME[LEFT])
    recorder.until_rest().check()
    assert arm.q_rad == HOME[LEFT]


def test_setpoint_and_velocity_have_the_names_that_they_have_in_every_space():
    """So that a stream need not know what it streams."""
    arm = reference()
    arm.follow(at_home(0, 1.0))
    for _ in range(5):
        arm.step()
    assert (arm.values, arm.rates, arm.forces) == (arm.q_rad, arm.dq_radps, arm.ddq_radps2)


# ------------------------------------------------------------------------------------------------ looked at before it is taken


@pytest.mark.parametrize("begin", [to_path, to_slow_path, to_stream, to_slow_stream, to_upper, to_upper_stream])
def test_looking_ahead_changes_nothing_and_tells_what_comes(begin):
    """Two arms that are asked for the same, one of which is looked at before each setpoint, twice."""
    seen, unseen = reference(), reference()
    for ask in (begin, None, to_brake, to_stream, None):
        for arm in (seen, unseen):
            if ask is not None:
                ask(arm)
        for _ in range(60):
            ahead = seen.ahead()
            assert seen.ahead() is ahead
            assert seen.step() == unseen.step() == ahead[0]
            assert (seen.place, seen.mode) == (unseen.place, unseen.mode)


@pytest.mark.parametrize("rests", [True, False])
def test_looking_ahead_on_a_trajectory_changes_nothing(rests):
    """Onto it, along it, and off its end or into its brake."""
    seen, unseen = reference(), reference()
    for arm in (seen, unseen):
        track(arm, swing(), rests=rests)
    while unseen.mode is not HOLD:
        ahead = seen.ahead()
        assert seen.step() == unseen.step() == ahead[0]
        assert (seen.place, seen.mode) == (unseen.place, unseen.mode)
    assert seen.passage is not None and unseen.passage is not None
    assert seen.passage.outcome is unseen.passage.outcome is (Outcome.DONE if rests else Outcome.UNDERRUN)


@pytest.mark.parametrize("ask", [to_path, to_brake, to_stream, to_upper_stream])
def test_what_is_asked_for_after_a_look_ahead_counts(ask):
    """The setpoint that was looked at is not taken."""
    looked, plain = reference(), reference()
    for arm in (looked, plain):
        to_slow_stream(arm)
        for _ in range(30):
            arm.step()
    looked.ahead()
    for arm in (looked, plain):
        ask(arm)
    assert looked.step() == plain.step()


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
            mixed = [
                tuple(w if go else s for w, s, go in zip(*rows, goes, strict=True))
                for rows in zip(wanted, stop, strict=True)
            ]
            arm.lead(tuple(mixed))
            recorder.step()
            assert arm.place == tuple(mixed) and arm.mode is FOLLOW
    recorder.until_rest().check()
    assert arm.q_rad == at_home(1, 0.5)


def test_a_bound_of_a_stream_holds_beside_its_own_factor_until_the_next_stream():
    """The lower of both counts; a bound in mid-motion slows down inside the limits."""
    arm = reference()
    recorder = Recorder(arm)
    arm.follow(at_home(3, 2.0), 0.8)
    recorder.step(60)
    assert max(map(abs, arm.dq_radps)) == pytest.approx(0.8)
    arm.bound(0.1)
    recorder.step(60)
    assert max(map(abs, arm.dq_radps)) == pytest.approx(0.1)
    arm.follow(at_home(3, 2.1), 0.9)
    recorder.step(10)
    assert max(map(abs, arm.dq_radps)) == pytest.approx(0.1)
    arm.bound(1.0)
    recorder.step(50)
    assert max(map(abs, arm.dq_radps)) == pytest.approx(0.9)
    arm.bound(0.1)
    arm.brake()
    recorder.until_rest().check()
    arm.follow(HOME[LEFT], 0.8)
    recorder.step(60).check()
    assert max(map(abs, arm.dq_radps)) == pytest.approx(0.8)


def test_where_an_arm_is_bound_for_is_the_end_of_its_path():
    """While it follows one; else where a brake would take it."""
    arm = reference()
    assert arm.end_q_rad() == HOME[LEFT]
    goal = at_home(1, HOME[LEFT][1] - 0.3)
    arm.start(plan({LEFT: arm}, {LEFT: goal})[LEFT])
    for _ in range(20):
        arm.step()
    assert arm.end_q_rad() == arm.aim_q_rad() == pytest.approx(goal)
    arm.brake()
    assert arm.end_q_rad() == arm.aim_q_rad() == arm.rest_q_rad() != goal
    target = at_home(2, 0.1)
    arm.follow(target)
    assert arm.aim_q_rad() == target and arm.end_q_rad() == arm.rest_q_rad()
