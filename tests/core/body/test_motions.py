"""Motions: accepted, sent, and ended exactly once, by what is measured."""

from __future__ import annotations

import pytest

from gateway.core.body.motions import ENDED_KEPT, Motion, MotionBook, MotionState, Terms
from gateway.core.motion.gap import Gap
from gateway.core.motion.tolerance import Tolerances
from gateway.errors import Code
from gateway.messages.snapshot import MotionView
from gateway.robot.limits import HOME_Q_RAD
from gateway.settings.settings import ArmSettings, PoseSettings
from gateway.values import Side, Space, Vector

MS = 1_000_000
S = 1_000_000_000
T0 = 1_000 * S
L, R = Side.LEFT, Side.RIGHT
HOME = HOME_Q_RAD
BOTH = dict(HOME)
SETTINGS = ArmSettings()


def off(side: Side, error_rad: float, joint: int = 3) -> Vector:
    """The goal of an arm, one joint off by so much."""
    return tuple(q + error_rad * (n == joint) for n, q in enumerate(HOME[side]))


@pytest.fixture
def book() -> MotionBook:
    """No motion yet."""
    return MotionBook(SETTINGS)


class Course:
    """One motion, looked at every 10 ms from T0 on.

    Attributes:
        motion: The motion.
        now_ns: Monotonic time of the next look [ns].
    """

    def __init__(self, book: MotionBook, *sides: Side, tolerance_rad: float | None = None) -> None:
        self.book = book
        self.motion = book.open(
            {side: HOME[side] for side in sides or (L,)}, tolerance_rad and Gap(tolerance_rad), 2 * S
        )
        self.now_ns = T0

    def look(self, progress: float, *errors_rad: float | None, seconds: float = 0.01) -> Motion:
        """Report progress and errors of its arms for a while."""
        sides = tuple(self.motion.goals)
        errors = dict(zip(sides, errors_rad or (0.0,) * len(sides), strict=True))
        measured = {side: None if error is None else off(side, error) for side, error in errors.items()}
        until_ns = self.now_ns + round(seconds * S)
        while self.now_ns < until_ns and self.motion.is_running:
            self.book.advance(self.motion, dict.fromkeys(sides, progress), measured, self.now_ns)
            self.now_ns += 10 * MS
        return self.motion


# ------------------------------------------------------------------------------------------------ the book


def test_ids_rise_and_are_never_given_twice(book):
    """Also over the end of a motion: an id names one motion for the life of the daemon."""
    first = book.open({L: HOME[L]}, None, S)
    second = book.open({R: HOME[R]}, None, S)
    book.end(first, MotionState.CANCELLED, Code.CANCELLED, "")
    third = book.open({L: HOME[L]}, None, S)
    assert (first.motion_id, second.motion_id, third.motion_id) == (1, 2, 3)


def test_a_motion_belongs_to_each_of_its_arms_while_it_runs(book):
    """One running motion per arm; a motion of two arms is one motion."""
    assert (book.of(L), book.of(R), book.running, book.views()) == (None, None, (), ())
    both = book.open(BOTH, None, S)
    assert book.of(L) is book.of(R) is both and book.running == (both,)
    book.end(both, MotionState.ABORTED, Code.PART_LOST, "gone")
    left, right = book.open({L: HOME[L]}, None, S), book.open({R: HOME[R]}, None, S)
    assert (book.of(L), book.of(R), book.running) == (left, right, (left, right))


def test_the_goals_are_the_motions_own():
    """What the caller does with his dictionary later changes no motion."""
    goals = dict(HOME)
    motion = MotionBook(SETTINGS).open(goals, None, S)
    goals.clear()
    assert motion.goals == HOME


@pytest.mark.parametrize(("asked", "used"), [(None, 0.05), (0.01, 0.01)])
def test_the_tolerance_is_the_one_asked_for_or_the_configured_one(book, asked, used):
    """Manual §6.6: 0.05 rad; tighter on request."""
    assert book.open(BOTH, None if asked is None else Gap(asked), S).tolerance == Gap(used)


def test_a_motion_ends_once(book):
    """Whatever comes later, its end stays as it was told."""
    motion = book.open(BOTH, None, S)
    assert motion.is_running
    book.end(motion, MotionState.CANCELLED, Code.CANCELLED, "by the owner")
    book.end(motion, MotionState.ABORTED, Code.ESTOP, "later")
    assert (motion.state, motion.code, motion.message) == (MotionState.CANCELLED, Code.CANCELLED, "by the owner")
    assert not motion.is_running and book.running == () and book.find(1) is motion


def test_ended_motions_stay_visible_until_others_take_their_place(book):
    """A client that asks late still learns how its motion ended; memory stays bounded."""
    for _ in range(ENDED_KEPT + 2):
        book.end(book.open({L: HOME[L]}, None, S), MotionState.REACHED, None, "")
    running = book.open({R: HOME[R]}, None, S)
    assert (book.find(1), book.find(2)) == (None, None)
    kept = [view.motion_id for view in book.views()]
    assert kept == list(range(3, ENDED_KEPT + 4)) and kept[-1] == running.motion_id
    assert all(book.find(motion_id) is not None for motion_id in kept)


def test_the_views_stand_in_the_order_of_acceptance(book):
    """Oldest first, whichever ended first."""
    first, second = book.open({L: HOME[L]}, None, S), book.open({R: HOME[R]}, None, S)
    book.end(second, MotionState.CANCELLED, Code.CANCELLED, "")
    assert [view.motion_id for view in book.views()] == [first.motion_id, second.motion_id]


def test_a_view_tells_the_whole_motion(book):
    """In words and numbers that any encoder can write."""
    motion = book.open(BOTH, None, 2 * S)
    assert motion.view() == MotionView(
        motion_id=1, sides=("left", "right"), state="queued", progress=0.0, error_rad=None, duration_ns=2 * S,
        code="", message="", space="joint", error_m=None,
    )  # fmt: skip
    book.end(motion, MotionState.ABORTED, Code.PART_LOST, "the left arm")
    assert (motion.view().state, motion.view().code, motion.view().message) == (
        "aborted", "PART_LOST", "the left arm",
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------ on its way


def test_a_motion_is_queued_until_its_first_setpoint_has_left(book):
    """Accepted is not yet sent: with no progress on its path it waits."""
    course = Course(book)
    assert course.look(0.0, 0.4).state is MotionState.QUEUED
    assert course.look(0.01, 0.4).state is MotionState.EXECUTING
    assert course.look(0.5, 0.2).state is MotionState.EXECUTING


def test_progress_is_that_of_the_arm_that_is_behind(book):
    """A motion of two arms is as far as the slower one; its error that of the worse one."""
    course = Course(book, L, R)
    measured = {L: off(L, 0.2), R: off(R, -0.3)}
    book.advance(course.motion, {L: 0.7, R: 0.6}, measured, T0)
    assert course.motion.progress == 0.6 and course.motion.error.rad == pytest.approx(0.3)


def test_an_error_is_known_only_when_every_arm_is_measured(book):
    """A stale arm is not taken for one that has arrived."""
    course = Course(book, L, R)
    assert course.look(0.5, 0.1, None).error is None
    assert course.look(0.5, 0.1, 0.0).error.rad == pytest.approx(0.1)


# ------------------------------------------------------------------------------------------------ its end


def test_a_motion_is_reached_when_every_joint_is_measured_within_tolerance_for_half_a_second(book):
    """Settled by measurement, not by the last setpoint (BEHAVIOUR, values; manual §6.1, §6.6)."""
    course = Course(book, L, R)
    course.look(0.9, 0.0, 0.0, seconds=1.0)
    assert course.motion.state is MotionState.EXECUTING, "the path has not ended"
    ended_ns = course.now_ns
    course.look(1.0, 0.049, -0.049, seconds=3.0)
    assert (course.motion.state, course.motion.code, course.motion.message) == (MotionState.REACHED, None, "")
    assert course.now_ns - 10 * MS == ended_ns + 500 * MS
    assert course.motion.view().error_rad == pytest.approx(0.049)


def test_the_tolerance_itself_is_within_it(book):
    """As the bound says: at most so far off."""
    goals = {L: (0.0,) * 7}
    motion = book.open(goals, Gap(0.125), S)
    for now_ns in (T0, T0 + S):
        book.advance(motion, {L: 1.0}, {L: (0.125, -0.125, 0.0, 0.0, 0.0, 0.0, 0.0)}, now_ns)
    assert motion.state is MotionState.REACHED


@pytest.mark.parametrize("interruption", [0.06, -0.06, None], ids=["above", "below", "unknown"])
def test_leaving_the_tolerance_or_the_sight_starts_the_half_second_anew(book, interruption):
    """0.5 s kept, not 0.5 s in total."""
    course = Course(book)
    course.look(1.0, 0.0, seconds=0.45)
    course.look(1.0, interruption)
    again_ns = course.now_ns
    course.look(1.0, 0.0, seconds=3.0)
    assert course.motion.state is MotionState.REACHED and course.now_ns - 10 * MS == again_ns + 500 * MS


def test_a_tighter_tolerance_is_kept_to(book):
    """What passes at 0.05 rad does not at 0.01 rad."""
    course = Course(book, tolerance_rad=0.01)
    course.look(1.0, 0.02, seconds=4.0)
    assert course.motion.state is MotionState.EXECUTING
    course.look(1.0, 0.009, seconds=0.6)
    assert course.motion.state is MotionState.REACHED


@pytest.mark.parametrize(("error_rad", "words"), [(0.08, "0.08 rad"), (None, "unknown")])
def test_a_motion_that_does_not_settle_in_time_is_aborted_and_says_how_far_it_is(book, error_rad, words):
    """Load or contact keeps the arm away: 5 s after the path ended, with the error and what was asked for."""
    course = Course(book)
    course.look(0.99, error_rad, seconds=9.0)
    assert course.motion.is_running, "the time counts from the end of the path"
    ended_ns = course.now_ns
    course.look(1.0, error_rad, seconds=9.0)
    motion = course.motion
    assert (motion.state, motion.code) == (MotionState.ABORTED, Code.SETTLE_TIMEOUT)
    assert motion.message == f"the measured error is {words} 5.0 s after the path ended, 0.05 rad is asked for"
    assert course.now_ns - 10 * MS == ended_ns + 5010 * MS


def test_an_arm_that_arrived_just_in_time_may_settle(book):
    """It is within tolerance: it is reached half a second later, or aborted as soon as it leaves."""
    for leaves in (False, True):
        course = Course(book)
        course.look(1.0, 0.08, seconds=4.8)
        course.look(1.0, 0.01, seconds=0.4)
        assert course.motion.is_running
        course.look(1.0, 0.08 if leaves else 0.01, seconds=0.2)
        assert course.motion.state is (MotionState.ABORTED if leaves else MotionState.REACHED)


def test_settling_may_take_longer_than_the_time_to_arrive():
    """A configuration may ask for a short arrival and a long proof: a motion that is there is never aborted for it."""
    course = Course(MotionBook(ArmSettings(settle_ns=2 * S, settle_timeout_ns=100 * MS)))
    course.look(1.0, 0.0, seconds=3.0)
    assert course.motion.state is MotionState.REACHED and course.now_ns - 10 * MS == T0 + 2 * S


def test_a_motion_to_where_the_arm_is_settles_like_any_other(book):
    """Its path has no length and has ended at once."""
    course = Course(book)
    assert course.look(1.0).state is MotionState.EXECUTING
    assert course.look(1.0, seconds=0.6).state is MotionState.REACHED


# ------------------------------------------------------------------------------------------------ trajectories


TIGHT = (0.05, 0.05, 0.05, 0.01, 0.05, 0.05, 0.05)


class Trip(Course):
    """A trajectory of both arms, planned to end 2 s after T0, that may take 1 s more; joint 4 must be within 0.01 rad."""

    def __init__(self, book: MotionBook) -> None:
        self.book = book
        tolerances = Tolerances(path={}, goal={L: TIGHT, R: TIGHT}, goal_time_ns=S)
        self.motion = book.open(BOTH, None, 2 * S, Terms(tolerances=tolerances, ends_ns=T0 + 2 * S))
        self.now_ns = T0


def test_a_trajectory_is_reached_when_each_joint_is_within_its_own_tolerance(book):
    """For the settling time; an error that the next joint may have is too much for this one."""
    trip = Trip(book)
    trip.look(1.0, 0.011, 0.0, seconds=0.6)
    assert trip.motion.is_running
    trip.look(1.0, 0.009, 0.009, seconds=0.52)
    assert trip.motion.state is MotionState.REACHED


def test_a_trajectory_that_is_not_at_its_goal_in_time_says_which_joint_is_not(book):
    """GOAL_TOLERANCE, 1 s after the planned end, whatever the settling timeout of moves is."""
    trip = Trip(book)
    trip.look(1.0, 0.0, 0.02, seconds=9.0)
    assert (trip.motion.state, trip.motion.code) == (MotionState.ABORTED, Code.GOAL_TOLERANCE)
    assert 3.0 < (trip.now_ns - T0) / S <= 3.03
    assert trip.motion.message.startswith("right arm joint 4 is 0.0200 rad from its goal 1 s after its planned end")


def test_the_goal_time_counts_on_the_way_as_well(book):
    """A trajectory that is held up anywhere is too late, in its first segment as in its last."""
    trip = Trip(book)
    trip.look(0.4, 0.0, 0.0, seconds=9.0)
    assert trip.motion.code is Code.GOAL_TOLERANCE and trip.motion.message.startswith("only 40%")


def test_an_arm_that_is_not_measured_is_not_at_its_goal(book):
    """And that is what is said."""
    trip = Trip(book)
    trip.look(1.0, 0.0, None, seconds=9.0)
    assert trip.motion.code is Code.GOAL_TOLERANCE and "not measured" in trip.motion.message


def test_an_arm_within_tolerance_when_its_goal_time_is_over_may_settle(book):
    """As a move may; when it leaves, it is too late."""
    trip = Trip(book)
    trip.look(1.0, 0.1, 0.1, seconds=2.8)
    trip.look(1.0, 0.0, 0.0, seconds=0.4)
    assert trip.motion.is_running
    trip.look(1.0, 0.0, 0.0, seconds=0.2)
    assert trip.motion.state is MotionState.REACHED


def test_a_motion_of_an_end_effector_settles_by_position_and_orientation(book):
    """5 mm and 0.05 rad by default, kept 0.5 s; the view has both errors."""
    goal = (0.3, 0.0, -0.2, 0.0, 0.0, 0.0, 1.0)
    motion = book.open({L: goal}, None, S, space=Space.POSE)
    assert motion.tolerance == Gap(0.05, 0.005)
    book.advance(motion, {L: 1.0}, {L: (0.306, 0.0, -0.2, 0.0, 0.0, 0.0, 1.0)}, T0)
    view = motion.view()
    assert (view.space, view.error_m, view.error_rad) == ("pose", pytest.approx(0.006), pytest.approx(0.0))
    near = (0.304, 0.0, -0.2, 0.0, 0.0, 0.02, 0.9998)
    for now_ns in (T0 + S, T0 + S + 499_000_000):
        book.advance(motion, {L: 1.0}, {L: near}, now_ns)
        assert motion.is_running
    book.advance(motion, {L: 1.0}, {L: near}, T0 + S + 500_000_000)
    assert motion.state is MotionState.REACHED


def test_an_end_effector_that_does_not_arrive_is_told_with_both_distances(book):
    """What is left, and what was asked for."""
    motion = book.open({L: (0.3, 0.0, -0.2, 0.0, 0.0, 0.0, 1.0)}, None, S, space=Space.POSE)
    for now_ns in (T0, T0 + 6 * S):
        book.advance(motion, {L: 1.0}, {L: (0.32, 0.0, -0.2, 0.0, 0.0, 0.0, 1.0)}, now_ns)
    assert motion.code is Code.SETTLE_TIMEOUT
    assert "0.02 m and 0 rad" in motion.message and "0.005 m and 0.05 rad is asked for" in motion.message


def test_a_motion_may_be_measured_in_another_space_than_its_arms(book):
    """What turns joints into its own values is asked for each arm that is fresh; without it they are what is measured."""
    motion = book.open({L: (0.3,) * 7}, None, 2 * S, space=Space.POSE)
    assert motion.where({L: HOME[L], R: None}) == {L: HOME[L], R: None}
    motion.seen = lambda side, q_rad: (float(side is L), *q_rad[1:])
    assert motion.where({L: HOME[L], R: HOME[R]}) == {L: (1.0, *HOME[L][1:])}
    assert motion.where({L: None, R: HOME[R]}) == {L: None}


def test_settings_that_were_read_anew_say_how_the_next_motion_settles(book):
    """How long is waited counts at once; the tolerance of a motion under way is the one that it began with."""
    course = Course(book)
    book.renew(ArmSettings(settle_rad=0.01, settle_ns=0), PoseSettings(settle_m=0.001, settle_rad=0.02))
    assert course.motion.tolerance == Gap(SETTINGS.settle_rad)
    assert course.look(1.0, 0.04).state is MotionState.REACHED
    assert book.open({L: HOME[L]}, None, S).tolerance == Gap(0.01)
    assert book.open({R: HOME[R]}, None, S, space=Space.POSE).tolerance == Gap(0.02, 0.001)
