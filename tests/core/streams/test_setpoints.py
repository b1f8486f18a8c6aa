"""One arm's stream of setpoints: due at 100 Hz from its start on, one period of the reference per frame, each of its kind."""

from __future__ import annotations

from itertools import pairwise

import pytest

from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.motion.gap import Gap
from gateway.core.motion.joints.trajectory import Trajectory, interpolate
from gateway.core.motion.motion import PlanFailed, plan
from gateway.core.motion.poses.pose_trajectory import PoseTrajectory, interpolate_poses
from gateway.core.streams.arm import ArmStream
from gateway.core.streams.pose import PoseStream
from gateway.core.streams.setpoints import SetpointStream
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import joint_command
from gateway.settings.settings import ArmSettings, PoseSettings
from gateway.values import Side, Space, Vector

MS = 1_000_000
S = 1_000_000_000
T0 = 1_000 * S
MIDDLE: dict[Side, Vector] = {
    side: tuple((a + b) / 2 for a, b in zip(JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side], strict=True)) for side in Side
}
"""The middle of every joint's range [rad]: 0.7 rad or more to either side."""
PLACE = (0.30, 0.10, -0.20, 0.0, 0.0, 0.0, 1.0)
"""A pose inside the reach."""
ECHO, MOTION, WALK, BRAKE, HOLD = (
    FrameKind.ECHO, FrameKind.MOTION, FrameKind.WALK, FrameKind.BRAKE, FrameKind.HOLD,
)  # fmt: skip


class Course:
    """An arm stream, started where its arm hangs, and the time that passes for it.

    Attributes:
        arm: The stream.
        now_ns: Monotonic time [ns].
    """

    def __init__(self, side: Side = Side.LEFT, *, live: bool = True) -> None:
        self.side = side
        self.arm = ArmStream(side, ArmSettings())
        self.now_ns = T0
        self.arm.start(MIDDLE[side], T0)
        if live:
            self.run(3)
            self.arm.go_live()

    def run(self, frames: int) -> list[Frame]:
        """Return the next so many frames, each asked for at its instant."""
        found: list[Frame] = []
        while len(found) < frames:
            frame = self.arm.frame(self.now_ns)
            if frame is not None:
                found.append(frame)
            due_ns = self.arm.next_due_ns()
            assert due_ns is not None
            self.now_ns = due_ns
        return found

    def moved(self, offset_rad: float) -> Vector:
        """The start, moved by so much in every joint [rad]."""
        return tuple(q + offset_rad for q in MIDDLE[self.side])

    def path_to(self, q_rad: Vector):
        """A path of this arm to there."""
        return plan({self.side: self.arm.reference}, {self.side: q_rad})[self.side]

    def begin(self, offset_rad: float = 0.1, epoch: int = 7) -> None:
        """Let the owner of an epoch move all joints."""
        self.arm.follow_path(self.path_to(self.moved(offset_rad)), epoch)


def kinds(frames: list[Frame]) -> list[FrameKind]:
    """The kinds in order, each run of equal ones once."""
    return [f.kind for n, f in enumerate(frames) if n == 0 or frames[n - 1].kind is not f.kind]


# ------------------------------------------------------------------------------------------------ start and end


def test_an_arm_is_silent_until_it_is_started():
    """Nothing leaves for an arm that nobody enabled."""
    arm = ArmStream(Side.LEFT, ArmSettings())
    assert (arm.running, arm.next_due_ns(), arm.frame(T0)) == (False, None, None)
    assert (arm.is_at_rest, arm.is_walking) == (True, False)


@pytest.mark.parametrize("side", list(Side))
def test_a_start_echoes_where_the_arm_is_at_once_and_at_100_hz(side):
    """Until the robot follows, every frame repeats the latched start (DESIGN §4, ENABLING); nobody moves it."""
    course = Course(side, live=False)
    frames = course.run(30)
    assert frames == [
        Frame(topic=joint_command(side), values=MIDDLE[side], kind=ECHO, epoch=0, due_ns=T0 + n * 10 * MS)
        for n in range(30)
    ]


def test_between_two_instants_nothing_is_due():
    """A wake-up for another stream moves no arm."""
    course = Course()
    course.begin()
    course.run(5)
    before = course.arm.reference.values
    assert course.arm.frame(course.now_ns - 1) is None and course.arm.reference.values == before


def test_the_rate_is_the_configured_one():
    """Also the reference then advances by that period per frame."""
    arm = ArmStream(Side.LEFT, ArmSettings(rate_hz=200.0))
    arm.start(MIDDLE[Side.LEFT], T0)
    arm.frame(T0)
    assert arm.next_due_ns() == T0 + 5 * MS and arm.reference.period_s == 0.005


def test_the_limits_are_the_configured_ones_of_that_side():
    """Tighter than the robot's where the configuration says so (BEHAVIOUR, values)."""
    upper = {**JOINT_UPPER_RAD, Side.RIGHT: (1.0, *JOINT_UPPER_RAD[Side.RIGHT][1:])}
    settings = ArmSettings(v_radps=0.5, a_radps2=2.0, j_radps3=10.0, upper_rad=upper)
    limits = ArmStream(Side.RIGHT, settings).reference.space.limits
    assert (limits.v_radps, limits.a_radps2, limits.j_radps3) == (0.5, 2.0, 10.0)
    assert limits.lower_rad == JOINT_LOWER_RAD[Side.RIGHT] and limits.upper_rad == upper[Side.RIGHT]


def test_a_start_outside_the_limits_starts_nothing():
    """The door moves a start to the limit first; what it did not see must not leave."""
    arm = ArmStream(Side.LEFT, ArmSettings())
    with pytest.raises(PlanFailed, match="start"):
        arm.start((9.0,) * 7, T0)
    assert not arm.running


def test_a_live_echo_becomes_a_held_reference():
    """READY reached: from the last setpoint, never seeded anew (BEHAVIOUR, starting and continuing)."""
    course = Course(live=False)
    course.run(3)
    course.arm.go_live()
    assert [(f.kind, f.values) for f in course.run(2)] == [(HOLD, MIDDLE[Side.LEFT])] * 2


def test_a_stream_that_starts_live_begins_with_an_echo_all_the_same():
    """After a short stall it starts in HOLDING: the gate knows a start by its echo."""
    course = Course(live=False)
    course.arm.go_live()
    assert [f.kind for f in course.run(3)] == [ECHO, HOLD, HOLD]


def test_a_stopped_stream_is_silent_and_its_silence_is_no_gap():
    """And the next start is a start: echo, from where the arm is then, under nobody's epoch."""
    course = Course()
    course.begin()
    for _ in course.run(20):
        course.arm.log.note(course.now_ns)
    course.arm.stop()
    assert (course.arm.frame(course.now_ns), course.arm.next_due_ns()) == (None, None)
    assert not course.arm.log.view(course.now_ns).running
    course.now_ns += S
    course.arm.start(course.moved(0.05), course.now_ns)
    assert [(f.kind, f.values, f.epoch) for f in course.run(2)] == [(ECHO, course.moved(0.05), 0)] * 2


def test_a_start_is_due_at_once_wherever_in_the_grid():
    """Also within the period of the last frame of before: the robot must hear of the new start now."""
    course = Course()
    course.arm.stop()
    start_ns = course.now_ns - 3 * MS
    course.arm.start(course.moved(0.05), start_ns)
    frame = course.arm.frame(start_ns)
    assert frame is not None and (frame.kind, frame.values) == (ECHO, course.moved(0.05))


def test_a_running_stream_can_be_seeded_anew_without_a_gap():
    """PAUSED re-seeds at once: the robot does not follow then (BEHAVIOUR, starting and continuing)."""
    course = Course()
    course.begin()
    for _ in course.run(20):
        course.arm.log.note(course.now_ns)
    course.arm.start(course.moved(0.02), course.now_ns)
    assert course.arm.log.last_ns is None, "a start is announced to the gate by a log that begins"
    (frame,) = course.run(1)
    assert (frame.kind, frame.values, frame.due_ns) == (ECHO, course.moved(0.02), T0 + 230 * MS)
    assert course.arm.is_at_rest


# ------------------------------------------------------------------------------------------------ what moves it


def test_a_path_is_motion_of_its_epoch_until_it_ends_and_then_held():
    """The last setpoint of the path still is motion; what repeats it is a hold frame."""
    course = Course()
    course.begin(epoch=7)
    frames = course.run(200)
    assert kinds(frames) == [MOTION, HOLD]
    assert {f.epoch for f in frames if f.kind is MOTION} == {7}
    first_hold = next(n for n, f in enumerate(frames) if f.kind is HOLD)
    assert frames[first_hold - 1].values == frames[-1].values == pytest.approx(course.moved(0.1))


def test_a_late_tick_delays_the_path_and_never_jumps_along_it():
    """One nominal period per frame, whatever the wall time between two frames (realtime)."""
    punctual, late = Course(), Course()
    for course in (punctual, late):
        course.begin()
    late.now_ns += 70 * MS
    assert [f.values for f in punctual.run(40)] == [f.values for f in late.run(40)]


def test_a_streamed_target_is_motion_for_as_long_as_it_is_followed():
    """Also when the reference has come to rest on it: it stays the owner's."""
    course = Course()
    course.arm.follow_target(course.moved(0.05), 1.0, 9)
    frames = course.run(150)
    assert kinds(frames) == [MOTION] and {f.epoch for f in frames} == {9}
    assert frames[-1].values == pytest.approx(course.moved(0.05), abs=1e-6)


def test_a_speed_factor_slows_the_following_down():
    """It multiplies the velocity limit (DESIGN §7)."""
    course = Course()
    course.arm.follow_target(course.moved(0.3), 0.1, 9)
    frames = course.run(200)
    steps = [abs(b.values[0] - a.values[0]) for a, b in pairwise(frames)]
    assert 0.05 * 0.01 < max(steps) <= 0.1 * 0.01 + 1e-9


def test_braking_is_of_its_own_kind_until_the_arm_rests():
    """BRAKE while it moves, HOLD after; the setpoint goes on smoothly and stays where it came to rest."""
    course = Course()
    course.begin(0.6)
    course.run(40)
    assert not course.arm.is_at_rest
    course.arm.brake()
    frames = course.run(100)
    assert kinds(frames) == [BRAKE, HOLD]
    assert course.arm.is_at_rest and frames[-1].values[0] < course.moved(0.6)[0] - 0.1


def test_braking_an_arm_at_rest_holds_it_there():
    """A stop of an arm that stands still sends nothing but its reference; an echo stays an echo."""
    live, echoing = Course(), Course(live=False)
    for course, kind in ((live, HOLD), (echoing, ECHO)):
        course.run(1)
        course.arm.brake()
        assert [(f.kind, f.values) for f in course.run(3)] == [(kind, MIDDLE[Side.LEFT])] * 3


def test_a_walk_is_nobodys_motion():
    """The held reference goes back to the arm under no epoch: it needs no owner (BEHAVIOUR, walk)."""
    course = Course()
    course.begin(epoch=7)
    course.run(200)
    assert not course.arm.is_walking
    course.arm.walk(course.path_to(MIDDLE[Side.LEFT]))
    assert course.arm.is_walking
    frames = course.run(200)
    assert kinds(frames) == [WALK, HOLD] and {f.epoch for f in frames} == {0}
    assert not course.arm.is_walking and frames[-1].values == pytest.approx(MIDDLE[Side.LEFT])


@pytest.mark.parametrize("end", ["brake", "path", "target", "start", "stop"])
def test_whatever_comes_after_ends_the_walk(end):
    """A later motion is the owner's again, and is seen as such by the gate."""
    course = Course()
    course.begin()
    course.run(200)
    course.arm.walk(course.path_to(MIDDLE[Side.LEFT]))
    course.run(10)
    if end == "brake":
        course.arm.brake()
    elif end == "path":
        course.begin(0.05)
    elif end == "target":
        course.arm.follow_target(course.moved(0.05), 1.0, 7)
    elif end == "start":
        course.arm.start(MIDDLE[Side.LEFT], course.now_ns)
    else:
        course.arm.stop()
    assert not course.arm.is_walking
    if end != "stop":
        assert WALK not in kinds(course.run(200))


def test_a_path_of_another_state_is_refused():
    """A path is planned from the setpoint that was sent last, or it would jump; what moved the arm goes on."""
    course = Course()
    path = course.path_to(course.moved(0.1))
    course.begin()
    course.run(5)
    with pytest.raises(PlanFailed):
        course.arm.follow_path(path, 8)
    assert kinds(course.run(5)) == [MOTION] and course.arm.epoch == 7


def test_the_distance_is_that_of_the_worst_joint():
    """Setpoint against measured: what the tracking bound and the walk look at."""
    course = Course()
    measured = list(MIDDLE[Side.LEFT])
    measured[2] -= 0.05
    measured[5] += 0.2
    assert course.arm.distance(tuple(measured)) == pytest.approx(Gap(0.2))


def test_an_interrupted_stream_goes_on_with_its_brake_and_then_holds():
    """No echo and no epoch: nobody's motion. The first frame is one period after the last one of the other process."""
    course = Course()
    course.arm.stop()
    side = course.side
    course.arm.enter(MIDDLE[side], (0.3,) * 7, (0.0,) * 7, course.now_ns)
    assert course.arm.running and course.arm.epoch == 0 and not course.arm.is_at_rest
    frames = course.run(60)
    assert frames[0].kind is BRAKE
    assert frames[0].values[0] - MIDDLE[side][0] == pytest.approx(0.003, rel=0.01)
    assert frames[-1].kind is HOLD and course.arm.is_at_rest


def test_a_stream_that_cannot_go_on_stays_as_it_was():
    """Silent, with its old reference."""
    course = Course()
    course.arm.stop()
    with pytest.raises(PlanFailed):
        course.arm.enter(MIDDLE[course.side], (9.0,) * 7, (0.0,) * 7, course.now_ns)
    assert not course.arm.running
    assert course.arm.reference.values == MIDDLE[course.side]


def test_a_stream_shows_what_its_reference_does():
    """Setpoint, velocity, and the period."""
    course = Course()
    course.begin()
    course.run(20)
    arm, reference = course.arm, course.arm.reference
    assert (arm.values, arm.rates) == (reference.values, reference.rates)
    assert any(arm.rates) and arm.period_s == 0.01


def test_a_stream_stays_with_an_arm_that_nobody_drives():
    """In its time, at rest, and as a start: the gate is told by the log, which goes on."""
    course = Course()
    course.begin()
    assert not course.arm.is_repeating
    for _ in course.run(20):
        course.arm.log.note(course.now_ns)
    course.arm.stay_with(course.moved(0.02))
    assert course.arm.log.is_anew and course.arm.log.last_ns is not None
    assert course.arm.is_repeating and course.arm.is_at_rest and not course.arm.is_walking
    first, second = course.run(2)
    assert (first.kind, first.values, first.epoch, first.due_ns) == (ECHO, course.moved(0.02), 0, T0 + 230 * MS)
    assert (second.kind, second.values, second.due_ns) == (HOLD, course.moved(0.02), T0 + 240 * MS)
    course.arm.log.note(course.now_ns)
    assert not course.arm.log.is_anew


def _chunk(space: Space) -> tuple[SetpointStream, Vector, Trajectory | PoseTrajectory]:
    """A stream of a space, where it begins, and a way from there with a step in each of its points."""
    times_s = [0.05 * n for n in range(20)]
    if space is Space.JOINT:
        arm, home = ArmStream(Side.LEFT, ArmSettings()), HOME_Q_RAD[Side.LEFT]
        return arm, home, interpolate([tuple(q - 0.004 * n for q in home) for n in range(20)], times_s)
    x, *rest = PLACE
    return (
        PoseStream(Side.LEFT, PoseSettings()),
        PLACE,
        interpolate_poses([(x + 0.002 * n, *rest) for n in range(20)], times_s),
    )


@pytest.mark.parametrize("space", list(Space))
def test_a_trajectory_is_motion_of_its_epoch_until_it_ends_and_then_held(space):
    """Joints and poses; it waits for its beginning."""
    arm, home, trajectory = _chunk(space)
    arm.start(home, T0)
    arm.go_live()
    frames, now_ns = [], T0
    for count in (3, 150):
        for _ in range(count):
            frames.append(arm.frame(now_ns))
            now_ns = arm.next_due_ns()
        if count == 3:
            arm.follow_chunk(arm.reference.prepare(trajectory, -0.05, rests=True), 9)
    kinds = [frame.kind for frame in frames[3:]]
    assert kinds[0] is MOTION and kinds[-1] is HOLD and set(kinds) == {MOTION, HOLD}
    assert {frame.epoch for frame in frames[3:]} == {9}
    assert frames[-1].values == pytest.approx(trajectory.points[-1], abs=1e-7)
