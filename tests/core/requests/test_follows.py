"""Trajectories and chunks: what is followed from when on, what takes over from what, and what is refused without a trace."""

from __future__ import annotations

import math

import pytest

from gateway.core.body.motions import MotionState
from gateway.core.messages.events import SettingsRead
from gateway.core.motion.chunk import Chunk, prepare
from gateway.core.motion.motion import ReferenceMode
from gateway.core.motion.tracker import Outcome
from gateway.core.requests.authorisation import Authorisation
from gateway.core.requests.follows import Follows, worked_out
from gateway.core.requests.moves import Facts, Moves
from gateway.core.supervision.reloading import take_settings
from gateway.core.supervision.supervisor import State
from gateway.errors import Code, Refusal
from gateway.messages.incoming import Until
from gateway.messages.requests import CheckFollow, Follow, Hold, Move, OpenStream
from gateway.values import Side, Space
from tests.changed import replace
from tests.core.stage import GOAL, MIDDLE, MS, PLACE, L, R, S, Stage
from tests.kinematics.guarded_arms import MEET
from tests.spaced import SpacedPair

HOLD, PATH, FOLLOW, CHUNK, BRAKE = ReferenceMode
DT_S = 0.05


def swing(*sides, count=40, size=0.2, rate=1.5, phase_s=0.0, dt_s=DT_S, off_rad=0.0) -> Chunk:
    """A smooth swing of joint 3 from the middle, for these arms."""
    swings = [size * (1.0 - math.cos(rate * (n * dt_s + phase_s))) + off_rad for n in range(count)]
    points = {side: [(*MIDDLE[side][:2], MIDDLE[side][2] + s, *MIDDLE[side][3:]) for s in swings] for side in sides}
    made = prepare(points, dt_s=dt_s)
    assert isinstance(made, Chunk)
    return made


class Scene(Stage):
    """A stage with a place that takes chunks of ann."""

    def __init__(
        self,
        state: State = State.ACTIVE,
        sides: tuple[Side, ...] = (L, R),
        poses: tuple[Side, ...] = (),
        dumb: tuple[Side, ...] = (),
    ) -> None:
        super().__init__(state, sides=sides, poses=poses, dumb=dumb)
        authorisation = Authorisation(self.coordinator, self.phases.starting)
        self.moves = Moves(self.coordinator, authorisation)
        self.follows = Follows(self.coordinator, authorisation, self.moves)
        self.body = self.coordinator.body

    def ask(self, chunk: Chunk, *, sent_ns: int = 0, **how: object) -> Facts | Refusal:
        """Ask to follow a chunk that was sent so long ago."""
        request = Follow(**{"epoch": self.epoch, "points": {}, **how})
        command = replace(self.command(request, received_ns=self.now_ns - sent_ns), chunk=chunk)
        return self.follows.follow(command, request, self.now_ns)

    def check(self, chunk: Chunk, *, from_here: bool = True, **how: object) -> Facts | Refusal:
        """Have a chunk judged by somebody who does not own the robot; nothing may have changed."""
        before = self.look()
        request = CheckFollow(follow=Follow(**{"epoch": 0, "points": {}, **how}), from_here=from_here)
        command = replace(self.command(request, client="bob"), chunk=chunk)
        answer = self.follows.check(command, request, self.now_ns)
        assert self.look() == before, "a check left a trace"
        return answer

    def granted(self, chunk: Chunk, **how: object) -> Facts:
        """Follow a chunk that must be accepted."""
        answer = self.ask(chunk, **how)
        assert not isinstance(answer, Refusal), answer
        return answer

    def refused(self, chunk: Chunk, **how: object) -> Refusal:
        """Ask for what must be refused; nothing may have changed."""
        before = self.look()
        answer = self.ask(chunk, **how)
        assert isinstance(answer, Refusal), answer
        assert self.look() == before, "a refused request left a trace"
        return answer

    def look(self) -> tuple[object, ...]:
        """Everything that a chunk may change."""
        arms = (*self.body.joint_arms.values(), *self.body.pose_arms.values())
        ways = tuple((arm.reference.mode, arm.reference.tracker, arm.values, arm.rates) for arm in arms)
        return self.state, ways, self.body.motions.views(), self.body.targets.views(), len(self.coordinator.notices)

    def modes(self) -> tuple[ReferenceMode, ...]:
        """What moves the left and the right reference."""
        return tuple(self.body.joint_arms[side].reference.mode for side in Side)

    def motion(self, motion_id: object):
        """The record of a motion."""
        return self.body.motions.find(motion_id)


@pytest.fixture
def scene() -> Scene:
    """ACTIVE, both arms at rest in the middle."""
    return Scene()


# ------------------------------------------------------------------------------------------------ accepted


def test_points_that_nobody_has_worked_out_are_worked_out_or_refused(scene):
    """The engine needs nobody's preparation: it only costs it time."""
    points = {L: [MIDDLE[L]] * 3}
    request = Follow(epoch=scene.epoch, points=points, dt_s=0.1)
    answer = scene.follows.follow(scene.command(request), request, scene.now_ns)
    assert answer["duration_ns"] == 200 * MS and worked_out(request) == prepare(points, dt_s=0.1)
    for wrong in (Follow(epoch=scene.epoch, points={}, dt_s=0.1), Follow(epoch=scene.epoch, points=points)):
        check = CheckFollow(follow=wrong)
        for refusal in (
            scene.follows.follow(scene.command(wrong), wrong, scene.now_ns),
            scene.follows.check(scene.command(check), check, scene.now_ns),
        ):
            assert isinstance(refusal, Refusal) and refusal == worked_out(wrong) == worked_out(check)


def test_a_chunk_that_is_to_end_at_a_touch_that_nobody_feels_is_refused_without_a_trace(scene):
    """The rules of touches are `test_touches.py`'s."""
    assert scene.refused(swing(L), until=Until(force_n=8.0)).code is Code.MODEL_OFF


def test_a_chunk_of_both_arms_is_one_motion_on_one_clock(scene):
    """The reply says what the owner needs: motion, duration, beginning, goals, what was skipped and moved."""
    chunk = swing(L, R)
    facts = scene.granted(chunk)
    assert facts["duration_ns"] == round(chunk.duration_s * S) and facts["begins_ns"] == scene.now_ns
    assert facts["skipped"] == 0 and facts["moved"] == 0.0
    assert facts["q_rad"] == {side.value: list(chunk.trajectories[side].points[-1]) for side in Side}
    motion = scene.motion(facts["motion_id"])
    assert tuple(motion.goals) == (L, R) and motion.terms.ends_ns == scene.now_ns + facts["duration_ns"]
    assert scene.modes() == (CHUNK, CHUNK) and scene.body.arms[L].epoch == scene.epoch
    scene.run(100)
    ways = [scene.body.joint_arms[side].reference.tracker for side in Side]
    assert ways[0].time_s == ways[1].time_s == pytest.approx(1.0) and all(way.has_joined for way in ways)


def test_a_chunk_makes_a_held_robot_active():
    """As any motion does."""
    scene = Scene(State.HOLDING)
    scene.granted(swing(L))
    assert scene.state is State.ACTIVE and scene.modes() == (CHUNK, HOLD)


def test_points_whose_time_has_passed_are_skipped(scene):
    """By the clock: from an instant, from the arrival of the request, or because of times that begin later."""
    chunk = swing(L, size=0.05)
    facts = scene.granted(chunk, start_at_ns=scene.now_ns - 320 * MS)
    assert facts["skipped"] == 7 and facts["duration_ns"] == round((chunk.duration_s - 0.32) * S)
    assert scene.body.joint_arms[L].reference.tracker.time_s == pytest.approx(0.32)
    facts = scene.granted(chunk, start_in_ns=-200 * MS, sent_ns=120 * MS)
    assert facts["skipped"] == 7 and facts["begins_ns"] == scene.now_ns - 320 * MS
    facts = scene.granted(replace(chunk, offset_s=0.1), start_in_ns=-200 * MS)
    assert facts["skipped"] == 2 and facts["begins_ns"] == scene.now_ns - 100 * MS


def test_without_a_start_it_begins_now_however_long_the_request_took(scene):
    """Nothing is skipped that nobody meant to be skipped."""
    facts = scene.granted(swing(L), sent_ns=150 * MS)
    assert (facts["begins_ns"], facts["skipped"]) == (scene.now_ns, 0)


def test_tolerances_are_those_asked_for_and_else_the_configured_ones(scene):
    """They stand in the motion's terms."""
    facts = scene.granted(swing(L), path_tolerance={L: (0.2,) * 7}, goal_time_ns=2 * S)
    tolerances = scene.motion(facts["motion_id"]).terms.tolerances
    assert tolerances.path == {L: (0.2,) * 7} and tolerances.goal_time_ns == 2 * S
    assert tolerances.goal == {L: (scene.coordinator.settings.arm.settle_rad,) * 7}


# ------------------------------------------------------------------------------------------------ taking over


def test_a_later_chunk_takes_over_without_a_stop(scene):
    """The earlier motion is superseded; the reference goes on at speed."""
    first = scene.granted(swing(L), open_end=True)["motion_id"]
    scene.run(60)
    speed = scene.body.joint_arms[L].reference.rates[2]
    second = scene.granted(swing(L, phase_s=0.3), open_end=True, start_in_ns=-300 * MS)["motion_id"]
    scene.run(1)
    motion = scene.motion(first)
    assert (motion.state, motion.code) == (MotionState.SUPERSEDED, Code.SUPERSEDED)
    assert scene.motion(second).is_running and scene.body.joint_arms[L].reference.rates[2] > 0.8 * speed > 0.05


def test_a_chunk_ahead_lets_the_one_under_way_go_on_until_it_begins(scene):
    """Judged by where the arm will be then, not by where it is; the one that waited is replaced by a third."""
    scene.granted(swing(L), open_end=True)
    scene.run(50)
    reference = scene.body.joint_arms[L].reference
    under_way = reference.tracker
    scene.granted(swing(L, phase_s=0.8), start_in_ns=300 * MS)
    assert reference.tracker.is_waiting and reference.tracker.under_way is under_way
    scene.granted(swing(L, phase_s=0.9), start_in_ns=400 * MS)
    assert reference.tracker.under_way is under_way
    scene.run(41)
    assert not reference.tracker.is_waiting and reference.tracker.time_s == pytest.approx(0.01)


def test_a_chunk_ahead_of_an_arm_that_rests_waits_there(scene):
    """And begins in time."""
    scene.granted(swing(L), start_in_ns=200 * MS)
    scene.run(20)
    assert scene.body.joint_arms[L].reference.is_at_rest
    scene.run(30)
    assert not scene.body.joint_arms[L].reference.is_at_rest


def test_a_chunk_takes_over_from_moves_and_streams_and_they_from_it(scene):
    """In mid-motion; each ends as superseded."""
    move = Move(epoch=scene.epoch, targets_rad=GOAL, speed=0.2)
    moved = scene.moves.move(scene.command(move), move, scene.now_ns)["motion_id"]
    scene.run(10)
    chunk = scene.granted(swing(L))["motion_id"]
    assert scene.motion(moved).state is MotionState.SUPERSEDED and scene.modes() == (CHUNK, BRAKE)
    stream = OpenStream(epoch=scene.epoch, side=L)
    scene.moves.open_stream(scene.command(stream), stream, scene.now_ns)
    assert scene.motion(chunk).state is MotionState.SUPERSEDED and scene.modes() == (BRAKE, BRAKE)
    scene.run(30)
    scene.granted(swing(L))
    assert not scene.body.targets.running


def test_hold_ends_a_chunk_and_the_arm_brakes(scene):
    """Cancelled, as any motion."""
    motion_id = scene.granted(swing(L, R))["motion_id"]
    scene.run(40)
    hold = Hold(epoch=scene.epoch, sides=(L,))
    scene.moves.hold(scene.command(hold), hold, scene.now_ns)
    assert scene.motion(motion_id).state is MotionState.CANCELLED and scene.modes() == (BRAKE, BRAKE)
    assert all(scene.body.joint_arms[side].reference.tracker is None for side in Side)


# ------------------------------------------------------------------------------------------------ refused


def test_who_may_not_move_may_not_send_chunks(scene):
    """Another epoch, a robot that is not enabled."""
    assert scene.refused(swing(L), epoch=scene.epoch + 1).code is Code.NOT_OWNER
    assert Scene(State.IDLE).refused(swing(L)).code is Code.NOT_ENABLED
    assert Scene(sides=(R,)).refused(swing(L)).code is Code.NOT_ENABLED


@pytest.mark.parametrize(
    ("code", "how"),
    [
        (Code.TOO_LATE, {"start_in_ns": -3 * S}),
        (Code.OUT_OF_RANGE, {"start_in_ns": 11 * S}),
        (Code.WRONG_SHAPE, {"goal_tolerance": {R: (0.1,) * 7}}),
        (Code.OUT_OF_RANGE, {"goal_time_ns": 1}),
    ],
)
def test_what_is_wrong_with_the_wishes_is_refused(scene, code, how):
    """Nothing has changed by then."""
    assert scene.refused(swing(L), **how).code is code


def test_a_motion_beyond_the_limits_is_refused_for_either_arm(scene):
    """The second arm is judged like the first, before the first one moves."""
    fast = swing(L, R, rate=6.0, dt_s=0.02)
    assert scene.refused(fast).code is Code.TOO_FAST
    mixed = replace(swing(L, R), trajectories={**swing(L, R).trajectories, R: fast.trajectories[R]})
    refusal = scene.refused(mixed)
    assert refusal.code is Code.TOO_FAST and refusal.field.startswith("right_arm[")


def test_a_jump_is_refused_for_either_arm(scene):
    """0.1 rad from the reference where it begins: now, at the time it is at now, or where the arm will be then."""
    assert scene.refused(swing(L, off_rad=0.11)).code is Code.JUMP_TOO_FAR
    assert scene.refused(swing(L), start_in_ns=-S).code is Code.JUMP_TOO_FAR
    assert scene.refused(swing(L, off_rad=0.11), start_in_ns=S).code is Code.JUMP_TOO_FAR
    both = swing(L, R)
    mixed = replace(both, trajectories={**both.trajectories, R: swing(R, off_rad=-0.2).trajectories[R]})
    assert scene.refused(mixed).field == "right_arm[0][2]"
    scene.granted(swing(L), open_end=True)
    scene.run(50)
    assert scene.refused(swing(L), start_in_ns=900 * MS).code is Code.JUMP_TOO_FAR


def test_a_chunk_that_cannot_be_joined_is_refused_before_anything_moves(scene):
    """It runs away, or its end at speed leaves no room to brake."""
    rows = [(MIDDLE[L][0] + 0.0999 * n, *MIDDLE[L][1:]) for n in range(16)]
    away = prepare({L: rows}, dt_s=0.1)
    assert scene.refused(away, open_end=True).code is Code.CANNOT_JOIN
    top = scene.coordinator.settings.arm.upper_rad[L][6]
    rows = [(*MIDDLE[L][:6], min(MIDDLE[L][6] + 0.018 * n, top)) for n in range(38)]
    assert scene.refused(prepare({L: rows}, dt_s=1 / 30), open_end=True).code is Code.CANNOT_JOIN


def test_a_chunk_that_waited_and_cannot_be_joined_then_brakes(scene):
    """It was accepted when nobody could know; the motion says so."""
    scene.granted(swing(L), open_end=True)
    rows = [(MIDDLE[L][0] + 0.0999 * n, *MIDDLE[L][1:]) for n in range(16)]
    scene.granted(prepare({L: rows}, dt_s=0.1), start_in_ns=50 * MS, open_end=True)
    scene.run(20)
    assert scene.body.joint_arms[L].reference.tracker.outcome is Outcome.LOST
    assert scene.modes()[0] in (BRAKE, HOLD)


# ------------------------------------------------------------------------------------------------ judged only


@pytest.mark.parametrize("state", [State.IDLE, State.ACTIVE, State.READ_ONLY, State.OFFLINE])
def test_a_chunk_is_judged_for_anybody_in_any_state_and_nothing_moves(state):
    """How long it takes, what smoothing moved, and how far each arm is from where it begins."""
    scene = Scene(state)
    scene.hear()
    chunk = swing(L, R, off_rad=0.05)
    facts = scene.check(chunk)
    assert facts["duration_ns"] == round(chunk.duration_s * S) and facts["skipped"] == 0 and facts["moved"] == 0.0
    for side in ("left", "right"):
        assert facts["away"][side] == pytest.approx([0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize(
    ("chunk", "how"),
    [
        (swing(L, rate=6.0, dt_s=0.02), {}),
        (swing(L), {"start_in_ns": -3 * S}),
        (swing(L), {"goal_tolerance": {R: (0.1,) * 7}}),
        (swing(L, off_rad=0.11), {}),
        (swing(L), {"start_in_ns": -S}),
    ],
    ids=["too fast", "too late", "tolerance", "jump", "jump in its middle"],
)
@pytest.mark.parametrize("is_first_held", [True, False])
def test_what_would_be_refused_is_refused_with_the_same_words(chunk, how, is_first_held):
    """Of an arm that is held as of one that is only measured: point, value, bound and remedy."""
    scene = Scene(sides=(L, R) if is_first_held else (R,))
    scene.hear()
    assert scene.check(chunk, **how) == Scene().refused(chunk, **how)


def test_a_check_knows_where_a_moving_arm_will_be(scene):
    """Like the chunk itself: judged against the motion under way when it begins later."""
    scene.granted(swing(L), open_end=True)
    scene.run(50)
    assert scene.check(swing(L), start_in_ns=900 * MS).code is Code.JUMP_TOO_FAR
    assert scene.check(swing(L, phase_s=0.8), start_in_ns=300 * MS)["away"]["left"][2] < 0.01


def test_an_arm_that_is_moved_there_first_may_be_far_away_or_unseen(scene):
    """Then only the motion itself is judged; how far it is, is still told when it is known."""
    assert scene.check(swing(L, off_rad=0.4), from_here=False)["away"]["left"][2] == pytest.approx(0.4, abs=1e-6)
    unseen = Scene(State.IDLE, dumb=(L,))
    assert unseen.check(swing(L)).code is Code.PART_STALE
    assert unseen.check(swing(L), from_here=False)["away"] == {}
    assert unseen.check(swing(L, rate=6.0, dt_s=0.02), from_here=False).code is Code.TOO_FAST


# ------------------------------------------------------------------------------------------------ poses


FRAMES = {side: f"{side.value}_shoulder_base" for side in Side}


def reach_out(*sides, off_m=0.0, rate=1.2, count=40) -> Chunk:
    """A smooth swing of these end effectors by 4 cm."""
    swings = [0.02 * (1.0 - math.cos(rate * n / 30)) + off_m for n in range(count)]
    points = {side: [(PLACE[side][0] - s, *PLACE[side][1:]) for s in swings] for side in sides}
    made = prepare(points, dt_s=1 / 30, space=Space.POSE)
    assert isinstance(made, Chunk)
    return made


@pytest.fixture
def poses() -> Scene:
    """ACTIVE, the left arm in joint mode, the right one in end-effector mode, both at rest."""
    return Scene(poses=(R,))


def test_a_chunk_of_poses_is_followed_by_an_arm_in_end_effector_mode(poses):
    """The reply has poses for goals; the motion is judged in its space, by the configured tolerances of poses."""
    facts = poses.granted(reach_out(R), frames=FRAMES)
    assert facts["values"]["right"] == list(reach_out(R).trajectories[R].points[-1]) and "q_rad" not in facts
    motion = poses.motion(facts["motion_id"])
    settings = poses.coordinator.settings.pose
    assert motion.space is Space.POSE
    assert motion.terms.tolerances.goal == {R: (settings.settle_m, settings.settle_rad)}
    assert poses.body.arms[R].epoch == poses.epoch
    poses.run(60)
    assert poses.body.pose_arms[R].reference.tracker.has_joined and poses.body.arms[R].reference.progress > 0.3


def test_a_chunk_of_poses_needs_the_arms_own_frame_and_mode(poses):
    """The other arm's frame is another place; joints are not poses."""
    assert poses.refused(reach_out(R)).code is Code.WRONG_FRAME
    assert poses.refused(reach_out(R), frames={R: FRAMES[L]}).code is Code.WRONG_FRAME
    assert poses.refused(reach_out(L), frames=FRAMES).code is Code.WRONG_CONTROL_MODE
    assert poses.refused(swing(R)).code is Code.WRONG_CONTROL_MODE
    tolerances = {R: (0.1,) * 7}
    assert poses.refused(reach_out(R), frames=FRAMES, path_tolerance=tolerances).code is Code.WRONG_SHAPE


def test_a_chunk_of_poses_is_judged_whole(poses):
    """Jump and limits."""
    assert poses.refused(reach_out(R, off_m=0.03), frames=FRAMES).code is Code.JUMP_TOO_FAR
    assert poses.refused(reach_out(R, rate=20.0), frames=FRAMES).code is Code.TOO_FAST
    quick = poses.refused(reach_out(R, rate=7.0), frames=FRAMES)  # 0.98 m/s²: inside the limit, but not along one axis
    assert (quick.code, quick.bound, quick.unit) == (Code.TOO_FAST, "0.840045", "m/s²")
    poses.granted(reach_out(R, rate=6.0), frames=FRAMES)


@pytest.mark.parametrize("is_held", [True, False])
def test_a_chunk_of_poses_is_judged_for_anybody(is_held):
    """Frame, limits, and how far the end effector is from its beginning, in metres and radians."""
    poses = Scene(poses=(R,), sides=(L, R) if is_held else (L,))
    poses.hear()
    assert poses.check(reach_out(R)).code is Code.WRONG_FRAME
    assert poses.check(reach_out(R, rate=20.0), frames=FRAMES).code is Code.TOO_FAST
    assert poses.check(reach_out(R, off_m=0.03), frames=FRAMES).code is Code.JUMP_TOO_FAR
    away = poses.check(reach_out(R, off_m=0.03), frames=FRAMES, from_here=False)["away"]["right"]
    assert away == pytest.approx([0.03, 0.0], abs=1e-6)
    assert poses.check(reach_out(L), frames=FRAMES).code is Code.PART_STALE


def test_a_chunk_is_worked_out_as_it_was_asked_for():
    """Times of its own, slower, smoothed, of end effectors: nothing of a request is lost on the way."""
    points = {L: [MIDDLE[L], GOAL[L], MIDDLE[L]]}
    times_s = (0.0, 1.0, 3.0)
    assert worked_out(Follow(epoch=1, points=points, times_s=times_s)) == prepare(points, times_s=times_s)
    slower = worked_out(Follow(epoch=1, points=points, dt_s=1.0, stretch=2.0))
    assert slower == prepare(points, dt_s=1.0, stretch=2.0) and slower.duration_s == 4.0
    smooth = worked_out(Follow(epoch=1, points=points, dt_s=1.0, smoothing_s=0.5))
    assert smooth == prepare(points, dt_s=1.0, smoothing_s=0.5)
    poses = {L: [PLACE[L]] * 3}
    led = worked_out(Follow(epoch=1, points=poses, dt_s=1.0, space=Space.POSE))
    assert led == prepare(poses, dt_s=1.0, space=Space.POSE) and led.space is Space.POSE


def test_a_chunk_that_ends_where_the_arms_would_meet_is_refused():
    """Its last points are goals; a check says the same."""
    pair = SpacedPair()
    home = pair.coordinator.body.joint_arms
    points = {side: [home[side].values, goal] for side, goal in MEET.items()}
    follow = Follow(epoch=pair.epoch, points=points, dt_s=30.0)
    assert pair.refused(follow).code is Code.GOAL_TOO_NEAR
    assert pair.refused(CheckFollow(follow=follow)).code is Code.GOAL_TOO_NEAR


def test_chunks_are_judged_by_speed_limits_that_were_lowered(scene, poses):
    """Of joints by the limit itself, of poses by the part of it that a target along one axis may have."""
    scene.granted(swing(L))
    take_settings(scene.coordinator, SettingsRead(values={"arm.v_radps": 0.1}, message="", at_ns=1))
    assert scene.refused(swing(L)).code is Code.TOO_FAST
    take_settings(poses.coordinator, SettingsRead(values={"pose.v_mps": 0.02}, message="", at_ns=1))
    assert poses.refused(reach_out(R, rate=2.0), frames=FRAMES).code is Code.TOO_FAST
