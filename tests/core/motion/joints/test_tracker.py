"""One arm onto a trajectory, along it and off its end: continuous, inside every limit, stoppable at each setpoint."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import pytest

from gateway.core.motion.joints import tracker
from gateway.core.motion.joints.braking import REST, Braking, JointLimits
from gateway.core.motion.joints.tracker import JointTracker
from gateway.core.motion.joints.trajectory import interpolate
from gateway.core.motion.solver import NoPlan
from gateway.core.motion.space import State
from gateway.core.motion.tracker import Outcome
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import ARM_DOF, Side

DT = 0.01
HOME = HOME_Q_RAD[Side.LEFT]
LIMITS = JointLimits(
    v_radps=1.0,
    a_radps2=3.0,
    j_radps3=20.0,
    lower_rad=JOINT_LOWER_RAD[Side.LEFT],
    upper_rad=JOINT_UPPER_RAD[Side.LEFT],
)
BRAKING = Braking(LIMITS, DT)
AT_HOME = State(HOME, REST, REST)
TOLERANCE = 1e-6


def wave(rate=1.5, count=60, dt_s=1 / 30, size=0.15, phase_s=0.0, joints=(0, 2, 4), base=HOME):
    """A smooth swing of some joints, beginning at `base` when the phase is 0."""
    swings = [size * (1.0 - math.cos(rate * (n * dt_s + phase_s))) for n in range(count)]
    points = [tuple(q + (s if n in joints else 0.0) for n, q in enumerate(base)) for s in swings]
    return interpolate(points, [n * dt_s for n in range(count)])


def way(trajectory, start_s=0.0, *, rests=True, lead=None):
    """A way along a trajectory with the usual brakes."""
    return JointTracker(BRAKING, trajectory, start_s, rests=rests, lead=lead)


class Walker:
    """Takes the steps of one way after the other, brakes where there is none, and judges every setpoint."""

    def __init__(self, state=AT_HOME):
        self.state = state
        self.states = [state]

    def step(self, course, count=1):
        """Take steps; return whether the way went on."""
        for _ in range(count):
            state = course.step(self.state)
            if state is None:
                return False
            self.take(state)
        return True

    def take(self, state):
        """Judge a state: seven joints, and each can stop inside its limits."""
        assert all(len(row) == ARM_DOF for row in state)
        assert all(map(BRAKING.can_stop, range(ARM_DOF), *state))
        self.state = state
        self.states.append(state)

    def until_end(self, course, limit=1000):
        """Step until the way has ended; return how."""
        for _ in range(limit):
            if not self.step(course) or course.outcome is not None:
                return course.outcome
        raise AssertionError(f"still under way at {course.time_s} s")

    def check(self):
        """Judge the differences of all setpoints."""
        for n in range(ARM_DOF):
            q = [state[0][n] for state in self.states]
            for bound in (LIMITS.v_radps * DT, LIMITS.a_radps2 * DT**2, LIMITS.j_radps3 * DT**3):
                q = [y - x for x, y in pairwise(q)]
                assert max(map(abs, q), default=0.0) <= bound * (1 + TOLERANCE)


# --------------------------------------------------------------------------------------------------- onto and along it


def test_an_arm_at_rest_joins_a_moving_trajectory_and_is_then_exactly_on_it():
    """Within some tenths of a second; from then on every setpoint is the trajectory's at its time."""
    trajectory = wave(phase_s=0.4, base=tuple(q - 0.02 for q in HOME))
    course, walker = way(trajectory), Walker()
    assert course.begin(walker.state)
    while not course.has_joined:
        assert walker.step(course) and course.time_s < 0.8
    assert 0.1 < course.time_s
    for _ in range(40):
        walker.step(course)
        assert walker.state == trajectory.at(course.time_s)
    walker.check()


def test_it_ends_at_rest_at_the_last_point():
    """Also where the points end at speed: it brakes in time, and comes to rest there a little later."""
    for trajectory in (wave(), wave(rate=math.pi / (59 / 30), size=0.1)):
        course, walker = way(trajectory), Walker()
        assert course.begin(walker.state)
        assert walker.until_end(course) is Outcome.DONE
        assert walker.state[1:] == (REST, REST)
        assert walker.state[0] == pytest.approx(trajectory.points[-1], abs=2e-8)
        assert trajectory.duration_s - 0.02 <= course.time_s <= trajectory.duration_s + 0.25
        assert course.progress == 1.0 and walker.step(course) and walker.state == walker.states[-2]
        walker.check()


def test_without_a_successor_an_open_end_leaves_the_arm_to_its_brakes():
    """UNDERRUN when the points are over; until then it is on them, at speed."""
    trajectory = wave(rate=1.0)
    course, walker = way(trajectory, rests=False), Walker()
    assert course.begin(walker.state) and course.is_sound
    assert walker.until_end(course) is Outcome.UNDERRUN
    assert abs(course.time_s - trajectory.duration_s) <= DT and max(walker.state[1]) > 0.1
    assert course.step(walker.state) is None
    walker.check()


def test_far_from_all_limits_nothing_is_looked_at_twice():
    """In the middle of every joint's range."""
    middle = tuple((low + high) / 2 for low, high in zip(LIMITS.lower_rad, LIMITS.upper_rad, strict=True))
    walker, course = Walker(State(middle, REST, REST)), way(wave(size=0.05, base=middle))
    assert course.begin(walker.state) and walker.until_end(course) is Outcome.DONE
    walker.check()


# --------------------------------------------------------------------------------------------------- replacement


def test_a_chunk_is_replaced_by_the_next_in_mid_motion_without_a_stop():
    """Five times a second, each beginning 0.3 s before it arrives, a little beside the last: no limit, no reversal."""
    rng = random.Random(5)
    walker = Walker()
    for n in range(30):
        shifted = tuple(q + rng.uniform(-0.004, 0.004) for q in HOME)
        age_s = 0.3 if n > 2 else 0.0
        trajectory = wave(rate=1.0, count=30, phase_s=max(0.2 * n - age_s, 0.0), size=0.3, base=shifted)
        course = way(trajectory, age_s, rests=False)
        assert course.begin(walker.state)
        assert walker.step(course, 20)
    walker.check()
    speeds = [state[1][0] for state in walker.states[60:250]]
    assert min(speeds) > 0.05


def test_before_a_start_in_the_future_the_arm_goes_on_with_the_chunk_under_way():
    """And changes over when it begins; the position then is foreseen."""
    first = way(wave(1.0), 0.0, rests=False)
    walker = Walker()
    assert first.begin(walker.state) and walker.step(first, 50)
    second = way(wave(1.0, phase_s=0.8, base=tuple(q + 0.005 for q in HOME)), -0.3, lead=first)
    assert second.is_waiting and second.under_way is first
    expected = second.origin(walker.state[0], HOME)
    assert walker.step(second, 30) and not second.is_waiting
    assert walker.state[0] == pytest.approx(expected, abs=1e-9)
    assert walker.until_end(second) is Outcome.DONE
    assert second.under_way is second
    walker.check()


def test_an_arm_that_waits_and_follows_nothing_brakes_and_rests():
    """From whatever it did; so does one whose chunk runs out while the next one waits."""
    walker = Walker()
    first = way(wave(1.0, count=20), 0.0, rests=False)
    assert first.begin(walker.state) and walker.step(first, 40)
    moving = walker.state
    alone = way(wave(1.0), -1.0)
    assert alone.under_way is None and alone.origin(moving[0], HOME) == HOME
    assert walker.step(alone, 95) and walker.state[1:] == (REST, REST)
    walker.check()

    walker = Walker(moving)
    waits = way(wave(1.0, phase_s=0.8), -1.2, lead=first)
    assert walker.step(waits, 110) and walker.state[1:] == (REST, REST) and waits.under_way is None
    walker.check()


# --------------------------------------------------------------------------------------------------- where there is none


def test_a_trajectory_that_runs_away_cannot_be_joined():
    """At the velocity limit all the way: an arm at rest never catches up; an open end is as bad as a rest far away."""
    points = [(HOME[0] - 1.5 + 0.0999 * n, *HOME[1:]) for n in range(28)]
    trajectory = interpolate(points, [0.1 * n for n in range(28)])
    for rests in (True, False):
        course = way(trajectory, rests=rests)
        assert not course.begin(State((points[0][0], *HOME[1:]), REST, REST))
        assert course.outcome is Outcome.LOST and course.step(AT_HOME) is None


def test_what_is_left_may_be_too_short_to_join():
    """0.1 s at speed: an open end is lost; one that rests goes to its last point directly."""
    trajectory = wave(rate=1.0, phase_s=0.5, base=tuple(q - 0.06 for q in HOME))
    late_s = trajectory.duration_s - 0.1
    assert not way(trajectory, late_s, rests=False).begin(AT_HOME)
    walker, course = Walker(), way(trajectory, late_s)
    assert course.begin(walker.state) and walker.until_end(course) is Outcome.DONE
    assert walker.state[0] == pytest.approx(trajectory.points[-1], abs=2e-8)
    walker.check()


def test_an_open_end_from_which_no_brake_could_stay_inside_is_unsound():
    """At speed beside a position limit; one that rests is sound."""
    top = LIMITS.upper_rad[6]
    points = [(*HOME[:6], top - 0.3 + 0.01 * n) for n in range(30)]
    trajectory = interpolate(points, [n / 30 for n in range(30)])
    assert not way(trajectory, rests=False).is_sound and way(trajectory).is_sound


def beside_a_limit(rate=4.0, depth=1e-4):
    """A swing that turns sharply just inside joint 7's upper limit: no brake is as quick as the turn."""
    top = LIMITS.upper_rad[6] - depth
    size = 2.9 / rate**2
    count, dt_s = 60, 1 / 60
    points = [(*HOME[:6], top - size * (1 - math.cos(rate * (n * dt_s - 0.7)))) for n in range(count)]
    return interpolate(points, [n * dt_s for n in range(count)])


def test_where_a_trajectory_could_not_be_stopped_the_arm_leaves_it():
    """It is inside all limits itself, but the arm would brake beyond one: lost, or straight to the end when it is near."""
    trajectory = beside_a_limit()
    assert max(trajectory.high[6]) <= LIMITS.upper_rad[6]
    walker = Walker(State(*trajectory.at(0.0)))
    course = way(trajectory, rests=False)
    assert course.begin(walker.state)
    assert walker.until_end(course) is Outcome.LOST and course.has_joined and course.time_s < 0.8
    walker.check()
    walker = Walker(walker.states[0])
    course = way(trajectory)
    assert course.begin(walker.state) and walker.until_end(course) is Outcome.DONE
    walker.check()


def test_a_join_that_would_not_be_stoppable_is_none():
    """Another one, or none, is taken; every setpoint is judged by the walker."""
    for depth in (1e-4, 3e-3, 0.02):
        for begin_s in (0.0, 0.2, 0.4):
            trajectory = beside_a_limit(depth=depth)
            start = tuple(q - (0.03 if n == 6 else 0.0) for n, q in enumerate(trajectory.at(begin_s)[0]))
            walker, course = Walker(State(start, REST, REST)), way(trajectory, begin_s)
            assert course.begin(walker.state)
            walker.until_end(course)
            walker.check()


def test_closing_beyond_a_limit_is_a_stop_first_and_then_the_rest():
    """At speed towards a limit, the goal just behind: stop, then come back."""
    top = LIMITS.upper_rad[6]
    moving = State((*HOME[:6], top - 0.2), (0.0,) * 6 + (0.55,), REST)
    assert BRAKING.can_stop(6, moving[0][6], 0.55, 0.0)
    points = [(*HOME[:6], top - 0.11 - 0.001 * n) for n in range(5)]
    trajectory = interpolate(points, [0.05 * n for n in range(5)])
    walker, course = Walker(moving), way(trajectory, 0.15)
    assert course.begin(walker.state) and walker.until_end(course) is Outcome.DONE
    assert walker.state[0][6] == pytest.approx(top - 0.114, abs=2e-8)
    walker.check()


def test_where_ruckig_finds_no_plan_the_arm_stops(monkeypatch):
    """No join means refused at the beginning; no way to the end means a stop, and trying again from rest."""

    def none(*_):
        raise NoPlan("no")

    monkeypatch.setattr(tracker, "solve", none)
    assert not way(wave(), rests=False).begin(AT_HOME)
    course, walker = way(wave(), 1.5), Walker()
    assert course.begin(walker.state) and walker.step(course, 30) and walker.state == AT_HOME
    monkeypatch.undo()
    assert walker.until_end(course) is Outcome.DONE
    monkeypatch.setattr(tracker, "JOIN_STEPS", 5)
    far = State((HOME[0] + 0.09, *HOME[1:]), (0.3,) + (0.0,) * 6, REST)
    course, walker = way(wave(rate=0.1), 1.9), Walker(far)
    assert course.begin(walker.state) and walker.until_end(course) is Outcome.DONE
    walker.check()


def test_a_plan_that_misses_its_meeting_point_is_not_taken(monkeypatch):
    """Ruckig may end 1e-8 rad beside its target: the next later meeting is tried, within a number of attempts."""
    assert way(wave(), rests=False).begin(AT_HOME)
    monkeypatch.setattr(tracker, "MISS_RAD", -1.0)
    monkeypatch.setattr(BRAKING, "tiny_rad", -1.0)
    assert not way(wave(), rests=False).begin(AT_HOME)
    walker, late = Walker(), way(wave(rate=0.1), 1.9)
    assert late.begin(walker.state) and walker.step(late, 10) and walker.state == AT_HOME


@pytest.mark.parametrize("seed", range(12))
def test_random_chunks_from_random_motions_keep_every_limit(seed):
    """Whatever replaces whatever, wherever it begins, at each setpoint."""
    rng = random.Random(seed)
    walker, course = Walker(), None
    for _ in range(12):
        joints = rng.sample(range(7), 3)
        trajectory = wave(
            rng.uniform(0.3, 2.0), rng.randint(4, 40), rng.choice([0.02, 1 / 30, 0.1]), rng.uniform(-0.1, 0.1),
            rng.uniform(0.0, 3.0), joints, tuple(q + rng.uniform(-0.03, 0.03) for q in walker.state[0]),
        )  # fmt: skip
        start_s = rng.choice([0.0, -0.2, rng.uniform(0.0, trajectory.duration_s)])
        another = way(trajectory, start_s, rests=rng.random() < 0.5, lead=course)
        if not another.is_waiting and not another.begin(walker.state):
            continue
        course = another.under_way if another.is_waiting else another
        if not walker.step(another, rng.randint(1, 60)) or another.outcome is not None:
            stop = BRAKING.halt(walker.state)
            for n in range(1, math.ceil(stop.duration_s / DT) + 1):
                walker.take(stop.at(n * DT))
            course = None
        else:
            course = another.under_way
    walker.check()
