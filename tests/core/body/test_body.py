"""The body: all streams as one thing; what drives the arms; and the cuts that end it."""

from __future__ import annotations

import math

import pytest

from gateway.core.body.body import Body
from gateway.core.body.motions import Motion, MotionState, Terms
from gateway.core.body.targets import TargetStream
from gateway.core.messages.events import TargetArrived
from gateway.core.messages.outputs import FrameKind
from gateway.core.motion.gap import Gap
from gateway.core.motion.joints.trajectory import interpolate
from gateway.core.motion.motion import ReferenceMode, plan, plan_poses
from gateway.core.motion.tolerance import Tolerances
from gateway.core.motion.tracker import Outcome
from gateway.core.streams.ground import LIFT_OFF
from gateway.errors import Code
from gateway.messages.incoming import OnLimit
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import (
    CHASSIS_VELOCITY,
    COMMAND_TOPICS,
    FSM_ENABLE,
    LIFT_COMMAND,
    gripper_command,
    joint_command,
    pose_command,
)
from gateway.settings.settings import ArmSettings, LinkSettings, PoseSettings, Settings
from gateway.values import Side, Space, Vector

MS = 1_000_000
S = 1_000_000_000
T0 = 1_000 * S
L, R = Side.LEFT, Side.RIGHT
MIDDLE: dict[Side, Vector] = {
    side: tuple((a + b) / 2 for a, b in zip(JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side], strict=True)) for side in Side
}
GOAL: dict[Side, Vector] = {side: tuple(q + 0.5 for q in MIDDLE[side]) for side in Side}
POSE: Vector = (0.30, -0.10, -0.20, 0.0, 0.0, 0.0, 1.0)
HOLD, PATH, FOLLOW, CHUNK, BRAKE = ReferenceMode


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
                client_id="ann", stream_id=stream.stream_id, epoch=5, seq=1, values=GOAL[side], received_ns=self.now_ns
            )
        )
        self.body.arms[side].follow_target(GOAL[side], 1.0, 5)
        return stream

    def modes(self) -> tuple[ReferenceMode, ...]:
        """What moves the left and the right reference."""
        return tuple(self.body.arms[side].reference.mode for side in Side)


# ------------------------------------------------------------------------------------------------ all as one


@pytest.mark.parametrize(("model", "has_lift"), [("lite", False), ("standard", False), ("lift", True)])
def test_the_streams_are_those_of_the_model_grippers_first(model, has_lift):
    """0.10 before the torque, setpoints before the heartbeat; a model without a lift has no stream for it (manual §1.2)."""
    body = Body(Settings(link=LinkSettings(model=model)))
    topics = [stream.topic for stream in body.streams]
    commands = (gripper_command, joint_command, pose_command)
    expected = [command(side) for command in commands for side in (L, R)] + [FSM_ENABLE, CHASSIS_VELOCITY]
    assert topics == expected + [LIFT_COMMAND] * has_lift
    assert all(not stream.running for stream in body.streams) and body.next_due_ns() is None


def test_every_stream_has_the_one_shape():
    """Own grid, own log, asked the same way (DESIGN §6)."""
    for stream in Body(Settings(link=LinkSettings(model="lift"))).streams:
        assert stream.topic in COMMAND_TOPICS
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


def test_a_cut_forgets_a_force_that_has_not_left():
    """What the robot has been sent stays (DESIGN §8.5)."""
    course = Course(L)
    course.body.grippers[L].enter(0.6, course.now_ns)
    course.body.grippers[L].command(0.0, 5)
    course.body.cut(Code.STOPPED, "")
    assert {values for topic, values in course.run(10) if topic == gripper_command(L)} == {(0.6,)}


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
    assert course.run(1) == [(CHASSIS_VELOCITY, (0.0, 0.0, 0.0)), (LIFT_COMMAND, (0.0, 1.0))]


def test_a_ground_cut_stops_what_is_driven_and_nothing_else():
    """Levels cut on every tick: the second of zeros is not begun anew, and what others drive is left alone."""
    course = Course(model="lift")
    course.body.ground_cut(Code.STOPPED, course.now_ns)
    assert course.run(10) == []
    course.body.chassis.drive((0.2, 0.0, 0.0), epoch=1, expires_ns=course.now_ns + 10 * S, now_ns=course.now_ns)
    course.run(20)
    sent = []
    for code in [Code.CLIENT_LOST] + [Code.STOPPED] * 150:
        course.body.ground_cut(code, course.now_ns)
        sent += course.run(1)
    assert set(sent) == {(CHASSIS_VELOCITY, (0.0, 0.0, 0.0))} and 20 <= len(sent) <= 22
    assert course.body.chassis.code is Code.CLIENT_LOST and not course.body.chassis.running


def test_what_was_under_way_when_the_transport_was_lost_is_sent_again():
    """Zeros for the chassis, servo off for the lift; nothing where nothing ran."""
    course = Course(model="lift")
    course.body.lose_transport(course.now_ns)
    course.body.find_transport(course.now_ns)
    assert course.run(10) == []
    course.body.ground_stop(course.now_ns)
    course.run(2)
    course.body.lose_transport(course.now_ns)
    course.run(90)
    course.body.find_transport(course.now_ns)
    assert set(course.run(200)) == {(CHASSIS_VELOCITY, (0.0, 0.0, 0.0)), (LIFT_COMMAND, LIFT_OFF)}


def test_without_a_lift_only_the_chassis_is_stopped():
    """No frame leaves on a topic that the model does not have; taking the lift off is then nothing."""
    course = Course()
    course.body.ground_stop(course.now_ns)
    course.body.lift_off(course.now_ns)
    assert {topic for topic, _ in course.run(200)} == {CHASSIS_VELOCITY}


def test_the_lift_goes_off_after_its_stop_and_only_then():
    """[0,0] takes the servo off: only where a stop of ours ran; a lift that others drive is not touched."""
    course = Course(model="lift")
    course.body.lift_off(course.now_ns)
    assert course.run(50) == []
    course.body.ground_stop(course.now_ns)
    course.body.lift_off(course.now_ns)
    lift = [values for topic, values in course.run(200) if topic == LIFT_COMMAND]
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
    assert left.error == pytest.approx(Gap(0.5)) and right.error is None
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


# ------------------------------------------------------------------------------------------------ trajectories


class Trip(Course):
    """Both arms on one trajectory; the path tolerance is 0.05 rad for joint 2, none for the others."""

    def __init__(self, *, open_end: bool, rise: float = 0.004) -> None:
        super().__init__(L, R)
        self.points = {side: [tuple(q + rise * n for q in MIDDLE[side]) for n in range(20)] for side in Side}
        path = (math.inf, 0.05, *[math.inf] * 5)
        tolerances = Tolerances(path={L: path, R: path}, goal={s: (0.05,) * 7 for s in Side}, goal_time_ns=S)
        terms = Terms(tolerances=tolerances, ends_ns=self.now_ns + S)
        goals = {side: points[-1] for side, points in self.points.items()}
        self.motion = self.body.motions.open(goals, None, S, terms)
        for side, points in self.points.items():
            trajectory = interpolate(points, [0.05 * n for n in range(20)])
            way = self.body.arms[side].reference.prepare(trajectory, 0.0, rests=not open_end)
            assert way.begin(self.body.arms[side].reference.state)
            self.body.arms[side].follow_chunk(way, 5)

    def look(self, ticks: int, off_rad: float = 0.0, joint: int = 1) -> list[Motion]:
        """Let time pass, the left arm measured so far off its setpoint; return what ended."""
        ended = []
        for _ in range(ticks):
            self.run(1)
            measured = {side: self.body.arms[side].reference.values for side in Side}
            measured[L] = tuple(q + off_rad * (n == joint) for n, q in enumerate(measured[L]))
            ended += self.body.advance_motions(measured, self.now_ns)
        return ended


def test_a_trajectory_of_two_arms_is_reached_by_both():
    """Inside its tolerances all the way."""
    trip = Trip(open_end=False)
    assert trip.look(180, 0.04) == [trip.motion] and trip.motion.state is MotionState.REACHED
    assert trip.modes() == (HOLD, HOLD)


def test_an_arm_too_far_from_the_trajectory_aborts_it_and_both_brake():
    """PATH_TOLERANCE, with the joint, once the arm has joined; joints without a tolerance may be anywhere."""
    trip = Trip(open_end=False)
    assert trip.look(3, 0.5) == [] and not trip.body.arms[L].reference.tracker.has_joined
    trip.look(50, 0.5, joint=3)
    assert trip.motion.is_running and trip.body.arms[L].reference.tracker.has_joined
    assert trip.look(1, 0.06) == [trip.motion] and trip.modes() == (BRAKE, BRAKE)
    assert (trip.motion.state, trip.motion.code) == (MotionState.ABORTED, Code.PATH_TOLERANCE)
    assert trip.motion.message.startswith("left arm joint 2 is 0.0600 rad from the trajectory, 0.05 rad")


def test_an_arm_that_is_not_measured_is_not_off_the_trajectory():
    """Its state being old is the business of others."""
    trip = Trip(open_end=False)
    trip.look(50)
    assert trip.body.advance_motions({L: None, R: None}, trip.now_ns) == [] and trip.motion.is_running


def test_a_chunk_that_ends_in_motion_without_a_successor_is_an_underrun():
    """Both arms brake inside their limits and hold."""
    trip = Trip(open_end=True)
    assert trip.look(120) == [trip.motion]
    assert (trip.motion.state, trip.motion.code) == (MotionState.ABORTED, Code.UNDERRUN)
    trip.run(80)
    assert trip.modes() == (HOLD, HOLD)


def test_an_arm_that_loses_its_trajectory_ends_the_motion_of_both():
    """The other one brakes as well."""
    trip = Trip(open_end=True)
    trip.look(20)
    trip.body.arms[R].reference.tracker.outcome = Outcome.LOST
    assert trip.look(1) == [trip.motion] and trip.motion.code is Code.CANNOT_JOIN
    assert trip.modes()[0] is BRAKE


def test_a_trajectory_whose_arm_was_taken_away_is_left_to_who_took_it():
    """Braked by a cut of this tick: nothing is judged by a trajectory that is gone."""
    trip = Trip(open_end=False)
    trip.look(20)
    for side in Side:
        trip.body.arms[side].brake()
    assert trip.body.advance_motions({L: GOAL[L], R: GOAL[R]}, trip.now_ns) == [] and trip.motion.is_running


# ------------------------------------------------------------------------------------------------ spaces


def test_an_arm_has_a_stream_of_each_space_and_one_of_them_is_its_own():
    """Joints until the robot says otherwise; choosing the other silences the one that runs."""
    body = Body(Settings())
    assert all(body.arms[side] is body.joint_arms[side] for side in Side)
    body.arms[L].start(MIDDLE[L], 0)
    body.choose(L, Space.JOINT)
    assert body.joint_arms[L].running
    body.choose(L, Space.POSE)
    assert body.arms[L] is body.pose_arms[L] and not body.joint_arms[L].running and body.running_arms == ()
    body.choose(L, Space.JOINT)
    assert body.arms == body.joint_arms


def test_a_motion_is_planned_in_the_space_of_each_arm():
    """A mixed robot: the joints of one arm, the end effector of the other; nothing moves by planning."""
    body = Body(Settings())
    body.choose(R, Space.POSE)
    place = (0.3, -0.1, -0.2, 0.0, 0.0, 0.0, 1.0)
    body.arms[L].start(MIDDLE[L], 0)
    body.arms[R].start(place, 0)
    paths = body.plan({L: GOAL[L], R: (0.2, -0.1, -0.2, 0.0, 0.0, 0.0, 1.0)}, 0.5)
    for side, path in paths.items():
        body.arms[side].follow_path(path, 1)
    assert all(path.duration_ns > 0 for path in paths.values())
    assert (body.arms[L].values, body.arms[R].values) == (MIDDLE[L], place)


@pytest.mark.parametrize("space", Space)
def test_arms_of_one_space_are_planned_without_the_other(space):
    """A robot with both arms in one mode; nothing to plan is no plan."""
    body = Body(Settings())
    place = {L: (0.3, 0.1, -0.2, 0.0, 0.0, 0.0, 1.0), R: (0.3, -0.1, -0.2, 0.0, 0.0, 0.0, 1.0)}
    starts = MIDDLE if space is Space.JOINT else place
    for side in Side:
        body.choose(side, space)
        body.arms[side].start(starts[side], 0)
    assert set(body.plan(starts, 1.0)) == {L, R}


def test_a_plan_is_made_in_the_space_of_each_arm():
    """Joints for one, a pose for the other, or both in one request; nothing for an arm that is not named."""
    course = Course(L)
    body = course.body
    body.choose(R, Space.POSE)
    place = (0.3, -0.1, -0.2, 0.0, 0.0, 0.0, 1.0)
    body.arms[R].start(place, course.now_ns)
    further = (0.3, -0.1, -0.25, *place[3:])
    joints, poses = body.plan({L: GOAL[L]}, 1.0), body.plan({R: further}, 1.0)
    assert set(joints) == {L} and set(poses) == {R}
    both = body.plan({L: GOAL[L], R: further}, 1.0)
    assert set(both) == {L, R} and all(path.duration_s > 0.0 for path in both.values())


def test_a_motion_whose_way_is_not_known_yet_is_not_judged():
    """It waits as long as that takes: no progress, no end; from then on as any other."""
    course = Course(L, R)
    motion = course.body.motions.open({L: MIDDLE[L]}, None, 0)
    motion.is_planned = False
    measured = {L: MIDDLE[L], R: MIDDLE[R]}
    assert course.body.advance_motions(measured, course.now_ns + 60 * S) == []
    assert (motion.state, motion.progress) == (MotionState.QUEUED, 0.0)
    motion.is_planned = True
    course.body.advance_motions(measured, course.now_ns)
    assert motion.progress == 1.0


@pytest.mark.parametrize(
    ("arm", "pose", "joints", "hands"),
    [
        ({"v_radps": 0.25}, {}, 0.25, 1.0),
        ({}, {"v_mps": 0.125}, 1.0, 0.5),
        ({}, {"v_mps": 0.125, "w_radps": 0.2}, 1.0, 0.25),
        ({"v_radps": 1.4}, {"v_mps": 0.3, "w_radps": 0.9}, 1.0, 1.0),
    ],
)
def test_speed_limits_that_were_lowered_are_those_of_the_next_plan(arm, pose, joints, hands):
    """As a part of those that the references have; never more. A path under way goes on as it began."""
    course = Course(L, R)
    course.body.choose(R, Space.POSE)
    course.body.arms[R].start(POSE, course.now_ns)
    course.move(L)
    under_way = course.body.arms[L].reference.end_values()
    course.body.renew(Settings(arm=ArmSettings(**arm), pose=PoseSettings(**pose)))
    assert course.body.speed_ratio == {Space.JOINT: joints, Space.POSE: hands}
    assert course.body.arms[L].reference.mode is PATH
    assert course.body.arms[L].reference.end_values() == under_way
    away = (POSE[0], POSE[1], POSE[2] + 0.2, *POSE[3:])
    before = plan_poses({R: course.body.pose_arms[R].reference}, {R: away}, hands)
    assert course.body.plan({R: away}, 1.0)[R].duration_s == pytest.approx(before[R].duration_s)
    slow = plan({L: course.body.joint_arms[L].reference}, {L: MIDDLE[L]}, joints)
    assert course.body.plan_joints({L: MIDDLE[L]}, 1.0)[L].duration_s == pytest.approx(slow[L].duration_s)
