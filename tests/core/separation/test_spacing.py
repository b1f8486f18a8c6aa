"""What keeps arms apart, tick by tick: who is held back and how, who never is, and what is told and shown of it."""

from __future__ import annotations

import random
from dataclasses import replace
from itertools import pairwise

import pytest

from gateway.core.messages.events import SampleArrived
from gateway.core.messages.outputs import FrameKind, Level
from gateway.core.motion.motion import ReferenceMode, plan
from gateway.core.separation import goal_checks
from gateway.core.separation.spacing import ADRIFT_RADPS, Spacing
from gateway.errors import Code
from gateway.kinematics.separation.approach import Look
from gateway.messages import requests
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import arm_state, joint_command, shoulder_frame
from gateway.sim.robot.settings import SimSettings
from gateway.values import ArmState, Side, Space
from tests.kinematics.guarded_arms import MARGIN_M, MEET, ROUNDING_M, model, random_joints
from tests.pair import COMPLIANCE_RADPNM, MS
from tests.spaced import SpacedPair
from tests.thoroughness import either

L, R = Side.LEFT, Side.RIGHT


def at_home(**changes):
    """Return a robot at home whose arms are kept apart."""
    pair = SpacedPair(**changes)
    pair.lead(HOME_Q_RAD, 8.0)
    return pair


def onto(right):
    """Return joints of the left arm at which it would be inside the right one."""
    rng = random.Random(2)
    while True:
        left = random_joints(rng)[L]
        near = model().posture({L: left, R: right}).nearest()
        if near.gap_m < 0.0 and near.first.startswith("left") and near.second.startswith("right"):
            return left


def told(pair, code):
    """Return the notices of a code."""
    return [notice for notice in pair.notices if notice.code is code]


def reference(pair, side):
    """Return what generates an arm's joint setpoints."""
    return pair.coordinator.body.joint_arms[side].reference


def judged(monkeypatch):
    """Count what the rule is asked with a new look at the body, with its answers."""
    answers = []
    judge = Look.judge

    def counted(self, motion):
        answers.append((motion, judge(self, motion)))
        return answers[-1][1]

    monkeypatch.setattr(Look, "judge", counted)
    return answers


def passed(monkeypatch):
    """Count what is asked of looks at the body in earlier ticks, with the answers."""
    answers = []
    passing = Look.passing

    def counted(self, wanted, lookahead):
        answers.append((lookahead, passing(self, wanted, lookahead)))
        return answers[-1][1]

    monkeypatch.setattr(Look, "passing", counted)
    return answers


# ------------------------------------------------------------------------------------------------ followed targets


def test_a_stream_is_slowed_down_then_held_back_and_told_of_once():
    """The velocity is bounded before joints stop; one notice for each arm, with the pair and its gap; the stream stays open."""
    pair = at_home()
    pair.lead(MEET, 6.0)
    assert pair.least_m >= MARGIN_M - ROUNDING_M and all(reference(pair, side)._follower._bound < 1.0 for side in Side)
    assert all(stream.is_open for stream in pair.coordinator.body.targets.running)
    assert all(reference(pair, side).mode is ReferenceMode.FOLLOW for side in Side)
    notices = told(pair, Code.COLLISION_AHEAD)
    assert {notice.facts["side"] for notice in notices} == {"left", "right"} and len(notices) <= 4
    assert all(notice.level is Level.WARNING and "20 mm must stay free" in notice.message for notice in notices)
    spacing = pair.see().spacing
    assert spacing is not None and set(spacing.held) == {"left", "right"}
    pair.lead(HOME_Q_RAD, 8.0)
    assert pair.off_rad(HOME_Q_RAD) < 1e-9 and all(reference(pair, side)._follower._bound == 1.0 for side in Side)
    pair.run(0.3)
    assert pair.see().spacing.held == ()


@pytest.mark.thorough
def test_a_stream_that_is_held_back_again_later_is_told_of_again():
    """After a second without it."""
    pair = at_home()
    for _ in range(2):
        pair.lead({L: MEET[L], R: HOME_Q_RAD[R]}, 3.0)
        pair.lead({L: MEET[L], R: MEET[R]}, 5.0)
        pair.lead(HOME_Q_RAD, 8.0)
    sides = [notice.facts["side"] for notice in told(pair, Code.COLLISION_AHEAD)]
    assert sides.count("left") >= 2 or sides.count("right") >= 2


def test_only_joints_that_close_a_gap_are_held_back(monkeypatch):
    """Joint by joint, not arm by arm; and beside an arm that rests at the margin the other one goes where it likes."""
    answers = judged(monkeypatch)
    pair = at_home()
    pair.lead(MEET, 6.0)
    assert any(any(row) and not all(row) for _, verdict in answers for row in verdict.going.values()), (
        "joint by joint, not arm by arm"
    )
    pair.granted(requests.Hold(epoch=pair.epoch, sides=(L,)))
    del pair.streams[L]
    pair.lead({R: HOME_Q_RAD[R]}, 8.0)
    assert pair.off_rad({R: HOME_Q_RAD[R]}) < 1e-9 and pair.least_m >= MARGIN_M - ROUNDING_M


def caught(seed=0):
    """Return a robot with a left finger caught between both right ones: what opens one gap closes the other.

    Noise of 30 µrad decides how near each of them was when they met.
    """
    pair = at_home(sim=SimSettings(state_period_ns=10 * MS, compliance_radpnm=COMPLIANCE_RADPNM, seed=seed))
    pair.lead(MEET, 6.0)
    near = model().posture(pair.setpoints).within(MARGIN_M + 1e-4)
    posture = model().posture(pair.setpoints)
    a, b = (posture.told(number).slopes[R] for _, number in near[:2])
    assert len(near) >= 2 and sum(x * y < 0.0 for x, y in zip(a, b, strict=True)) >= 5
    return pair


@pytest.mark.thorough
@pytest.mark.parametrize("seed", either([4], [0, 2, 4]))
def test_what_is_caught_between_two_parts_can_be_led_out_again(seed):
    """Joints that open both gaps together go on, although each alone closes one of them: never nearer than the margin."""
    pair = caught(seed)
    pair.granted(requests.Hold(epoch=pair.epoch, sides=(L,)))
    del pair.streams[L]
    pair.lead({R: HOME_Q_RAD[R]}, 8.0)
    assert pair.off_rad({R: HOME_Q_RAD[R]}) < 1e-9 and pair.least_m >= MARGIN_M - ROUNDING_M


# ------------------------------------------------------------------------------------------------ paths and trajectories


def move_through(pair):
    """Move both arms into each other as no door would let them: the goal becomes one behind the door."""
    body = pair.coordinator.body
    paths = plan({side: reference(pair, side) for side in Side}, MEET, 1.0)
    duration_ns = max(path.duration_ns for path in paths.values())
    motion = body.motions.open(MEET, None, duration_ns)
    for side, path in paths.items():
        body.arms[side].follow_path(path, pair.epoch)
    return motion


def test_a_path_that_leads_into_the_other_arm_ends_for_both_arms_with_what_is_ahead():
    """COLLISION_AHEAD, with the pair; brake frames from that tick on, then a hold with the margin left."""
    pair = SpacedPair()
    pair.lead(HOME_Q_RAD, 8.0)
    motion = move_through(pair)
    begun_ns = pair.now_ns
    while motion.is_running:
        pair.step()
        pair.look()
    assert (motion.state.value, motion.code) == ("aborted", Code.COLLISION_AHEAD) and "might come to" in motion.message
    last = {frame.topic: frame.kind for at_ns, frame in pair.frames if at_ns == pair.now_ns}
    assert all(last[joint_command(side)] is FrameKind.BRAKE for side in Side)
    for _ in range(100):
        pair.step()
        pair.look()
    assert pair.coordinator.body.is_at_rest and pair.least_m >= MARGIN_M - ROUNDING_M
    assert pair.state == "ACTIVE" and pair.now_ns > begun_ns


def test_a_trajectory_that_leads_into_the_other_arm_ends_and_the_arm_brakes():
    """One arm; the goal itself is free, what lies between is not."""
    pair = at_home()
    pair.lead({L: MEET[L], R: HOME_Q_RAD[R]}, 8.0)
    there, back = MEET[R], HOME_Q_RAD[R]
    rows = [tuple(a + (b - a) * part for a, b in zip(back, there, strict=True)) for part in (0.0, 0.5, 1.0, 0.5, 0.0)]
    facts = pair.granted(requests.Follow(epoch=pair.epoch, points={R: rows}, dt_s=2.0))
    for _ in range(800):
        pair.step()
        pair.look()
    motion = pair.coordinator.body.motions.find(facts["motion_id"])
    assert motion is not None and motion.code is Code.COLLISION_AHEAD
    assert pair.least_m >= MARGIN_M - ROUNDING_M and pair.coordinator.body.is_at_rest


def test_a_motion_past_everything_is_reached():
    """From hanging arms beside the body to the initial position, at full speed: nothing is told where nothing is too near."""
    pair = SpacedPair()
    motion_id = pair.move(pair.epoch, HOME_Q_RAD)
    pair.run(5.0)
    motion = pair.coordinator.body.motions.find(motion_id)
    assert motion is not None and motion.state.value == "reached" and not told(pair, Code.COLLISION_AHEAD)


# ------------------------------------------------------------------------------------------------ never changed


def test_a_brake_goes_on_whatever_is_ahead():
    """Arms that were led at each other while nobody kept them apart: their stop is not made longer or shorter."""
    pair = SpacedPair(asked=False)
    pair.lead(HOME_Q_RAD, 8.0)
    pair.lead(MEET, 1.3)
    kept = SpacedPair()
    for side in Side:
        arm, other = reference(pair, side), reference(kept, side)
        other.state = arm.state
        arm.brake()
        other.brake()
        assert other.mode is ReferenceMode.BRAKE
    spacing = Spacing(kept.coordinator)
    for _ in range(60):
        kept.now_ns += 10 * MS
        spacing.look(kept.now_ns)
        for side in Side:
            frame = kept.coordinator.body.joint_arms[side].frame(kept.now_ns)
            assert frame is not None and frame.values == reference(pair, side).step()
    assert not told(kept, Code.COLLISION_AHEAD)


def test_a_walk_back_to_the_arm_is_never_held_back():
    """The arm is there: the reference goes where it is, and what else moves minds it."""
    pair = at_home()
    pair.lead(MEET, 6.0)
    arm = pair.coordinator.body.joint_arms[R]
    pair.granted(requests.Hold(epoch=pair.epoch, sides=(R,)))
    pair.run(0.5)
    arm.walk(plan({R: arm.reference}, {R: MEET[R]}, 0.3)[R])
    assert arm.is_walking
    spacing = Spacing(pair.coordinator)
    while arm.is_walking:
        pair.now_ns += 10 * MS
        spacing.look(pair.now_ns)
        for side in Side:
            pair.coordinator.body.joint_arms[side].frame(pair.now_ns)
    assert arm.values == MEET[R]


# ------------------------------------------------------------------------------------------------ who is not commanded here


@pytest.mark.thorough
def test_an_arm_in_end_effector_mode_is_an_obstacle_where_it_is_measured():
    """The joint-mode arm stops before it, and is led away again."""
    pair = SpacedPair(sim=SimSettings(state_period_ns=10 * MS, right_mode="pose"))
    pair.lead({L: HOME_Q_RAD[L]}, 8.0)
    across = onto(pair.joints(R))
    pair.lead({L: across}, 8.0)
    assert pair.off_rad({L: across}) > 0.05 and pair.least_m >= MARGIN_M - 2e-4  # what is measured is noisy
    pair.lead({L: HOME_Q_RAD[L]}, 8.0)
    assert pair.off_rad({L: HOME_Q_RAD[L]}) < 1e-9


def test_an_arm_that_moves_by_itself_has_the_room_that_it_may_take():
    """As far as its measured velocity takes it; noise takes it nowhere, and one that tells no velocity stands."""
    pair = at_home()
    spacing, arm = Spacing(pair.coordinator), pair.coordinator.body.joint_arms[R]
    here = arm.values
    arm.brake()
    assert spacing._way(R, here, here, None) == [(0.0, 0.0)] * 7  # streamed, not due in this tick
    arm.stop()
    topic = arm_state(R)
    for speeds, far in (
        ((0.5, -0.5, 0.9 * ADRIFT_RADPS, 0.0, 0.0, 0.0, 0.0), 0.05),
        ((), 0.0),
    ):
        sample = pair.heard[topic]
        state = sample.value
        assert isinstance(state, ArmState)
        moving = replace(state, dq_radps=speeds, stamp_ns=state.stamp_ns + 10 * MS)
        pair.receive(SampleArrived(topic=topic, value=moving, received_ns=pair.now_ns, stamp_ns=moving.stamp_ns))
        (back, forth), (low, high), *others = spacing._way(R, here, here, None)
        assert (back, high) == (0.0, 0.0) and forth == pytest.approx(-low) and forth >= far
        assert others == [(0.0, 0.0)] * 5


@pytest.mark.parametrize("streamed", [True, False])
def test_what_moves_an_arm_by_poses_ends_when_arms_are_kept_apart_again(streamed):
    """It began while the model was not known: told with UNGUARDED, the arm brakes; anew it is refused as ever."""
    pair = SpacedPair(sim=SimSettings(state_period_ns=10 * MS, right_mode="pose"))
    pair.model.forget()
    pose = pair.coordinator.store.pose(R)
    assert pose is not None
    there = (*(0.8 * c for c in pose.p_m), *pose.quat_xyzw)
    frames = {side: shoulder_frame(side) for side in Side}
    if streamed:
        asked = requests.OpenStream(epoch=pair.epoch, side=R, space=Space.POSE, frame=frames[R], speed=0.1)
        pair.target(pair.epoch, pair.granted(asked)["stream_id"], there)
    else:
        pair.granted(requests.MovePose(epoch=pair.epoch, targets={R: there}, frames=frames, speed=0.1))
    pair.run(0.2)
    arm = pair.coordinator.body.arms[R]
    assert arm.space is Space.POSE and arm.reference.mode is not ReferenceMode.BRAKE
    assert not arm.is_at_rest and not told(pair, Code.UNGUARDED)
    while goal_checks.why_off(pair.coordinator, pair.now_ns) is not None:
        pair.step()
    assert not arm.is_at_rest
    pair.run(0.5)
    notice = told(pair, Code.UNGUARDED)[-1]
    assert notice.facts["side"] == "right" and "it brakes" in notice.message and notice.level is Level.WARNING
    body = pair.coordinator.body
    assert arm.is_at_rest and not body.targets.running and not body.motions.running and pair.state == "ACTIVE"
    if not streamed:
        assert body.motions.views()[-1].code == "UNGUARDED"
    asked = requests.MovePose(epoch=pair.epoch, targets={R: there}, frames=frames)
    assert pair.refused(asked).code is Code.UNGUARDED


# ------------------------------------------------------------------------------------------------ on and off, and what is seen


def test_it_is_told_once_that_arms_move_and_are_not_kept_apart_and_once_that_they_are_again():
    """Motion goes on as without a model; the view says why; bounds of streams end."""
    pair = at_home()
    assert pair.see().spacing.on and not told(pair, Code.UNGUARDED)
    pair.lead(MEET, 3.0)
    pair.model.forget()
    pair.lead(HOME_Q_RAD, 0.4)
    assert all(reference(pair, side)._follower._bound == 1.0 for side in Side)
    spacing = pair.coordinator.body.spacing
    assert spacing is not None and not spacing.on and (spacing.gap_m, spacing.first, spacing.held) == (None, "", ())
    assert "cannot be relied on" in spacing.why
    pair.lead(HOME_Q_RAD, 3.0)
    pair.run(1.5)
    assert [notice.level for notice in told(pair, Code.UNGUARDED)] == [Level.WARNING]
    assert [notice.level for notice in told(pair, Code.GUARDED)] == [Level.INFO]
    assert pair.see().spacing.on


def test_arms_that_stand_are_no_reason_to_say_anything():
    """A model that is not known while nothing moves is shown, and not told."""
    pair = at_home()
    pair.model.forget()
    pair.run(0.3)
    assert not pair.see().spacing.on and not told(pair, Code.UNGUARDED)


def test_without_being_asked_for_nothing_is_looked_at():
    """Neither without a model nor with one that keeps nothing apart; there is nothing to see either."""
    for pair in (SpacedPair(asked=False), SpacedPair(asked=False, has_model=False)):
        pair.lead(HOME_Q_RAD, 1.0)
        assert pair.coordinator.body.spacing is None and pair.see().spacing is None


def test_the_nearest_pair_of_the_measured_body_is_shown():
    """Ten times a second, by the joints that were heard, also while nothing is streamed."""
    pair = at_home()
    near = model().posture({side: pair.joints(side) for side in Side}).nearest()
    spacing = pair.see().spacing
    assert spacing is not None and spacing.gap_m == pytest.approx(near.gap_m, abs=0.003)
    assert (spacing.first, spacing.second, spacing.margin_m) == (near.first, near.second, MARGIN_M)
    pair.granted(requests.Disable(epoch=pair.epoch))
    pair.run(1.0)
    assert pair.state == "IDLE" and pair.see().spacing.on


# ------------------------------------------------------------------------------------------------ what it costs


def test_what_was_found_free_is_not_judged_again_until_it_is_left(monkeypatch):
    """Far from everything the body is looked at once, and nothing is asked again; near something, as much as there is room."""
    looks, asked = judged(monkeypatch), passed(monkeypatch)
    pair = at_home()
    looks.clear()
    asked.clear()
    pair.lead({L: (*HOME_Q_RAD[L][:6], HOME_Q_RAD[L][6] - 0.4)}, 1.0)
    assert 0 < len(looks) < 10 and len(asked) < 20
    pair.lead(MEET, 5.0)
    answers = [(lookahead, passing) for lookahead, passing in asked if passing is not None]
    assert any(lookahead is not None and not passing.has_lookahead for lookahead, passing in answers)
    assert any(lookahead is None for lookahead, _ in answers) and any(passing is None for _, passing in asked)
    assert len(looks) < len(asked)


def test_velocities_are_limited_while_an_earlier_look_says_that_all_may_go_on(monkeypatch):
    """Before anything has to be held back the arms are slow already: the bound follows every few ticks."""
    looks, bounds = judged(monkeypatch), []
    pair = at_home()
    looks.clear()
    for _ in range(300):
        count = len(looks)
        pair.lead(MEET, 0.01)
        if any(not verdict.is_free for _, verdict in looks):
            break
        if len(looks) == count:
            bounds.append(min(reference(pair, side)._follower._bound for side in Side))
    assert any(after < before for before, after in pairwise(bounds))
