"""Motion requests: what moves which arm, what ends what, and what is refused without a trace."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from msgspec.structs import replace

from gateway.core.body.motions import MotionState
from gateway.core.messages.events import SettingsRead, TargetArrived
from gateway.core.messages.outputs import FrameKind
from gateway.core.motion.gap import Gap
from gateway.core.motion.motion import PlanFailed, ReferenceMode
from gateway.core.requests.authorisation import Authorisation
from gateway.core.requests.moves import Facts, Moves
from gateway.core.separation import goal_checks
from gateway.core.supervision.reloading import take_settings
from gateway.core.supervision.supervisor import State
from gateway.errors import Code, Refusal
from gateway.messages.body_views import ContactView
from gateway.messages.incoming import Admittance, OnLimit, Until
from gateway.messages.requests import Cancel, CloseStream, Hold, Move, MovePose, OpenStream
from gateway.robot.limits import HOME_Q_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import joint_command, shoulder_frame
from gateway.values import Side, Space, Vector
from tests.core.stage import GOAL, MIDDLE, MS, PLACE, L, R, S, Stage
from tests.kinematics.guarded_arms import MEET
from tests.spaced import SpacedPair

HOLD, PATH, FOLLOW, CHUNK, BRAKE = ReferenceMode
OUTSIDE: Vector = (9.0, *GOAL[L][1:])


class Scene(Stage):
    """A stage with a place that takes motion requests of ann."""

    def __init__(
        self, state: State = State.ACTIVE, sides: tuple[Side, ...] = (L, R), poses: tuple[Side, ...] = ()
    ) -> None:
        super().__init__(state, sides=sides, poses=poses)
        self.authorisation = Authorisation(self.coordinator, self.phases.starting)
        self.moves = Moves(self.coordinator, self.authorisation)
        self.body = self.coordinator.body

    def ask(self, request: object, client: str = "ann") -> Facts | Refusal:
        """Carry out a motion request now."""
        carry_out = {
            Move: self.moves.move,
            MovePose: self.moves.move_pose,
            OpenStream: self.moves.open_stream,
            CloseStream: self.moves.close_stream,
            Hold: self.moves.hold,
            Cancel: self.moves.cancel,
        }[type(request)]
        return carry_out(self.command(request, client), request, self.now_ns)

    def granted(self, request: object) -> Facts:
        """Carry out a request that must be accepted."""
        answer = self.ask(request)
        assert not isinstance(answer, Refusal), answer
        return answer

    def refused(self, request: object, client: str = "ann") -> Refusal:
        """Ask for what must be refused; nothing may have changed."""
        before = self.look()
        answer = self.ask(request, client)
        assert isinstance(answer, Refusal), answer
        assert self.look() == before, "a refused request left a trace"
        return answer

    def look(self) -> tuple[object, ...]:
        """Everything that a motion request may change."""
        body = self.body
        modes = self.modes()
        return self.state, modes, body.motions.views(), body.targets.views(), len(self.coordinator.notices)

    def move(self, *sides: Side, **how: object) -> int:
        """Begin a motion of these arms to their goals; return its id."""
        motion_id = self.granted(self.to({side: GOAL[side] for side in sides}, **how))["motion_id"]
        assert isinstance(motion_id, int)
        return motion_id

    def to(self, goals: dict[Side, Vector], **how: object) -> Move:
        """A request to move there."""
        return Move(epoch=self.epoch, targets_rad=goals, **how)

    def stream(self, side: Side = L, **how: object) -> int:
        """Open a stream; return its id."""
        stream_id = self.granted(OpenStream(epoch=self.epoch, side=side, **how))["stream_id"]
        assert isinstance(stream_id, int)
        return stream_id

    def target(self, stream_id: int, seq: int = 1, q_rad: Vector = GOAL[L], received_ns: int | None = None) -> None:
        """A target of ann's arrives."""
        at_ns = self.now_ns if received_ns is None else received_ns
        self.moves.take_target(
            TargetArrived(
                client_id="ann", stream_id=stream_id, epoch=self.epoch, seq=seq, values=q_rad, received_ns=at_ns
            ),
            self.now_ns,
        )

    def modes(self) -> tuple[ReferenceMode, ...]:
        """What moves the left and the right reference."""
        return tuple(self.body.arms[side].reference.mode for side in Side)

    def state_of(self, motion_id: int) -> MotionState:
        """Where a motion is in its life."""
        motion = self.body.motions.find(motion_id)
        assert motion is not None
        return motion.state


@pytest.fixture
def scene() -> Scene:
    """Ann owns the robot, both arms stream, nothing moves."""
    return Scene()


# ------------------------------------------------------------------------------------------------ move


@pytest.mark.parametrize("sides", [(L,), (R,), (L, R)])
def test_a_motion_moves_the_named_arms_and_no_other(scene, sides):
    """The reply says which motion it is, how long it takes and where it goes."""
    facts = scene.granted(scene.to({side: GOAL[side] for side in sides}))
    assert scene.modes() == tuple(PATH if side in sides else HOLD for side in Side)
    assert facts["motion_id"] == 1 and facts["clipped"] == {}
    assert facts["q_rad"] == {side.value: list(GOAL[side]) for side in sides}
    scene.run(math.ceil(facts["duration_ns"] / (10 * MS)) - 1)
    assert scene.modes() != (HOLD, HOLD)
    scene.run(1)
    assert scene.modes() == (HOLD, HOLD)
    assert all(scene.body.arms[side].reference.values == pytest.approx(GOAL[side]) for side in sides)


def test_a_motion_carries_the_epoch_of_its_owner(scene):
    """The gate lets motion frames of the current epoch pass only (DESIGN §8.3)."""
    scene.move(L)
    frames = [frame for frame in scene.run(5) if frame.topic == joint_command(L)]
    assert {(frame.kind, frame.epoch) for frame in frames} == {(FrameKind.MOTION, scene.epoch)}


def test_a_motion_without_an_arm_is_refused(scene):
    """Asked before anything else: it is the caller's mistake in every state."""
    refusal = scene.refused(scene.to({}))
    assert (refusal.code, refusal.field) == (Code.WRONG_SHAPE, "targets_rad")


def test_only_the_owner_moves(scene):
    """Everybody else is told whose robot it is."""
    assert scene.refused(scene.to(GOAL), client="bob").code is Code.NOT_OWNER


@pytest.mark.parametrize(
    ("how", "code", "field"),
    [
        ({"speed": 0.0}, Code.OUT_OF_RANGE, "speed"),
        ({"speed": math.nan}, Code.NOT_FINITE, "speed"),
        ({"tolerance_rad": 0.3}, Code.OUT_OF_RANGE, "tolerance_rad"),
    ],
)
def test_speed_and_tolerance_pass_the_door(scene, how, code, field):
    """Factors outside their range are refused, never clipped."""
    refusal = scene.refused(scene.to(GOAL, **how))
    assert (refusal.code, refusal.field) == (code, field)


@pytest.mark.parametrize(
    ("goal", "code"),
    [(OUTSIDE, Code.OUT_OF_RANGE), (GOAL[L][:6], Code.WRONG_SHAPE), ((math.inf, *GOAL[L][1:]), Code.NOT_FINITE)],
)
@pytest.mark.parametrize("relative", [False, True])
def test_a_motion_of_two_arms_begins_for_both_or_for_none(scene, goal, code, relative):
    """A bad goal of one arm refuses the motion of both; offsets are judged as the goals that they mean."""
    assert scene.refused(scene.to({L: goal, R: MIDDLE[R]}, relative=relative)).code is code
    assert scene.modes() == (HOLD, HOLD)


def test_a_relative_motion_starts_at_the_reference_not_at_the_measured_arm(scene):
    """The arm sags under gravity: offsets from the measured state would ratchet it down."""
    scene.push(L, 0.1)
    offset = (0.2, -0.1, 0.0, 0.0, 0.0, 0.0, 0.0)
    facts = scene.granted(scene.to({L: offset}, relative=True))
    assert facts["q_rad"] == {"left": [a + b for a, b in zip(MIDDLE[L], offset, strict=True)]}


def test_a_goal_where_the_arms_would_meet_is_refused_and_what_is_under_way_goes_on():
    """Where arms are kept apart: validation is before the plan, and nothing is superseded."""
    pair = SpacedPair()
    first = pair.move(pair.epoch, HOME_Q_RAD, speed=0.3)
    refusal = pair.refused(Move(epoch=pair.epoch, targets_rad=MEET))
    assert refusal.code is Code.GOAL_TOO_NEAR
    (motion,) = pair.coordinator.body.motions.running
    assert motion.motion_id == first


def test_clipping_is_asked_for_and_reported(scene):
    """Per arm and by joint; an arm that needed none is not mentioned (DESIGN §10)."""
    facts = scene.granted(scene.to({L: OUTSIDE, R: GOAL[R]}, on_limit=OnLimit.CLIP))
    assert facts["clipped"] == {"left": [0]}
    assert facts["q_rad"]["left"] == [JOINT_UPPER_RAD[L][0], *GOAL[L][1:]]


def test_a_motion_that_cannot_be_planned_is_refused_with_the_reason(scene, monkeypatch):
    """Whatever runs goes on."""
    scene.move(L)
    scene.run(5)

    def fail(*_):
        raise PlanFailed("there is no plan")

    monkeypatch.setattr("gateway.core.body.body.plan", fail)
    refusal = scene.refused(scene.to(GOAL))
    assert refusal.code is Code.PLAN_FAILED and "there is no plan" in refusal.message
    assert scene.modes() == (PATH, HOLD)


def test_speed_and_tolerance_hold_for_the_motion(scene):
    """Half the speed takes longer; the tolerance is the one that was asked for, else the configured one."""
    usual, slow = scene.move(L), scene.move(R, speed=0.25, tolerance_rad=0.01)
    first, second = scene.body.motions.find(usual), scene.body.motions.find(slow)
    assert first is not None and second is not None
    assert second.duration_ns > 2 * first.duration_ns
    assert (first.tolerance, second.tolerance) == (Gap(0.05), Gap(0.01))


def test_a_held_robot_becomes_active_with_a_motion():
    """HOLDING goes on explicitly: by a motion that is opened afterwards (BEHAVIOUR, arm motion)."""
    scene = Scene(State.HOLDING)
    scene.move(L)
    assert scene.state is State.ACTIVE


def test_a_later_motion_takes_the_arm_over_without_a_stop(scene):
    """The earlier one is SUPERSEDED and told; the arm's reference goes on from where it is."""
    first = scene.move(L)
    scene.run(30)
    before = scene.body.arms[L].reference.rates
    second = scene.move(L)
    assert (scene.state_of(first), scene.state_of(second)) == (MotionState.SUPERSEDED, MotionState.QUEUED)
    assert scene.modes() == (PATH, HOLD) and scene.body.arms[L].reference.rates == before != (0.0,) * 7
    assert scene.told(Code.MOTION_ENDED) == [f"motion {first} superseded: a later motion took the arm over"]


def test_taking_one_arm_of_a_shared_motion_over_makes_the_other_brake(scene):
    """A motion of two arms ends for both, once (BEHAVIOUR, two arms in one motion)."""
    first = scene.move(L, R)
    scene.run(30)
    scene.move(R)
    assert scene.state_of(first) is MotionState.SUPERSEDED and scene.modes() == (BRAKE, PATH)
    assert len(scene.told(Code.MOTION_ENDED)) == 1


def test_a_motion_ends_the_stream_of_its_arm(scene):
    """Later targets get STREAM_ENDED; the other arm's stream stays."""
    left, right = scene.stream(L), scene.stream(R)
    scene.move(L)
    assert [view.code for view in scene.body.targets.views()] == ["SUPERSEDED", ""]
    assert (left, right) == (1, 2) and scene.body.targets.of(R) is not None


# ------------------------------------------------------------------------------------------------ streams of targets


def test_a_stream_starts_at_the_present_reference(scene):
    """The reply says where that is, so that the first target can be near it; nothing moves before the first target."""
    facts = scene.granted(OpenStream(epoch=scene.epoch, side=R))
    assert facts == {"stream_id": 1, "values": list(MIDDLE[R])}
    assert scene.modes() == (HOLD, HOLD)


@pytest.mark.parametrize(
    ("how", "field"), [({"speed": 1.5}, "speed"), ({"expiry_ns": 4 * S}, "expiry_ns"), ({"epoch": 9}, "epoch")]
)
def test_a_stream_passes_the_door_or_is_not_opened(scene, how, field):
    """Speed, expiry and lease are asked; a refused one leaves what drives the arm alone."""
    scene.move(L)
    request = OpenStream(**{"epoch": scene.epoch, "side": L, **how})
    assert scene.refused(request).field == field
    assert scene.modes() == (PATH, HOLD)


def test_a_stream_keeps_what_it_was_opened_with(scene):
    """Speed, limits and expiry are the stream's; it belongs to who opened it, under his epoch."""
    stream_id = scene.stream(R, speed=0.5, on_limit=OnLimit.CLIP, expiry_ns=200 * MS)
    stream = scene.body.targets.find(stream_id)
    assert stream is not None
    assert (stream.side, stream.client_id, stream.epoch) == (R, "ann", scene.epoch)
    assert (stream.speed, stream.on_limit, stream.expiry_ns) == (0.5, OnLimit.CLIP, 200 * MS)


def test_a_stream_takes_its_arm_over(scene):
    """From a motion, which is SUPERSEDED and brakes, and from an earlier stream; HOLDING becomes ACTIVE."""
    motion = scene.move(L, R)
    scene.run(30)
    first = scene.stream(L)
    assert scene.state_of(motion) is MotionState.SUPERSEDED and scene.modes() == (BRAKE, BRAKE)
    assert scene.told(Code.MOTION_ENDED) == [f"motion {motion} superseded: a stream took the arm over"]
    second = scene.stream(L)
    assert [(view.stream_id, view.code) for view in scene.body.targets.views()] == [(first, "SUPERSEDED"), (second, "")]
    held = Scene(State.HOLDING)
    held.stream(L)
    assert held.state is State.ACTIVE


def test_a_target_is_followed_at_its_streams_speed_and_epoch(scene):
    """The arm of the stream moves, and no other."""
    scene.target(scene.stream(L, speed=0.5))
    assert scene.modes() == (FOLLOW, HOLD)
    kinds = {(frame.kind, frame.epoch) for frame in scene.run(30) if frame.topic == joint_command(L)}
    assert kinds == {(FrameKind.MOTION, scene.epoch)}
    assert 0.1 < max(scene.body.arms[L].reference.rates) <= 0.5


@pytest.mark.parametrize("early_ns", [0, 3 * MS])
def test_a_stream_tells_how_early_a_target_came_for_its_setpoint(scene, early_ns):
    """Measured to the instant of the grid, not to a late tick: a commander can be just in time for the next one."""
    stream_id = scene.stream()
    record = scene.body.targets.find(stream_id)
    assert record.lead_ns is None
    scene.run(1)
    due_ns = scene.body.arms[L].next_due_ns()
    scene.now_ns = due_ns + 2 * MS
    scene.target(stream_id, received_ns=due_ns - early_ns)
    assert record.lead_ns == early_ns and record.view().lead_ns == early_ns
    scene.run(1)
    scene.target(stream_id, seq=2, received_ns=scene.now_ns)
    assert record.lead_ns == scene.body.arms[L].next_due_ns() - scene.now_ns > 0


def test_a_target_for_an_arm_that_is_silent_has_no_setpoint_to_be_in_time_for(scene):
    """Then there is nothing to tell."""
    stream_id = scene.stream()
    scene.body.arms[L].stop()
    scene.target(stream_id)
    assert scene.body.targets.find(stream_id).lead_ns is None


def test_a_target_that_arrived_before_a_stop_is_dropped(scene):
    """Nobody is told: it was right when it was sent. It moves nothing and never will (DESIGN §8.5)."""
    stream_id = scene.stream(L)
    scene.authorisation.note_stop(scene.now_ns)
    scene.target(stream_id)
    (view,) = scene.body.targets.views()
    assert (view.seq, view.refused, scene.modes()) == (0, 0, (HOLD, HOLD))
    scene.target(stream_id, received_ns=scene.now_ns + 1)
    assert scene.modes() == (FOLLOW, HOLD)


def test_a_target_that_the_door_refuses_moves_nothing(scene):
    """Its stream says why."""
    scene.target(scene.stream(L), q_rad=OUTSIDE)
    (view,) = scene.body.targets.views()
    assert (view.refusal_code, scene.modes()) == ("OUT_OF_RANGE", (HOLD, HOLD))


def test_a_target_moves_nothing_outside_of_active(scene):
    """Whatever left a stream open: no motion without ACTIVE (DESIGN §8.3)."""
    stream_id = scene.stream(L)
    scene.coordinator.go(State.HOLDING, scene.now_ns, "test")
    scene.target(stream_id)
    assert scene.modes() == (HOLD, HOLD)


def test_a_closed_stream_lets_its_arm_brake_and_hold(scene):
    """Its end is CANCELLED; closing it again says the same."""
    stream_id = scene.stream(L)
    scene.target(stream_id)
    scene.run(30)
    close = CloseStream(epoch=scene.epoch, stream_id=stream_id)
    assert scene.granted(close) == {"code": "CANCELLED"} and scene.modes() == (BRAKE, HOLD)
    scene.run(100)
    scene.move(L)
    assert scene.granted(close) == {"code": "CANCELLED"} and scene.modes() == (PATH, HOLD)


def test_a_stream_that_ended_otherwise_keeps_the_reason_of_its_end(scene):
    """Closing it afterwards is no mistake."""
    stream_id = scene.stream(L)
    scene.move(L)
    assert scene.granted(CloseStream(epoch=scene.epoch, stream_id=stream_id)) == {"code": "SUPERSEDED"}
    assert scene.modes() == (PATH, HOLD)


# ------------------------------------------------------------------------------------------------ hold, cancel


def test_hold_brakes_the_named_arms_and_no_other(scene):
    """Their motions are CANCELLED; the other arm's goes on."""
    left, right = scene.move(L), scene.move(R)
    scene.run(30)
    assert scene.granted(Hold(epoch=scene.epoch, sides=(R,))) == {}
    assert (scene.state_of(left), scene.state_of(right)) == (MotionState.QUEUED, MotionState.CANCELLED)
    assert scene.modes() == (PATH, BRAKE)
    assert scene.told(Code.MOTION_ENDED) == [f"motion {right} cancelled: hold was asked for"]


def test_a_hold_of_no_arm_is_refused(scene):
    """Whoever forgot to name them must not take it for a hold."""
    motion = scene.move(L)
    refusal = scene.refused(Hold(epoch=scene.epoch, sides=()))
    assert (refusal.code, refusal.field) == (Code.WRONG_SHAPE, "sides")
    assert scene.state_of(motion) is MotionState.QUEUED


def test_hold_brakes_an_arm_that_nobody_drives(scene):
    """A walk back to the arm is motion, too; an arm that does not stream stays silent."""
    one = Scene(State.ACTIVE, sides=(L,))
    one.push(L, 0.5)
    one.run(5)
    assert one.phases.starting.walk(one.now_ns) is None
    one.run(20)
    one.granted(Hold(epoch=one.epoch, sides=(L, R)))
    assert one.modes() == (BRAKE, HOLD) and not one.body.is_walking
    assert not one.body.arms[R].running


def test_a_cancelled_motion_brakes_and_holds(scene):
    """Both arms of a shared one; the reply says how it ended, and says the same when asked again."""
    motion_id = scene.move(L, R)
    scene.run(30)
    cancel = Cancel(epoch=scene.epoch, motion_id=motion_id)
    assert scene.granted(cancel) == {"state": "cancelled"} and scene.modes() == (BRAKE, BRAKE)
    assert scene.granted(cancel) == {"state": "cancelled"}
    assert scene.told(Code.MOTION_ENDED) == [f"motion {motion_id} cancelled: cancelled by the owner"]


def test_cancelling_a_motion_that_ended_touches_no_later_one(scene):
    """The reply says how it ended; the motion that took the arm over goes on."""
    first = scene.move(L)
    scene.move(L)
    assert scene.granted(Cancel(epoch=scene.epoch, motion_id=first)) == {"state": "superseded"}
    assert scene.modes() == (PATH, HOLD)


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        (CloseStream(epoch=1, stream_id=9), Code.UNKNOWN_STREAM),
        (Cancel(epoch=1, motion_id=9), Code.UNKNOWN_MOTION),
    ],
)
def test_what_never_was_cannot_be_ended(scene, request_, code):
    """The number is named."""
    refusal = scene.refused(request_)
    assert refusal.code is code and "9" in refusal.message


@pytest.mark.parametrize(
    "request_", [CloseStream(epoch=1, stream_id=1), Cancel(epoch=1, motion_id=1), Hold(epoch=1, sides=(L, R))]
)
def test_only_the_owner_ends_motions(scene, request_):
    """Everybody else has stop(), which latches."""
    scene.move(R)
    scene.stream(L)
    assert scene.refused(request_, client="bob").code is Code.NOT_OWNER
    assert scene.modes() == (HOLD, PATH)


# ------------------------------------------------------------------------------------------------ poses


FRAMES = {side: f"{side}_shoulder_base" for side in Side}
AWAY = {L: (0.2, 0.1, -0.1, 0.0, 0.0, 0.6, 0.8), R: (0.2, -0.1, -0.1, 0.0, 0.0, 0.0, 1.0)}


def to_pose(scene, targets, **how):
    """A request for end effectors, in their own frames unless told otherwise."""
    return MovePose(**{"epoch": scene.epoch, "targets": targets, "frames": FRAMES, **how})


@pytest.mark.parametrize("sides", [(L,), (R,), (L, R)])
def test_end_effectors_are_moved_to_their_goals(sides):
    """Both arms of one motion together; the reply has the goals as they are used."""
    scene = Scene(poses=(L, R))
    facts = scene.granted(to_pose(scene, {side: AWAY[side] for side in sides}))
    assert facts["values"] == {side.value: list(AWAY[side]) for side in sides} and facts["clipped"] == {}
    motion = scene.body.motions.find(facts["motion_id"])
    assert motion.space is Space.POSE and motion.tolerance == Gap(0.05, 0.005)
    scene.run(facts["duration_ns"] // (10 * MS) + 3)
    for side in Side:
        wanted = AWAY[side] if side in sides else PLACE[side]
        assert scene.body.arms[side].values == pytest.approx(wanted)


def test_a_pose_motion_settles_within_the_tolerance_it_was_asked_with():
    """Both figures, or each for itself."""
    scene = Scene(poses=(L, R))
    for how, gap in (
        ({"tolerance_m": 0.002, "tolerance_rad": 0.03}, Gap(0.03, 0.002)),
        ({"tolerance_m": 0.002}, Gap(0.05, 0.002)),
        ({"tolerance_rad": 0.03}, Gap(0.03, 0.005)),
    ):
        facts = scene.granted(to_pose(scene, {L: AWAY[L]}, **how))
        assert scene.body.motions.find(facts["motion_id"]).tolerance == gap


def test_a_position_beyond_the_reach_is_clipped_when_that_was_asked_for():
    """And named in the reply."""
    scene = Scene(poses=(L,))
    facts = scene.granted(to_pose(scene, {L: (0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)}, on_limit=OnLimit.CLIP))
    assert facts["clipped"] == {"left": [0, 1, 2]} and facts["values"]["left"][0] == pytest.approx(0.55)


@pytest.mark.parametrize(
    ("how", "code", "field"),
    [
        ({"targets": {}}, Code.WRONG_SHAPE, "targets"),
        ({"targets": {L: (0.0,) * 6}}, Code.WRONG_SHAPE, "left_arm"),
        ({"targets": {L: (0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)}}, Code.OUT_OF_RANGE, "left_arm.p_m"),
        ({"frames": {}}, Code.WRONG_FRAME, "left_arm.frame"),
        ({"frames": {L: "right_shoulder_base"}}, Code.WRONG_FRAME, "left_arm.frame"),
        ({"speed": 0.0}, Code.OUT_OF_RANGE, "speed"),
        ({"tolerance_m": 1.0}, Code.OUT_OF_RANGE, "tolerance_m"),
        ({"targets": {R: AWAY[R]}}, Code.WRONG_CONTROL_MODE, "right_arm"),
    ],
)
def test_a_pose_motion_that_cannot_be_is_refused(how, code, field):
    """Nothing has changed."""
    scene = Scene(poses=(L,))
    refusal = scene.refused(to_pose(scene, **{"targets": {L: AWAY[L]}, **how}))
    assert (refusal.code, refusal.field) == (code, field)


def test_a_pose_motion_that_cannot_be_planned_is_refused(monkeypatch):
    """With the planner's words."""
    scene = Scene(poses=(L,))

    def fail(*_):
        raise PlanFailed("there is no plan")

    monkeypatch.setattr("gateway.core.body.body.plan_poses", fail)
    assert scene.refused(to_pose(scene, {L: AWAY[L]})).code is Code.PLAN_FAILED


def test_a_stream_of_poses_starts_at_the_present_reference_and_is_followed():
    """In the frame of its arm; a target beyond the reach is refused by the stream."""
    scene = Scene(poses=(R,))
    request = OpenStream(epoch=scene.epoch, side=R, space=Space.POSE, frame=FRAMES[R])
    facts = scene.granted(request)
    assert facts == {"stream_id": 1, "values": list(PLACE[R])}
    scene.target(1, seq=1, q_rad=AWAY[R])
    scene.run(300)
    assert scene.body.arms[R].values == pytest.approx(AWAY[R])
    scene.target(1, seq=2, q_rad=(0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert scene.body.targets.find(1).refusal.field == "right_arm.p_m"


@pytest.mark.parametrize("frame", ["", "left_shoulder_base"])
def test_a_stream_of_poses_needs_the_frame_of_its_arm(frame):
    """The other arm's would be another place."""
    scene = Scene(poses=(R,))
    assert scene.refused(OpenStream(epoch=scene.epoch, side=R, space=Space.POSE, frame=frame)).code is Code.WRONG_FRAME


def test_a_goal_that_leaves_too_little_room_is_refused_without_a_trace(monkeypatch):
    """What keeps parts of the body apart is asked about all goals of a motion, before anything ends or begins."""
    scene, asked = Scene(), []
    too_near = Refusal(code=Code.GOAL_TOO_NEAR, message="two parts")

    def check_goals(coordinator, goals, now_ns):
        asked.append((coordinator, dict(goals), now_ns))
        return too_near

    monkeypatch.setattr(goal_checks, "check_goals", check_goals)
    request = Move(epoch=scene.epoch, targets_rad={L: GOAL[L]})
    assert scene.ask(request) is too_near
    assert asked == [(scene.coordinator, {L: GOAL[L]}, scene.now_ns)]
    assert scene.body.motions.running == ()


def test_a_stream_obeys_a_lowered_speed_limit_from_its_next_target_on():
    """As it obeys a lower speed of its own; acceleration and jerk are what they were."""
    scene = Scene()
    stream_id = scene.granted(OpenStream(epoch=scene.epoch, side=L))["stream_id"]
    take_settings(scene.coordinator, SettingsRead(values={"arm.v_radps": 0.2}, message="", at_ns=1))
    scene.target(stream_id, seq=1, q_rad=GOAL[L])
    rates = []
    for _ in range(350):
        scene.run(1)
        rates.append(max(map(abs, scene.body.arms[L].rates)))
    assert max(rates) == pytest.approx(0.2) and scene.body.arms[L].values == pytest.approx(GOAL[L])


def test_what_is_to_end_at_a_touch_that_nobody_feels_is_refused_without_a_trace():
    """Motions and streams; the rules of touches are `test_touches.py`'s."""
    scene, until = Scene(), Until(force_n=8.0)
    for request in (
        scene.to({L: GOAL[L]}, until=until),
        OpenStream(epoch=scene.epoch, side=L, until=until),
    ):
        assert scene.refused(request).code is Code.MODEL_OFF


# ------------------------------------------------------------------------------------------------ a hand that yields


def test_a_hand_that_yields_takes_targets_as_anchors():
    """Its stream starts where the arm comes to rest; a target moves nothing by itself (`test_admitting.py`)."""
    scene = Scene(poses=(L, R))
    seen = ContactView(state="known", wrench=(0.0,) * 6, wrench_sd=(1.0,) * 6)
    scene.coordinator.model = SimpleNamespace(contacts=SimpleNamespace(view=lambda side, now_ns: seen))
    wish = Admittance(mass=(5.0,) * 3 + (0.1,) * 3, damping=(150.0,) * 3 + (20.0,) * 3, stiffness=(0.0,) * 6)
    how = {"epoch": scene.epoch, "side": L, "space": Space.POSE, "frame": shoulder_frame(L)}
    facts = scene.granted(OpenStream(**how, admittance=wish))
    assert facts["values"] == list(PLACE[L])
    anchor = (0.4, *PLACE[L][1:])
    scene.target(facts["stream_id"], 1, anchor)
    assert scene.modes() == (HOLD, HOLD)
    assert scene.body.targets.find(facts["stream_id"]).mass.anchor == anchor
    assert scene.refused(OpenStream(**how, admittance=replace(wish, mass=(None,) * 6))).code is Code.BAD_REQUEST
    scene.coordinator.model = None
    assert scene.refused(OpenStream(**how, admittance=wish)).code is Code.MODEL_OFF


def test_a_hand_at_the_end_of_its_reach_has_an_anchor_that_may_be_said_again(monkeypatch):
    """Rounding of a setpoint there may be beyond it, and a target must not."""
    scene = Scene(poses=(L, R))
    seen = ContactView(state="known", wrench=(0.0,) * 6, wrench_sd=(1.0,) * 6)
    scene.coordinator.model = SimpleNamespace(contacts=SimpleNamespace(view=lambda side, now_ns: seen))
    far = (scene.coordinator.settings.pose.reach_m + 1e-10, 0.0, 0.0, *PLACE[L][3:])
    monkeypatch.setattr(scene.body.arms[L].reference, "rest_values", lambda: far)
    wish = Admittance(mass=(5.0,) * 3 + (None,) * 3, damping=(150.0,) * 6, stiffness=(0.0,) * 6)
    how = {"epoch": scene.epoch, "side": L, "space": Space.POSE, "frame": shoulder_frame(L)}
    facts = scene.granted(OpenStream(**how, admittance=wish))
    scene.target(facts["stream_id"], 1, tuple(facts["values"]))
    assert scene.body.targets.find(facts["stream_id"]).mass.anchor == tuple(facts["values"])
