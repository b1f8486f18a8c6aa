"""Poses for arms in joint mode: worked out while they wait, straight, measured as poses, and only while the model agrees."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from gateway.core.messages.events import SettingsRead
from gateway.core.messages.outputs import FrameKind
from gateway.core.motion.lines.line import line_to
from gateway.core.requests import cartesian as module
from gateway.errors import Code, Refusal
from gateway.kinematics.arm import ArmModel
from gateway.kinematics.collision import CollisionModel
from gateway.kinematics.description import nominal
from gateway.messages.incoming import OnLimit, Until
from gateway.messages.requests import Cancel, Hold, Move, MovePose, Stop
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import STATE_TOPICS, joint_command, pose_command, shoulder_frame
from gateway.sim.robot.settings import SimSettings
from gateway.values import EePose, Side
from tests.behaviour.scene import Scene, scene
from tests.changed import replace
from tests.core.lines import planned, used
from tests.kinematics.bodies import ARMS, difference, nudged, samples
from tests.kinematics.guarded_arms import MEET
from tests.spaced import SpacedPair

MS = 1_000_000
HOME = HOME_Q_RAD
L, R = Side.LEFT, Side.RIGHT
FRAMES = {side: shoulder_frame(side) for side in Side}


def ready(*, is_modelled=True, right_mode="joint", at=HOME):
    """A robot at home, both arms enabled and held; its model agrees after three seconds of looking."""
    pair = Scene(SimSettings(state_period_ns=10 * MS, right_mode=right_mode), snapshot_hz=50, is_modelled=is_modelled)
    pair.topics = STATE_TOPICS
    scene("at rest", pair)
    if at is not None:
        goals = {side: at[side] for side in Side if right_mode == "joint" or side is L}
        pair.granted(Move(epoch=pair.epoch, targets_rad=goals), "ann")
        pair.run(6.0)
    pair.mark()
    return pair


def here(pair, side=L):
    """Where an arm's setpoint puts its end effector."""
    return ARMS[side].forward(held(pair, side))


def held(pair, side=L):
    """An arm's last setpoint [rad]."""
    return pair.sent_on(joint_command(side))[-1][1].values


def beside(pair, by_m=(0.05, 0.02, 0.06), side=L):
    """A pose a little away, turned alike: x, y, z [m], qx, qy, qz, qw."""
    pose = here(pair, side)
    return (*(p + d for p, d in zip(pose.p_m, by_m, strict=True)), *pose.quat_xyzw)


def request(pair, by_m=(0.05, 0.02, 0.06), sides=(L,), **how):
    """A motion to poses beside the present ones, straight unless told otherwise."""
    targets = how.pop("targets") if "targets" in how else {side: beside(pair, by_m, side) for side in sides}
    frames = how.pop("frames", {side: FRAMES[side] for side in targets})
    return MovePose(**{"epoch": pair.epoch, "targets": targets, "frames": frames, "straight": True, **how})


def asked(pair, *args, **how):
    """Ask for a motion that is accepted; return its number."""
    motion_id = pair.granted(request(pair, *args, **how), "ann")["motion_id"]
    assert isinstance(motion_id, int)
    return motion_id


def setpoints(pair, side=L):
    """What was sent to an arm since the mark."""
    return [frame.values for _, frame in pair.arm_frames(side)]


def moves(pair, side=L):
    """Whether an arm was sent a motion since the mark."""
    return FrameKind.MOTION in pair.arm_kinds(side)


def until_ended(pair, motion_id):
    """Let time pass until a motion has ended; return what is seen of it."""
    pair.run_until(lambda: pair.motion_view(motion_id).state not in {"queued", "executing"}, 30.0)
    return pair.motion_view(motion_id)


# ------------------------------------------------------------------------------------------------ straight motions


@pytest.mark.parametrize(("sides", "is_kept_apart"), [((L,), False), ((R,), False), ((L, R), False), ((L,), True)])
def test_a_straight_motion_waits_while_it_is_worked_out_and_then_goes_straight(sides, is_kept_apart):
    """Queued and nothing moves; then every setpoint of every arm is on its line, inside the limits, to the measured pose."""
    pair = with_parts(ready()) if is_kept_apart else ready()
    begins = {side: here(pair, side) for side in sides}
    asked_for = request(pair, sides=sides, by_m=(0.03, 0.0, 0.06))
    facts = pair.granted(asked_for, "ann")
    assert facts["duration_ns"] == 0
    motion_id = facts["motion_id"]
    view = pair.motion_view(motion_id)
    assert (view.state, view.space, view.progress, view.sides) == ("queued", "pose", 0.0, tuple(s.value for s in sides))
    assert not any(moves(pair, side) for side in sides)
    pair.run_until(lambda: pair.motion_view(motion_id).state == "executing", 1.5)
    pair.run(0.2)
    assert pair.motion_view(motion_id).duration_ns > 300 * MS
    view = until_ended(pair, motion_id)
    assert (view.state, view.code) == ("reached", "")
    assert view.error_m < 0.005
    for side in sides:
        target = asked_for.targets[side]
        line = line_to(begins[side], EePose(p_m=target[:3], quat_xyzw=target[3:]))
        sent = setpoints(pair, side)
        assert max(used(sent, pair.engine._coordinator.body.joint_arms[side].reference.space.limits)) <= 1.0 + 1e-6
        direction = [way / line.length_m for way in line.moved_m]
        for q in sent:
            at = ARMS[side].chain.forward(q)
            part = sum(d * (a - b) for d, a, b in zip(direction, at.p_m, line.begin.p_m, strict=True)) / line.length_m
            assert max(difference(at, line.at(part))) < 1e-4
        assert math.dist(ARMS[side].forward(sent[-1]).p_m, target[:3]) < 1e-6


def test_a_line_keeps_to_a_speed_limit_that_was_lowered():
    """The hand goes no faster than the settings say that were read anew."""
    pair = ready()
    pair.receive(SettingsRead(values={"pose.v_mps": 0.05}, message="pose.v_mps = 0.05", at_ns=pair.now_ns))
    view = until_ended(pair, asked(pair))
    places = [ARMS[L].forward(q).p_m for q in setpoints(pair)]
    assert view.state == "reached" and 0.03 < 100.0 * max(map(math.dist, places, places[1:])) <= 0.05 + 1e-6


def test_the_joints_of_a_line_keep_to_a_speed_limit_that_was_lowered():
    """Where a joint turns faster than the hand's speed lets one think: towards the shoulder."""
    pair = ready()
    pair.receive(SettingsRead(values={"arm.v_radps": 0.1}, message="arm.v_radps = 0.1", at_ns=pair.now_ns))
    view = until_ended(pair, asked(pair, (-0.1, 0.0, 0.0)))
    sent = setpoints(pair)
    fastest = max(abs(b - a) for x, y in pairwise(sent) for a, b in zip(x, y, strict=True))
    assert view.state == "reached" and 0.09 < 100.0 * fastest <= 0.1 + 1e-6


def test_what_moved_an_arm_ends_and_the_line_begins_where_it_came_to_rest():
    """Superseded at once; the arm brakes; the line begins at its rest."""
    pair = ready()
    first = pair.granted(Move(epoch=pair.epoch, targets_rad={L: (HOME[L][0] + 0.5, *HOME[L][1:])}), "ann")["motion_id"]
    pair.run(0.5)
    goal = beside(pair, (0.02, 0.0, 0.05))
    motion_id = asked(pair, targets={L: goal})
    assert pair.motion_view(first).state == "superseded"
    assert pair.motion_view(motion_id).state == "queued"
    view = until_ended(pair, motion_id)
    assert (view.state, view.code) == ("reached", "")
    assert FrameKind.BRAKE in pair.arm_kinds(L)
    assert math.dist(here(pair).p_m, goal[:3]) < 1e-6


@pytest.mark.parametrize(
    ("ending", "state", "code"),
    [
        ("cancel", "cancelled", "CANCELLED"),
        ("hold", "cancelled", "CANCELLED"),
        ("stop", "aborted", "STOPPED"),
        ("move", "superseded", "SUPERSEDED"),
    ],
)
def test_a_motion_that_is_worked_out_can_be_ended_as_any_other(ending, state, code):
    """Cancelled, held, stopped or superseded while queued: it never begins."""
    pair = ready()
    motion_id = asked(pair)
    requests = {
        "cancel": Cancel(epoch=pair.epoch, motion_id=motion_id),
        "hold": Hold(epoch=pair.epoch, sides=(L,)),
        "stop": Stop(),
        "move": Move(epoch=pair.epoch, targets_rad={L: held(pair)}),
    }
    pair.granted(requests[ending], "ann")
    view = pair.motion_view(motion_id)
    assert (view.state, view.code) == (state, code)
    before = held(pair)
    pair.run(1.5)
    assert held(pair) == before
    assert pair.engine._handler._cartesian._jobs == []


def test_a_stop_on_the_way_brakes_inside_the_limits():
    """As any motion: aborted with STOPPED, the arm brakes and holds, every difference of setpoints inside the limits."""
    pair = ready()
    motion_id = asked(pair, (0.0, 0.0, 0.12))
    pair.run_until(lambda: pair.motion_view(motion_id).progress > 0.4)
    pair.granted(Stop(), "ann")
    assert pair.motion_view(motion_id).code == "STOPPED"
    pair.run(1.0)
    assert {FrameKind.BRAKE, FrameKind.HOLD} <= pair.arm_kinds(L)
    limits = pair.engine._coordinator.body.joint_arms[L].reference.space.limits
    assert max(used(setpoints(pair), limits)) <= 1.0 + 1e-6


@pytest.mark.parametrize("when", ["queued", "under way"])
def test_a_model_that_differs_ends_the_motion(when):
    """MODEL_DIFFERS: while it is worked out nothing moves; on the way the arms brake and hold."""
    pair = ready()
    motion_id = asked(pair, (0.0, 0.0, 0.12))
    if when == "under way":
        pair.run_until(lambda: pair.motion_view(motion_id).progress > 0.3)
    pair.model._judges[L]._arm = ArmModel(nudged(L, 2, xyz_m=(0.0, 0.05, 0.0)), L).chain
    pair.model._judges[L].forget()
    pair.model._verdicts.clear()
    view = until_ended(pair, motion_id)
    assert view.state == "aborted"
    assert view.code in {"MODEL_DIFFERS", "MODEL_UNKNOWN"}
    assert "cannot be relied on" in view.message
    pair.run(1.0)
    assert moves(pair) == (when == "under way")
    assert pair.arm_frames(L)[-1][1].kind is FrameKind.HOLD
    refusal = pair.refused(request(pair), "ann")
    assert refusal.code in {Code.MODEL_DIFFERS, Code.MODEL_UNKNOWN}


def test_a_line_that_cannot_be_followed_ends_aborted_and_nothing_moves():
    """The goal can be taken, but not straight: the place, the joint and what else to do are told."""
    pair = ready()
    begin = held(pair)
    target = next(
        pose
        for q_rad in samples(L, 1000, seed=3)
        for pose in [ARMS[L].forward(q_rad)]
        if math.hypot(*pose.p_m) < 0.54 and isinstance(planned(pose, begin), Refusal)
    )
    motion_id = asked(pair, targets={L: target.values})
    view = until_ended(pair, motion_id)
    assert view.state == "aborted"
    assert view.code == "NO_STRAIGHT_WAY"
    assert "of the way" in view.message
    assert held(pair) == begin


def test_it_begins_only_where_it_was_worked_out_for(monkeypatch):
    """Whatever moved the reference meanwhile: the plan is not used."""
    pair, whole = ready(), module.plan_lines

    def elsewhere(*args):
        paths = yield from whole(*args)
        start = paths[L].start
        return {L: replace(paths[L], start=start._replace(values=(start.values[0] + 1e-9, *start.values[1:])))}

    monkeypatch.setattr(module, "plan_lines", elsewhere)
    view = until_ended(pair, asked(pair))
    assert (view.state, view.code) == ("aborted", "PLAN_FAILED")
    assert "no longer where" in view.message
    pair.run(0.5)
    assert not moves(pair)


def test_a_tick_does_no_more_than_some_pieces(monkeypatch):
    """However much there is to work out."""
    pair = ready()
    done = []
    whole = module.plan_lines

    def counted(*args):
        work = whole(*args)
        while True:
            done[-1] += 1
            try:
                next(work)
            except StopIteration as end:
                return end.value
            yield

    monkeypatch.setattr(module, "plan_lines", counted)
    done.append(0)
    pair.on_step = lambda _: done.append(0)
    until_ended(pair, asked(pair, sides=(L, R), by_m=(0.0, 0.0, 0.05)))
    assert max(done) == module.PIECES
    assert sum(done) > 10 * module.PIECES


# ------------------------------------------------------------------------------------------------ joint motions to poses


def test_a_joint_arm_goes_to_a_pose_by_its_joints_at_once():
    """Nearest joints of all ways to bend it; begins in the tick, is measured as a pose."""
    pair = ready()
    goal = beside(pair, (0.0, 0.0, 0.06))
    facts = pair.granted(request(pair, targets={L: goal}, straight=False, tolerance_m=0.01), "ann")
    assert facts["duration_ns"] > 100 * MS
    assert facts["values"] == {"left": list(goal)}
    assert moves(pair)
    view = until_ended(pair, facts["motion_id"])
    assert (view.state, view.space) == ("reached", "pose")
    assert view.error_m < 0.01
    wanted = ARMS[L].solution(EePose(p_m=goal[:3], quat_xyzw=goal[3:]), HOME[L])
    assert held(pair) == pytest.approx(wanted.q_rad, abs=1e-9)


def test_a_joint_motion_to_a_pose_ends_when_the_model_differs():
    """It goes where the model says, so it needs the model to the end."""
    pair = ready()
    motion_id = asked(pair, (0.0, 0.0, 0.12), straight=False)
    pair.run(0.3)
    pair.model.forget()
    view = until_ended(pair, motion_id)
    assert (view.state, view.code) == ("aborted", "MODEL_UNKNOWN")


def test_no_path_of_the_joints_is_a_refusal(monkeypatch):
    """PLAN_FAILED, and what drove the arm goes on."""
    pair = ready()

    def failed(*_):
        raise module.PlanFailed("none")

    monkeypatch.setattr("gateway.core.body.body.plan", failed)
    assert pair.refused(request(pair, straight=False), "ann").code is Code.PLAN_FAILED


# ------------------------------------------------------------------------------------------------ what must stay free


def with_parts(pair):
    """The same robot, whose parts are kept apart."""
    pair.model.collision = CollisionModel(nominal())
    return pair


@pytest.mark.parametrize("straight", [True, False])
def test_a_way_on_which_parts_come_too_near_is_refused_and_a_free_one_is_gone(straight):
    """The other arm is where it is held; both parts and the gap are told, and nothing moves."""
    right = ARMS[R].forward(HOME[R])
    across = ARMS[R].solution(replace(right, p_m=(right.p_m[0], 0.06, right.p_m[2])), HOME[R])
    pair = with_parts(ready(at={L: HOME[L], R: across.q_rad}))
    target = beside(pair, (0.0, -0.2, 0.0))
    begin = held(pair)
    view = until_ended(pair, asked(pair, targets={L: target}, straight=straight))
    assert (view.state, view.code) == ("aborted", "COLLISION_AHEAD")
    assert held(pair) == begin
    free = until_ended(pair, asked(pair, (0.02, 0.0, 0.05), straight=straight))
    assert (free.state, free.code) == ("reached", "")


@pytest.mark.parametrize("straight", [True, False])
def test_a_goal_that_leaves_too_little_room_is_refused_before_anything_ends(straight):
    """With pair and distance: both hands in one place; what moved the arm goes on."""
    pair = SpacedPair()
    pair.lead(HOME, 8.0)
    moving = pair.granted(Move(epoch=pair.epoch, targets_rad={R: (*HOME[R][:6], HOME[R][6] + 0.2)}, speed=0.1))
    hands = {side: ARMS[side].forward(MEET[side]) for side in Side}
    targets = {side: (*hands[side].p_m, *hands[side].quat_xyzw) for side in Side}
    refusal = pair.refused(MovePose(epoch=pair.epoch, targets=targets, frames=FRAMES, straight=straight))
    assert refusal.code is Code.GOAL_TOO_NEAR and "left_" in refusal.message and "right_" in refusal.message
    assert (refusal.bound, refusal.unit) == (">= 0.02", "m") and float(refusal.value) < 0.02
    assert pair.coordinator.body.motions.find(moving["motion_id"]).is_running


def test_an_arm_that_nobody_knows_stands_in_the_way():
    """Its state is not heard: what must not be hit may be anywhere."""
    pair = with_parts(ready(right_mode="pose"))
    store = pair.engine._coordinator.store
    assert store.arm(R) is not None
    measured = pair.engine._handler._cartesian._postures(pair.now_ns)
    assert measured[R] == store.arm(R).q_rad
    refusal = pair.engine._handler._cartesian._postures(pair.now_ns + 10_000 * MS)
    assert (refusal.code, refusal.field) == (Code.PART_STALE, "right_arm")
    pair.engine._handler._cartesian._postures = lambda now_ns: refusal
    view = until_ended(pair, asked(pair, (0.02, 0.0, 0.05)))
    assert (view.state, view.code) == ("aborted", "PART_STALE")


# ------------------------------------------------------------------------------------------------ refusals


def test_without_a_model_there_are_no_poses_for_joint_arms():
    """MODEL_OFF with the key of the configuration; and MODEL_UNKNOWN before enough was heard."""
    pair = ready(is_modelled=False, at=None)
    assert pair.refused(request(pair), "ann").code is Code.MODEL_OFF
    young = ready(at=None)
    young.model.forget()
    assert young.refused(request(young), "ann").code is Code.MODEL_UNKNOWN


@pytest.mark.parametrize(
    ("how", "code"),
    [
        ({"speed": 0.0}, Code.OUT_OF_RANGE),
        ({"tolerance_m": 9.0}, Code.OUT_OF_RANGE),
        ({"frames": {L: "base_link"}}, Code.WRONG_FRAME),
        ({"frames": {}}, Code.WRONG_FRAME),
        ({"targets": {L: (0.3, 0.1, -0.2, 0.0, 0.0, 0.0, 1.1)}}, Code.OUT_OF_RANGE),
        ({"targets": {L: (math.nan, 0.1, -0.2, 0.0, 0.0, 0.0, 1.0)}}, Code.NOT_FINITE),
        ({"targets": {L: (0.9, 0.1, -0.2, 0.0, 0.0, 0.0, 1.0)}}, Code.OUT_OF_RANGE),
        ({"targets": {L: (-0.3, 0.1, 0.2, 0.0, 0.0, 0.0, 1.0)}}, Code.OUT_OF_RANGE),
        ({"targets": {L: (0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)}}, Code.OUT_OF_RANGE),
        ({"targets": {}}, Code.WRONG_SHAPE),
        ({"epoch": 99}, Code.NOT_OWNER),
    ],
)
@pytest.mark.parametrize("straight", [True, False])
def test_what_is_wrong_is_refused_as_for_an_arm_in_end_effector_mode(settled, how, code, straight):
    """Speed, tolerance, frame, norm, finiteness, reach, joints, shape and lease; nothing moves."""
    assert settled.refused(request(settled, **{**how, "straight": straight}), "ann").code is code


@pytest.fixture(scope="module")
def settled():
    """One robot for all refusals: they change nothing."""
    return ready()


def test_a_pose_that_no_joints_take_names_a_joint(settled):
    """The one that is furthest out with the elbow as it hangs; for a searched arm that there is none."""
    x, y, z, *_ = beside(settled)
    target = {L: (x, y, z, 0.0, 1.0, 0.0, 0.0)}
    refusal = settled.refused(request(settled, targets=target), "ann")
    assert (refusal.code, refusal.unit) == (Code.OUT_OF_RANGE, "rad")
    assert refusal.field.startswith("left_arm[")
    ours = settled.model.arms[L]
    settled.model.arms[L] = ArmModel(nudged(L, 5, xyz_m=(0.002, 0.0, 0.001)), L)
    try:
        searched = settled.refused(request(settled, targets=target), "ann")
    finally:
        settled.model.arms[L] = ours
    assert (searched.code, searched.field) == (Code.OUT_OF_RANGE, "left_arm")


def test_a_position_beyond_the_reach_can_be_clipped():
    """Opt-in and told, as everywhere: it goes to the end of the reach."""
    far = next(
        pose
        for q_rad in samples(L, 1000, seed=4)
        for pose in [ARMS[L].forward(q_rad)]
        if 0.53 < math.hypot(*pose.p_m) < 0.55
    )
    pair = ready()
    pair.engine._coordinator.settings = replace(
        pair.settings, pose=replace(pair.settings.pose, reach_m=math.hypot(*far.p_m) - 0.001)
    )
    refusal = pair.refused(request(pair, targets={L: far.values}), "ann")
    assert (refusal.code, refusal.field) == (Code.OUT_OF_RANGE, "left_arm.p_m")
    facts = pair.granted(request(pair, targets={L: far.values}, on_limit=OnLimit.CLIP), "ann")
    assert facts["clipped"] == {"left": [0, 1, 2]}
    assert math.hypot(*facts["values"]["left"][:3]) == pytest.approx(math.hypot(*far.p_m) - 0.001)


def test_arms_in_end_effector_mode_go_their_own_way():
    """An arm in that mode moves straight by the robot's own kinematics; a motion of one in each mode is refused."""
    pair = ready(right_mode="pose")
    x, y, z, *quat = pair.sent_on(pose_command(R))[-1][1].values
    goal = {R: (x, y, z + 0.03, *quat)}
    frames = {R: FRAMES[R]}
    motion_id = pair.granted(request(pair, targets=goal, frames=frames), "ann")["motion_id"]
    assert until_ended(pair, motion_id).state == "reached"
    both = {**goal, L: beside(pair)}
    assert pair.refused(request(pair, targets=both, frames=FRAMES), "ann").code is Code.WRONG_CONTROL_MODE


@pytest.mark.parametrize("straight", [True, False])
def test_a_motion_that_is_to_end_at_a_touch_that_nobody_feels_is_refused(straight):
    """The rules of touches are `test_touches.py`'s."""
    pair = ready()
    until = Until(force_n=8.0)
    assert pair.refused(request(pair, straight=straight, until=until), "ann").code is Code.MODEL_OFF
    assert [motion.state for motion in pair.see().motions] == ["reached"]
