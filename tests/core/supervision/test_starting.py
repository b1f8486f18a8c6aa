"""Starting: streams begin where their arms are, all or none; held references walk back and are never seeded anew."""

from __future__ import annotations

from itertools import pairwise

import pytest

from gateway.core.body import body
from gateway.core.messages.outputs import Frame, FrameKind, Level
from gateway.core.motion.gap import Gap
from gateway.core.motion.motion import PlanFailed
from gateway.core.streams.heartbeat import Beat
from gateway.core.supervision.starting import WALK_SPEED, Starting
from gateway.core.supervision.supervisor import State
from gateway.errors import Code, Refusal
from gateway.robot.limits import JOINT_UPPER_RAD
from gateway.robot.topics import gripper_command, joint_command
from gateway.values import Side, Space, Vector
from tests.core.stage import MIDDLE, PLACE, L, R, Stage

TOP_RAD = JOINT_UPPER_RAD[L][0]
"""Upper limit of the first joint, the one that `push` moves; the right arm's is the same [rad]."""
TICK_S = 0.01


class Scene(Stage):
    """A stage with somebody who begins streams."""

    def __init__(self, state: State = State.HOLDING, **how: object) -> None:
        super().__init__(state, **how)
        self.starting = Starting(self.coordinator)

    @property
    def running(self) -> set[Side]:
        """Arms whose streams run."""
        return {side for side, arm in self.coordinator.body.arms.items() if arm.running}

    @property
    def walking(self) -> set[Side]:
        """Arms whose references are being led back."""
        return {side for side, arm in self.coordinator.body.arms.items() if arm.is_walking}

    def reference(self, side: Side) -> Vector:
        """Where an arm's last setpoint is [rad]."""
        return self.coordinator.body.arms[side].reference.values

    def arm_frames(self, side: Side, ticks: int) -> list[Frame]:
        """Let time pass; return an arm's setpoints."""
        return [frame for frame in self.run(ticks) if frame.topic == joint_command(side)]


# ------------------------------------------------------------------------------------------------ seed


@pytest.mark.parametrize("sides", [(), (L,), (R,), (L, R)])
def test_a_silent_stream_starts_at_its_measured_position_and_no_other_starts(sides):
    """Where the arm is, not where the middle or an older reference is (BEHAVIOUR, starting)."""
    scene = Scene(State.IDLE)
    scene.push(L, 0.2)
    scene.push(R, -0.3)
    assert scene.starting.seed(sides, scene.now_ns) is None
    assert scene.running == set(sides) and scene.coordinator.notices == []
    for side in sides:
        first, second = scene.arm_frames(side, 2)
        assert first.kind is second.kind is FrameKind.ECHO
        assert first.values == second.values == scene.q_rad[side] != MIDDLE[side]


def test_an_arm_whose_silence_the_robot_has_not_noticed_goes_on_from_its_last_setpoint():
    """A torque holds it off its setpoint: the place where it is would be a step; the other arm starts where it is."""
    scene = Scene(State.IDLE)
    scene.starting.seed((L, R), scene.now_ns)
    held = {side: scene.arm_frames(side, 1)[-1].values for side in (L, R)}
    scene.coordinator.body.silence_arms()
    scene.push(L, TOP_RAD + 0.04)
    scene.push(R, 0.1)
    assert scene.starting.seed((L, R), scene.now_ns, unnoticed=(L,)) is None
    assert scene.reference(L) == held[L] and scene.reference(R) == scene.q_rad[R] != held[R]
    assert scene.arm_frames(L, 1)[-1].values == held[L]
    assert scene.coordinator.notices == []


@pytest.mark.parametrize(("by_rad", "start_rad"), [(TOP_RAD + 0.04, TOP_RAD), (-TOP_RAD - 0.04, -TOP_RAD)])
def test_an_arm_just_outside_a_limit_starts_at_the_limit_and_it_is_told(by_rad, start_rad):
    """Noise at the end of a range is no reason to refuse; the other joints start where they are."""
    scene = Scene(State.IDLE)
    scene.push(L, by_rad)
    assert scene.starting.seed((L, R), scene.now_ns) is None
    assert scene.reference(L) == (start_rad, *scene.q_rad[L][1:])
    assert scene.reference(R) == scene.q_rad[R]
    (notice,) = scene.coordinator.notices
    assert (notice.code, notice.level, notice.at_ns) == (Code.START_AT_LIMIT, Level.WARNING, scene.now_ns)
    assert notice.message == f"left arm joint 1 was found just outside its limit and starts at {start_rad:.3f} rad"


@pytest.mark.parametrize("outside", list(Side))
def test_no_arm_starts_when_one_of_them_is_far_outside(outside):
    """All or none: the refusal names arm, joint and bound."""
    scene = Scene(State.IDLE)
    scene.push(outside, TOP_RAD + 0.1)
    refusal = scene.starting.seed((L, R), scene.now_ns)
    assert isinstance(refusal, Refusal)
    assert (refusal.code, refusal.field) == (Code.START_OUTSIDE_LIMITS, f"{outside}_arm[0]")
    assert scene.running == set() and scene.coordinator.notices == []


def test_an_arm_that_was_never_heard_cannot_be_started():
    """Whoever starts it has not asked whether it may be believed."""
    scene = Scene(State.IDLE, dumb={R})
    with pytest.raises(AssertionError, match="the right arm was believed before its first sample"):
        scene.starting.seed((L, R), scene.now_ns)
    assert scene.running == set()


# ------------------------------------------------------------------------------------------------ join


def test_an_arm_that_is_enabled_again_joins_the_held_one():
    """It starts where it is; the held one goes on from its last setpoint though it sags: it is never seeded anew."""
    scene = Scene(sides=(L,))
    scene.push(L, -0.1)
    scene.push(R, 0.2)
    moving = scene.starting.join(scene.now_ns)
    assert moving is not None and moving.code is Code.PART_STALE, "its samples do not agree yet"
    scene.run(5)
    assert scene.starting.join(scene.now_ns) is None
    assert scene.running == {L, R} and set(scene.coordinator.enable.sides) == {L, R}
    assert (scene.reference(L), scene.reference(R)) == (MIDDLE[L], scene.q_rad[R])
    assert [frame.kind for frame in scene.arm_frames(R, 2)] == [FrameKind.ECHO, FrameKind.HOLD]


@pytest.mark.parametrize(
    "mode",
    [{"arm_enabled": {L: True, R: False}}, None],
)
def test_an_arm_that_the_robot_has_not_enabled_does_not_join(mode):
    """Disabled, or not known: what is held goes on, which is no refusal."""
    scene = Scene(sides=(L,))
    if mode is None:
        scene.mode = None
        scene.run(301)
    else:
        scene.say_mode(**mode)
    scene.coordinator.enable.sides = ()
    assert scene.starting.join(scene.now_ns) is None
    assert scene.running == {L} and scene.coordinator.enable.sides == (L,)


def test_an_arm_joins_only_after_its_state_was_steady_for_a_while():
    """0.3 s without a gap; until then the refusal names the arm, and nothing has changed."""
    scene = Scene(sides=(L,))
    scene.dumb = {R}
    scene.run(11)
    scene.dumb = set()
    scene.run(30)
    refusal = scene.starting.join(scene.now_ns)
    assert refusal is not None and (refusal.code, refusal.field) == (Code.PART_STALE, "right_arm")
    assert "has not been steady and timely for 0.3 s" in refusal.message
    assert scene.running == {L} and scene.coordinator.enable.sides == (L,)
    scene.run(1)
    assert scene.starting.join(scene.now_ns) is None and scene.running == {L, R}


def test_an_arm_outside_its_limits_does_not_join():
    """The held one is held on, alone."""
    scene = Scene(sides=(L,))
    scene.push(R, TOP_RAD + 0.1)
    scene.run(5)
    refusal = scene.starting.join(scene.now_ns)
    assert refusal is not None and refusal.code is Code.START_OUTSIDE_LIMITS
    assert scene.running == {L} and scene.coordinator.enable.sides == (L,)


# ------------------------------------------------------------------------------------------------ strayed


def test_an_arm_has_strayed_when_it_is_beyond_the_tracking_bound():
    """0.3 rad in either direction; sagging is not straying."""
    scene = Scene()
    scene.push(L, -0.35)
    scene.push(R, 0.29)
    assert scene.starting.strayed(scene.now_ns) == {L: pytest.approx(Gap(0.35))}


def test_a_silent_arm_has_no_reference_to_stray_from():
    """It may be pushed wherever somebody likes."""
    scene = Scene(sides=(L,))
    scene.push(L, 0.35)
    scene.push(R, 0.35)
    assert set(scene.starting.strayed(scene.now_ns)) == {L}


def test_an_arm_that_is_not_heard_is_not_said_to_have_strayed():
    """Where it is is not known; the other one is judged all the same."""
    scene = Scene()
    scene.push(L, 0.35)
    scene.push(R, 0.4)
    scene.dumb = {L}
    scene.run(11)
    assert scene.starting.strayed(scene.now_ns) == {R: pytest.approx(Gap(0.4))}


# ------------------------------------------------------------------------------------------------ walk


def test_held_references_walk_back_slowly_without_a_step_and_the_grip_is_kept():
    """Both arms end together where they were pushed to, inside the walking speed, with 1.0 all the while."""
    scene = Scene()
    scene.push(L, 0.6)
    scene.push(R, -0.4)
    scene.run(5)
    assert scene.starting.walk(scene.now_ns) is None
    assert scene.walking == {L, R}
    frames = scene.run(400)
    walks = [frame.topic for frame in frames if frame.kind is FrameKind.WALK]
    assert walks.count(joint_command(L)) == walks.count(joint_command(R))
    bound_rad = WALK_SPEED * scene.coordinator.settings.arm.v_radps * TICK_S * (1 + 1e-9)
    for side in Side:
        path = [frame for frame in frames if frame.topic == joint_command(side)]
        firsts = [MIDDLE[side][0], *(frame.values[0] for frame in path)]
        assert max(abs(b - a) for a, b in pairwise(firsts)) <= bound_rad
        assert {frame.kind for frame in path} == {FrameKind.WALK, FrameKind.HOLD}
        assert scene.reference(side) == pytest.approx(scene.q_rad[side])
    assert scene.coordinator.body.heartbeat.beat is Beat.ONE and scene.walking == set()
    assert scene.told(Code.WALK) == [
        "the held reference walks back to the measured left and right arm; the grip is kept"
    ]


@pytest.mark.parametrize("space", list(Space))
def test_no_reference_walks_to_where_one_sample_says_that_its_arm_is(space):
    """It is told why; what is held stays where it is."""
    scene = Scene(poses=(R,) if space is Space.POSE else ())
    scene.push(L, 0.4)
    scene.run(5)
    if space is Space.POSE:
        scene.shift(R, 0.09)
    else:
        scene.push(R, 0.4)
    refusal = scene.starting.walk(scene.now_ns)
    assert refusal is not None and (refusal.code, refusal.field) == (Code.PART_STALE, "right_arm")
    assert "samples of the right arm do not agree" in refusal.message and scene.walking == set()
    scene.run(5)
    assert scene.starting.walk(scene.now_ns) is None and scene.walking == {L, R}


def test_only_the_arm_that_strayed_walks():
    """The other one keeps its reference though it sags."""
    scene = Scene()
    scene.push(L, 0.2)
    scene.push(R, 0.4)
    scene.run(5)
    assert scene.starting.walk(scene.now_ns) is None
    scene.run(400)
    assert scene.reference(L) == MIDDLE[L] and scene.reference(R) == pytest.approx(scene.q_rad[R])
    assert scene.told(Code.WALK) == ["the held reference walks back to the measured right arm; the grip is kept"]


def test_nothing_walks_when_nothing_strayed():
    """And nobody is told of it."""
    scene = Scene()
    scene.push(L, 0.2)
    assert scene.starting.walk(scene.now_ns) is None
    assert scene.walking == set() and scene.coordinator.notices == []


def test_a_reference_walks_to_the_limit_when_its_arm_is_just_beyond():
    """The same margin as for a start."""
    scene = Scene()
    scene.push(L, TOP_RAD + 0.04)
    scene.run(5)
    assert scene.starting.walk(scene.now_ns) is None
    scene.run(1000)
    assert scene.reference(L)[0] == pytest.approx(TOP_RAD) and scene.reference(L)[0] <= TOP_RAD


@pytest.mark.parametrize("outside", list(Side))
def test_no_reference_walks_when_one_arm_is_far_outside_its_limits(outside):
    """All or none."""
    scene = Scene()
    for side in Side:
        scene.push(side, TOP_RAD + 0.1 if side is outside else 0.5)
    scene.run(5)
    refusal = scene.starting.walk(scene.now_ns)
    assert refusal is not None
    assert (refusal.code, refusal.field) == (Code.START_OUTSIDE_LIMITS, f"{outside}_arm[0]")
    assert scene.walking == set() and scene.coordinator.notices == []


def test_without_a_path_back_nothing_walks_and_the_reason_is_told(monkeypatch):
    """PLAN_FAILED with the planner's words; the references stay where they are."""
    scene = Scene()
    scene.push(L, 0.5)
    scene.run(5)

    def find_none(*_: object) -> None:
        raise PlanFailed("ruckig finds no plan")

    monkeypatch.setattr(body, "plan", find_none)
    refusal = scene.starting.walk(scene.now_ns)
    assert refusal == Refusal(
        code=Code.PLAN_FAILED, message="no path back to the arm inside the limits: ruckig finds no plan"
    )
    scene.run(10)
    assert scene.reference(L) == MIDDLE[L] and scene.walking == set() and scene.coordinator.notices == []


def test_grippers_begin_with_their_arms_without_torque():
    """0.10 is due in the tick of the first setpoint, before it (manual §4.4); after a short stall the value is kept."""
    stage = Stage(State.IDLE)
    body = stage.coordinator.body
    assert stage.phases.starting.seed((L,), stage.now_ns) is None
    frames = [(frame.topic, frame.kind, frame.values) for frame in stage.run(1)]
    assert frames[0] == (gripper_command(L), FrameKind.ECHO, (0.1,))
    assert frames[1][0] == joint_command(L) and not body.grippers[R].running
    body.grippers[L].command(0.8, stage.epoch)
    stage.run(2)
    for is_resuming, kept in ((True, 0.8), (False, 0.1)):
        body.silence_arms()
        stage.coordinator.resuming = is_resuming
        stage.phases.starting.seed((L,), stage.now_ns)
        assert stage.run(1)[0].values == (kept,)


# ------------------------------------------------------------------------------------------------ pose space


def test_an_end_effector_starts_at_its_measured_pose():
    """Exactly there; the other arm at its joints."""
    scene = Scene(State.IDLE, poses=(R,))
    scene.coordinator.choose_spaces((L, R), scene.now_ns)
    assert scene.starting.seed((L, R), scene.now_ns) is None
    assert (scene.coordinator.body.arms[L].values, scene.coordinator.body.arms[R].values) == (MIDDLE[L], PLACE[R])
    assert scene.coordinator.notices == []


@pytest.mark.parametrize(("reach_m", "starts"), [(0.555, True), (0.565, False)])
def test_an_end_effector_beyond_its_reach_starts_at_its_end_or_not_at_all(reach_m, starts):
    """Up to 1 cm beyond: moved, and told; further out: START_OUTSIDE_LIMITS, and no arm starts."""
    scene = Scene(State.IDLE, poses=(R,))
    scene.pose[R] = (0.0, 0.0, -reach_m, 0.0, 0.0, 0.0, 1.0)
    scene.run(40)  # a jump is believed once it lasts
    scene.coordinator.choose_spaces((L, R), scene.now_ns)
    refusal = scene.starting.seed((L, R), scene.now_ns)
    assert (refusal is None) == starts == (scene.starting.why_not(R) is None)
    if starts:
        assert scene.coordinator.body.arms[R].values[2] == pytest.approx(-0.55)
        assert "right arm was found just beyond its reach" in scene.told(Code.START_AT_LIMIT)[0]
    else:
        assert refusal.code is Code.START_OUTSIDE_LIMITS and scene.running == set()


def test_a_held_end_effector_that_was_pushed_away_is_walked_back_to():
    """Beyond 6 cm it has strayed; the reference goes there straight, at a part of the speed."""
    scene = Scene(poses=(R,))
    scene.shift(R, 0.1)
    assert scene.starting.strayed(scene.now_ns) == {R: pytest.approx(Gap(0.0, 0.1))}
    scene.run(5)
    assert scene.starting.walk(scene.now_ns) is None
    scene.run(400)
    assert scene.coordinator.body.arms[R].values == pytest.approx(scene.pose[R])
    assert scene.starting.strayed(scene.now_ns) == {}


def test_an_end_effector_that_was_pushed_out_of_its_reach_is_not_walked_to():
    """The reference stays; the reason is told."""
    scene = Scene(poses=(R,))
    scene.pose[R] = (0.57, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    scene.run(40)  # a jump is believed once it lasts
    refusal = scene.starting.walk(scene.now_ns)
    assert refusal is not None and refusal.code is Code.START_OUTSIDE_LIMITS and scene.walking == set()


def test_an_arm_that_comes_back_in_the_other_mode_joins_in_that_mode():
    """The robot's mode is asked again for each silent arm."""
    scene = Scene(sides=(L,))
    scene.poses = {R}
    scene.say_mode(joint_mode={L: True, R: False})
    scene.coordinator.body.arms[R].stop()
    scene.run(2)
    assert scene.starting.join(scene.now_ns) is None
    assert scene.coordinator.body.arms[R].values == PLACE[R] and scene.running == {L, R}


# ------------------------------------------------------------------------------------------------ stay


@pytest.mark.parametrize(("by_rad", "is_changed"), [(0.0, False), (0.009, False), (0.011, True), (-0.3, True)])
def test_a_reference_that_nobody_follows_stays_within_a_hundredth_of_its_arm(by_rad, is_changed):
    """The frames go on in their time, at rest; the one that changes it is a start."""
    scene = Scene(State.PAUSED)
    scene.push(R, by_rad)
    assert scene.starting.stay(scene.now_ns) is is_changed
    first, second = scene.arm_frames(R, 2)
    assert first.values == second.values == (scene.q_rad[R] if is_changed else MIDDLE[R])
    assert (first.kind, second.kind) == (FrameKind.ECHO if is_changed else FrameKind.HOLD, FrameKind.HOLD)
    assert scene.starting.stay(scene.now_ns) is False


def test_a_reference_that_nobody_follows_does_not_brake_on():
    """However near its arm it still is."""
    scene = Scene(State.PAUSED)
    arm = scene.coordinator.body.arms[L]
    arm.follow_target(tuple(q + 0.5 for q in MIDDLE[L]), 1.0, scene.epoch)
    scene.run(8)
    arm.brake()
    assert not arm.is_at_rest and scene.starting.stay(scene.now_ns)
    assert arm.is_at_rest and scene.reference(L) == scene.q_rad[L]


def test_an_arm_that_is_silent_dead_or_out_of_its_limits_is_not_followed():
    """What is sent for it, if anything, stays as it was."""
    scene = Scene(State.PAUSED, sides=(L,))
    scene.push(R, 0.2)
    assert not scene.starting.stay(scene.now_ns)
    scene.push(L, TOP_RAD + 0.2)
    assert not scene.starting.stay(scene.now_ns) and scene.reference(L) == MIDDLE[L]
    scene.push(L, -0.3)
    scene.dumb = {L}
    scene.run(11)
    assert not scene.starting.stay(scene.now_ns) and scene.reference(L) == MIDDLE[L]
