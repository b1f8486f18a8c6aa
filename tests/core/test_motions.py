"""Motions: accepted, sent, and ended exactly once, by what is measured."""

from __future__ import annotations

import pytest

from gateway import robot
from gateway.core.motions import ENDED_KEPT, Motion, MotionBook, MotionState
from gateway.core.snapshot import MotionView
from gateway.errors import Code
from gateway.settings import ArmSettings
from gateway.values import Side, Vector

MS = 1_000_000
S = 1_000_000_000
T0 = 1_000 * S
L, R = Side.LEFT, Side.RIGHT
HOME = robot.HOME_Q_RAD
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
        self.motion = book.open({side: HOME[side] for side in sides or (L,)}, tolerance_rad, 2 * S)
        self.now_ns = T0

    def look(self, progress: float, *errors_rad: float | None, seconds: float = 0.01) -> Motion:
        """Report progress and errors of its arms for a while."""
        sides = tuple(self.motion.goals_rad)
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
    assert motion.goals_rad == HOME


@pytest.mark.parametrize(("asked", "used"), [(None, 0.05), (0.01, 0.01)])
def test_the_tolerance_is_the_one_asked_for_or_the_configured_one(book, asked, used):
    """Manual §6.6: 0.05 rad; tighter on request."""
    assert book.open(BOTH, asked, S).tolerance_rad == used


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
        code="", message="",
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
    assert course.motion.progress == 0.6 and course.motion.error_rad == pytest.approx(0.3)


def test_an_error_is_known_only_when_every_arm_is_measured(book):
    """A stale arm is not taken for one that has arrived."""
    course = Course(book, L, R)
    assert course.look(0.5, 0.1, None).error_rad is None
    assert course.look(0.5, 0.1, 0.0).error_rad == pytest.approx(0.1)


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
    motion = book.open(goals, 0.125, S)
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


@pytest.mark.parametrize(("error_rad", "words"), [(0.08, "0.0800 rad"), (None, "unknown")])
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
