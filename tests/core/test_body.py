"""The body: all streams as one thing; what drives the arms; and the cuts that end it."""

from __future__ import annotations

import pytest

from gateway import robot
from gateway.core.body import Body
from gateway.core.events import FrameKind, OnLimit, TargetArrived
from gateway.core.motion import ReferenceMode, plan
from gateway.core.motions import Motion, MotionState
from gateway.core.streams.ground import LIFT_OFF
from gateway.core.targets import TargetStream
from gateway.errors import Code
from gateway.settings import LinkSettings, Settings
from gateway.values import Side, Vector

MS = 1_000_000
S = 1_000_000_000
T0 = 1_000 * S
L, R = Side.LEFT, Side.RIGHT
MIDDLE: dict[Side, Vector] = {
    side: tuple((a + b) / 2 for a, b in zip(robot.JOINT_LOWER_RAD[side], robot.JOINT_UPPER_RAD[side], strict=True))
    for side in Side
}
GOAL: dict[Side, Vector] = {side: tuple(q + 0.5 for q in MIDDLE[side]) for side in Side}
HOLD, PATH, FOLLOW, BRAKE = ReferenceMode


class Course:
    """A body whose arms run, and the time that passes for it.

    Attributes:
        body: The body.
        now_ns: Monotonic time of the next tick [ns].
    """

    def __init__(self, *sides: Side, model: str = "standard") -> None:
        self.body = Body(Settings(link=LinkSettings(model=model)))
        self.now_ns = T0
        for side in sides:
            self.body.arms[side].start(MIDDLE[side], T0)
        self.run(3)

    def run(self, ticks: int) -> list[tuple[str, Vector]]:
        """Tick every 10 ms; return what was due: topic and values."""
        due = []
        for _ in range(ticks):
            frames = [stream.frame(self.now_ns) for stream in self.body.streams if stream.running]
            due += [(frame.topic, frame.values) for frame in frames if frame is not None]
            self.now_ns += 10 * MS
        return due

    def move(self, *sides: Side) -> Motion:
        """Begin a motion of these arms."""
        goals = {side: GOAL[side] for side in sides}
        paths = plan({side: self.body.arms[side].reference for side in sides}, goals)
        for side, path in paths.items():
            self.body.arms[side].follow_path(path, 5)
        return self.body.motions.open(goals, None, paths[sides[0]].duration_ns)

    def follow(self, side: Side) -> TargetStream:
        """Open a stream of targets for an arm and follow its first one."""
        stream = self.body.targets.open(side, "ann", 5, 1.0, OnLimit.REJECT, None)
        self.body.targets.accept(
            TargetArrived(
                client_id="ann", stream_id=stream.stream_id, epoch=5, seq=1, q_rad=GOAL[side], received_ns=self.now_ns
            )
        )
        self.body.arms[side].follow_target(GOAL[side], 1.0, 5)
        return stream

    def modes(self) -> tuple[ReferenceMode, ...]:
        """What moves the left and the right reference."""
        return tuple(self.body.arms[side].reference.mode for side in Side)


# ------------------------------------------------------------------------------------------------ all as one


@pytest.mark.parametrize(("model", "has_lift"), [("lite", False), ("standard", False), ("lift", True)])
def test_the_streams_are_those_of_the_model_arms_first(model, has_lift):
    """A heartbeat never overtakes the setpoint of its tick; a model without a lift has no stream for it (manual §1.2)."""
    body = Body(Settings(link=LinkSettings(model=model)))
    topics = [stream.topic for stream in body.streams]
    expected = [robot.joint_command(L), robot.joint_command(R), robot.FSM_ENABLE, robot.CHASSIS_VELOCITY]
    assert topics == expected + [robot.LIFT_COMMAND] * has_lift
    assert all(not stream.running for stream in body.streams) and body.next_due_ns() is None


def test_every_stream_has_the_one_shape():
    """Own grid, own log, asked the same way (DESIGN §6)."""
    for stream in Body(Settings(link=LinkSettings(model="lift"))).streams:
        assert stream.topic in robot.COMMAND_TOPICS
        assert (stream.running, stream.log.sent, stream.next_due_ns(), stream.frame(T0)) == (False, 0, None, None)


def test_the_running_arms_are_those_that_were_started():
    """And silencing them takes all of them off."""
    course = Course(R)
    assert course.body.running_arms == (course.body.arms[R],)
    course.body.arms[L].start(MIDDLE[L], course.now_ns)
    assert course.body.running_arms == tuple(course.body.arms.values())
    course.body.silence_arms()
    assert course.body.running_arms == () and course.run(20) == []


def test_the_body_rests_when_every_running_arm_does():
    """A silent arm moves nothing and holds nobody up."""
    course = Course(L, R)
    assert Body(Settings()).is_at_rest and course.body.is_at_rest
    course.move(R)
    course.run(20)
    assert not course.body.is_at_rest
    course.body.arms[R].stop()
    assert course.body.is_at_rest


def test_the_body_walks_when_one_running_arm_does():
    """New motion waits until every reference is back at its arm."""
    course = Course(L, R)
    assert not course.body.is_walking
    path = plan({R: course.body.arms[R].reference}, {R: GOAL[R]})[R]
    course.body.arms[R].walk(path)
    assert course.body.is_walking
    course.body.arms[R].stop()
    assert not course.body.is_walking


def test_the_body_is_due_when_its_earliest_stream_is():
    """The loop wakes at the earliest of all grids (BEHAVIOUR, values)."""
    course = Course()
    course.body.chassis.stop(T0 + 30 * MS)
    course.body.chassis.frame(T0 + 30 * MS)
    assert course.body.next_due_ns() == T0 + 50 * MS
    course.body.arms[L].start(MIDDLE[L], T0 + 30 * MS)
    course.body.arms[L].frame(T0 + 30 * MS)
    assert course.body.next_due_ns() == T0 + 40 * MS
    course.body.arms[L].frame(T0 + 40 * MS)
    assert course.body.next_due_ns() == T0 + 50 * MS


# ------------------------------------------------------------------------------------------------ cuts


def test_a_cut_ends_every_motion_and_stream_and_brakes():
    """Later targets get STREAM_ENDED; the arms come to rest and are held (BEHAVIOUR, words: cut)."""
    course = Course(L, R)
    motion, stream = course.move(L), course.follow(R)
    course.run(30)
    assert course.modes() == (PATH, FOLLOW)
    assert course.body.cut(Code.STOPPED, "stop() by ann") == [motion]
    assert (motion.state, motion.code, motion.message) == (MotionState.ABORTED, Code.STOPPED, "stop() by ann")
    assert (stream.is_open, stream.code) == (False, Code.STOPPED)
    assert course.modes() == (BRAKE, BRAKE)
    course.run(100)
    assert course.modes() == (HOLD, HOLD) and course.body.is_at_rest
    assert len(course.body.running_arms) == 2, "a cut does not end the arm streams"


def test_a_cut_with_nothing_to_end_changes_nothing():
    """Levels cut on every tick: an arm that rests or brakes goes on doing so, a silent one stays silent."""
    course = Course(L)
    assert course.body.cut(Code.STATE_STALE, "") == []
    assert course.modes() == (HOLD, HOLD) and course.body.running_arms == (course.body.arms[L],)
    course.move(L)
    course.run(30)
    for _ in range(100):
        course.body.cut(Code.STATE_STALE, "")
        course.run(1)
    assert course.body.is_at_rest and course.modes() == (HOLD, HOLD)


def test_a_cut_ends_the_walk():
    """The reference stays where it comes to rest: walking on would be motion after a stop (DESIGN §8.5)."""
    course = Course(L)
    course.body.arms[L].walk(plan({L: course.body.arms[L].reference}, {L: GOAL[L]})[L])
    course.run(30)
    course.body.cut(Code.STOPPED, "")
    frame = course.body.arms[L].frame(course.now_ns)
    assert not course.body.is_walking and frame is not None and frame.kind is FrameKind.BRAKE


def test_a_ground_stop_stops_chassis_and_lift():
    """Whoever drove them: zeros and [0,1], at once; `fsm/enable 0.0` does not reach them (manual §1.4)."""
    course = Course(model="lift")
    course.body.ground_stop(course.now_ns)
    assert course.run(1) == [(robot.CHASSIS_VELOCITY, (0.0, 0.0, 0.0)), (robot.LIFT_COMMAND, (0.0, 1.0))]


def test_without_a_lift_only_the_chassis_is_stopped():
    """No frame leaves on a topic that the model does not have; taking the lift off is then nothing."""
    course = Course()
    course.body.ground_stop(course.now_ns)
    course.body.lift_off(course.now_ns)
    assert {topic for topic, _ in course.run(200)} == {robot.CHASSIS_VELOCITY}


def test_the_lift_goes_off_after_its_stop_and_only_then():
    """[0,0] takes the servo off: only where a stop of ours ran; a lift that others drive is not touched."""
    course = Course(model="lift")
    course.body.lift_off(course.now_ns)
    assert course.run(50) == []
    course.body.ground_stop(course.now_ns)
    course.body.lift_off(course.now_ns)
    lift = [values for topic, values in course.run(200) if topic == robot.LIFT_COMMAND]
    assert set(lift[:-1]) == {(0.0, 1.0)} and lift[-1] == LIFT_OFF


# ------------------------------------------------------------------------------------------------ one arm's driver


def test_taking_one_arm_away_ends_the_motion_of_both():
    """The other arm brakes and holds; each motion is reported once (BEHAVIOUR, two arms in one motion)."""
    course = Course(L, R)
    motion = course.move(L, R)
    course.run(30)
    assert course.body.drop_driver(L, MotionState.SUPERSEDED, Code.SUPERSEDED, "a later motion") == [motion]
    assert (motion.state, motion.code, motion.message) == (
        MotionState.SUPERSEDED, Code.SUPERSEDED, "a later motion",
    )  # fmt: skip
    assert course.modes() == (BRAKE, BRAKE)
    assert course.body.drop_driver(R, MotionState.SUPERSEDED, Code.SUPERSEDED, "") == []


def test_the_motion_of_the_other_arm_goes_on():
    """What one arm loses is nothing to an arm with a motion of its own."""
    course = Course(L, R)
    left, right = course.move(L), course.move(R)
    course.run(30)
    assert course.body.drop_driver(L, MotionState.CANCELLED, Code.CANCELLED, "") == [left]
    assert right.is_running and course.modes() == (BRAKE, PATH)


def test_a_stream_that_is_dropped_ends_with_its_code_and_its_arm_brakes():
    """A closed or superseded stream tells its later targets why."""
    course = Course(L, R)
    left, right = course.follow(L), course.follow(R)
    course.run(30)
    assert course.body.drop_driver(L, MotionState.CANCELLED, Code.CANCELLED, "closed") == []
    assert (left.code, right.is_open) == (Code.CANCELLED, True)
    assert course.modes() == (BRAKE, FOLLOW)


def test_a_motion_advances_with_its_setpoints_and_ends_when_measured_there():
    """Progress comes from what was sent, the end from what is measured; only what ended is returned."""
    course = Course(L, R)
    left, right = course.move(L), course.move(R)
    course.run(20)
    measured: dict[Side, Vector | None] = {L: MIDDLE[L], R: None}
    assert course.body.advance_motions(measured, course.now_ns) == []
    assert 0.0 < left.progress < 1.0 and left.progress == course.body.arms[L].reference.progress
    assert left.error_rad == pytest.approx(0.5) and right.error_rad is None
    measured, ended = {L: GOAL[L], R: None}, []
    for _ in range(300):
        course.run(1)
        ended += course.body.advance_motions(measured, course.now_ns)
    assert ended == [left] and left.state is MotionState.REACHED and right.is_running
    assert course.body.advance_motions(measured, course.now_ns + 10 * S) == [right]
    assert (right.state, right.code) == (MotionState.ABORTED, Code.SETTLE_TIMEOUT)


def test_an_expired_target_brakes_its_arm_once_and_keeps_the_stream():
    """The arm is held until the next target; the sides are told, for a notice."""
    course = Course(L, R)
    left, right = course.follow(L), course.follow(R)
    right.expiry_ns = 3 * S
    course.run(40)
    now_ns = T0 + 30 * MS + left.expiry_ns
    assert list(course.body.expire_targets(now_ns)) == []
    assert list(course.body.expire_targets(now_ns + 1)) == [L]
    assert course.modes() == (BRAKE, FOLLOW) and left.is_open
    assert list(course.body.expire_targets(now_ns + 2)) == []
