"""The gripper stream: 50 Hz with its arm, 0.10 first, the owner's value until a later one or a new start."""

from __future__ import annotations

from itertools import pairwise

from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.streams.gripper import GripperStream
from gateway.robot.topics import gripper_command
from gateway.values import Side

MS = 1_000_000
S = 1_000_000_000
T0 = 1_000 * S
ECHO, HOLD, MOTION = FrameKind.ECHO, FrameKind.HOLD, FrameKind.MOTION


class Course:
    """A gripper whose arm is streamed or not, and the time that passes for it."""

    def __init__(self, *, is_started: bool = True) -> None:
        self.is_arm_streamed = is_started
        self.now_ns = T0
        self.gripper = GripperStream(Side.LEFT, lambda: self.is_arm_streamed)
        if is_started:
            self.is_arm_streamed = False
            self.gripper.start(T0, is_kept=False)
            self.is_arm_streamed = True

    def run(self, ticks: int) -> list[Frame]:
        """Tick every 10 ms; return what was due."""
        due = []
        for _ in range(ticks):
            frame = self.gripper.frame(self.now_ns)
            if frame is not None:
                due.append(frame)
            self.now_ns += 10 * MS
        return due

    def restart(self, *, is_kept: bool) -> None:
        """The arm falls silent and is started again."""
        self.is_arm_streamed = False
        assert self.run(10) == []
        self.gripper.start(self.now_ns, is_kept=is_kept)
        self.is_arm_streamed = True


def test_it_is_silent_while_its_arm_is():
    """Neither before its start nor without the arm's stream (manual §4.4)."""
    course = Course(is_started=False)
    assert (course.gripper.running, course.gripper.next_due_ns(), course.run(10)) == (False, None, [])
    course.is_arm_streamed = True
    assert not course.gripper.running and course.run(10) == []
    started = Course()
    started.run(3)
    started.is_arm_streamed = False
    assert (started.gripper.running, started.gripper.next_due_ns(), started.run(10)) == (False, None, [])


def test_it_begins_at_once_with_no_torque_and_repeats_it():
    """0.10: the robot may still hold an older input; then 50 Hz of the same, nobody's motion."""
    course = Course()
    frames = course.run(20)
    assert [(frame.kind, frame.values, frame.epoch) for frame in frames] == [(ECHO, (0.1,), 0)] + [
        (HOLD, (0.1,), 0)
    ] * 9
    assert frames[0].due_ns == T0 and {b.due_ns - a.due_ns for a, b in pairwise(frames)} == {20 * MS}
    assert course.gripper.next_due_ns() == T0 + 200 * MS and frames[0].topic == gripper_command(Side.LEFT)


def test_a_value_is_sent_as_the_owners_and_then_kept():
    """One frame may change it; the others hold it."""
    course = Course()
    course.run(5)
    course.gripper.command(0.8, 7)
    assert (course.gripper.wanted, course.gripper.raw) == (0.8, 0.1)
    frames = course.run(10)
    assert [(frame.kind, frame.values, frame.epoch) for frame in frames[:2]] == [(MOTION, (0.8,), 7), (HOLD, (0.8,), 0)]
    assert {frame.values for frame in frames} == {(0.8,)} and course.gripper.raw == course.gripper.wanted == 0.8


def test_a_value_that_did_not_leave_before_a_cut_never_leaves():
    """The last one that was sent stays: it is what the robot has."""
    course = Course()
    course.run(5)
    course.gripper.command(0.8, 7)
    course.run(3)
    course.gripper.command(0.0, 7)
    course.gripper.cancel()
    assert {frame.values for frame in course.run(10)} == {(0.8,)} and course.gripper.wanted == 0.8


def test_a_live_one_is_not_started_again():
    """A pause re-seeds the arm without a gap; the grip is kept."""
    course = Course()
    course.run(5)
    course.gripper.command(0.8, 7)
    course.run(5)
    course.gripper.start(course.now_ns, is_kept=False)
    assert {(frame.kind, frame.values) for frame in course.run(10)} == {(HOLD, (0.8,))}


def test_a_new_start_is_without_torque():
    """And what was asked for before it is forgotten."""
    course = Course()
    course.run(5)
    course.gripper.command(0.8, 7)
    course.run(5)
    course.gripper.command(0.9, 7)
    course.restart(is_kept=False)
    assert [(frame.kind, frame.values) for frame in course.run(4)] == [(ECHO, (0.1,)), (HOLD, (0.1,))]


def test_after_a_short_stall_the_value_is_kept():
    """The robot has it still: its first frame is an echo of it."""
    course = Course()
    course.run(5)
    course.gripper.command(0.8, 7)
    course.run(5)
    course.restart(is_kept=True)
    assert [(frame.kind, frame.values) for frame in course.run(4)] == [(ECHO, (0.8,)), (HOLD, (0.8,))]


def test_it_goes_on_in_another_process_place():
    """With what that one has sent last, and no echo: the stream is live."""
    course = Course(is_started=False)
    course.is_arm_streamed = True
    course.gripper.enter(0.7, T0)
    assert {(frame.kind, frame.values) for frame in course.run(10)} == {(HOLD, (0.7,))}
