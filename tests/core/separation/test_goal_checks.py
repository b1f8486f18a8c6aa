"""The door of the guard: when arms are kept apart, where they are, and which goals leave no room."""

from __future__ import annotations

import random

import pytest

from gateway.core.messages.outputs import Remembered
from gateway.core.separation import goal_checks
from gateway.core.supervision.coordinator import Coordinator
from gateway.errors import CODES, Code
from gateway.messages import requests
from gateway.robot.limits import HOME_Q_RAD
from gateway.settings.settings import Settings
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side, Space
from tests.changed import replace
from tests.kinematics.guarded_arms import MARGIN_M, MEET, model, random_joints
from tests.pair import MS
from tests.spaced import SpacedPair

L, R = Side.LEFT, Side.RIGHT


def at_home(**changes):
    """Return a robot at home whose arms are kept apart."""
    pair = SpacedPair(**changes)
    pair.lead(HOME_Q_RAD, 8.0)
    return pair


@pytest.fixture(scope="module")
def pair():
    """A robot at home, for questions that change nothing."""
    return at_home()


def close(gap_m):
    """Return both arms' joints on the way from home to the meeting place where the nearest parts are so far apart."""
    low, high = 0.0, 1.0
    for _ in range(50):
        part = 0.5 * (low + high)
        q_rad = between(part)
        low, high = (part, high) if model().posture(q_rad).nearest().gap_m > gap_m else (low, part)
    return between(low)


def between(part):
    """Return joints part of the way from home to the meeting place."""
    return {side: tuple(a + part * (b - a) for a, b in zip(HOME_Q_RAD[side], MEET[side], strict=True)) for side in Side}


def test_it_is_off_where_nobody_asks_for_it_and_while_the_model_is_not_known(pair):
    """Each with code, setting or figure; on as soon as both arms agree."""
    assert goal_checks.why_off(pair.coordinator, pair.now_ns) is None
    off = goal_checks.why_off(SpacedPair(asked=False).coordinator, pair.now_ns)
    assert off is not None and (off.code, off.field, off.value) == (Code.MODEL_OFF, "model.self_collision", "false")
    young = SpacedPair()
    young.model.forget()
    off = goal_checks.why_off(young.coordinator, young.now_ns)
    assert off is not None and off.code is Code.MODEL_UNKNOWN and "left" in off.message


def test_arms_are_where_their_setpoints_are_else_where_they_are_measured(pair):
    """An arm that was never heard is nowhere."""
    assert goal_checks.whereabouts(pair.coordinator) == pair.setpoints
    resting = SpacedPair(sim=SimSettings(state_period_ns=10 * MS, right_mode="pose"))
    assert goal_checks.whereabouts(resting.coordinator)[R] == resting.joints(R)
    assert goal_checks.whereabouts(Coordinator(Settings(), Remembered())) == {}


@pytest.mark.parametrize("asked", [MEET, between(0.9), close(0.019)])
def test_a_goal_inside_the_margin_is_refused_with_pair_distance_bound_and_remedy(pair, asked):
    """As a point-to-point motion and as the end of a trajectory, before anything moves."""
    near = model().posture(asked).nearest()
    refusal = pair.refused(requests.Move(epoch=pair.epoch, targets_rad=asked))
    assert refusal.code is Code.GOAL_TOO_NEAR and CODES[refusal.code].hint
    assert near.first in refusal.message and near.second in refusal.message
    assert (refusal.value, refusal.bound, refusal.unit) == (f"{near.gap_m:.4f}", ">= 0.02", "m")
    assert refusal.field == "left_arm and right_arm"
    assert ("inside each other" in refusal.message) == (near.gap_m < 0.0)
    points = {side: [HOME_Q_RAD[side], asked[side]] for side in Side}
    again = pair.refused(requests.Follow(epoch=pair.epoch, points=points, dt_s=20.0))
    assert replace(again, message="") == replace(refusal, message="")
    checked = requests.CheckFollow(follow=requests.Follow(epoch=0, points=points, dt_s=20.0), from_here=True)
    assert pair.refused(checked).code is Code.GOAL_TOO_NEAR
    assert pair.off_rad(HOME_Q_RAD) < 1e-9 and not pair.coordinator.body.motions.running


def named(refusal):
    """Return the parts that a refusal is about."""
    return set(refusal.message.partition(" would be ")[0].split(" and "))


def test_of_a_pose_only_what_it_places_is_judged(pair):
    """The hands, and what other arms hold: not the elbows of arms that may be bent otherwise on the way there."""
    refusal = goal_checks.check_goals(pair.coordinator, MEET, pair.now_ns, hands_only=True)
    assert refusal is not None and refusal.code is Code.GOAL_TOO_NEAR
    bent, rng, seen = {"left_upper", "left_forearm"}, random.Random(4), 0
    while seen < 5:
        goals = {L: random_joints(rng)[L]}
        whole = goal_checks.check_goals(pair.coordinator, goals, pair.now_ns)
        hand = goal_checks.check_goals(pair.coordinator, goals, pair.now_ns, hands_only=True)
        if hand is not None:
            assert whole is not None and not named(hand) & bent
        elif whole is not None:
            assert named(whole) & bent
            seen += 1


def test_a_goal_with_the_margin_left_is_accepted(pair):
    """A millimetre more than the margin."""
    goals = close(MARGIN_M + 0.001)
    assert goal_checks.check_goals(pair.coordinator, goals, pair.now_ns) is None


def test_the_other_arm_is_looked_at_where_it_is_bound_for():
    """A goal that is free now, and would not be when the other arm's motion is over; and the other way round."""
    pair = at_home()
    goals = close(0.015)
    assert goal_checks.check_goals(pair.coordinator, {L: goals[L]}, pair.now_ns) is None
    pair.move(pair.epoch, {R: goals[R]}, speed=0.1)
    refusal = pair.refused(requests.Move(epoch=pair.epoch, targets_rad={L: goals[L]}))
    assert refusal.code is Code.GOAL_TOO_NEAR and refusal.field == "left_arm"
    pair.granted(requests.Hold(epoch=pair.epoch, sides=(R,)))
    assert goal_checks.check_goals(pair.coordinator, {L: goals[L]}, pair.now_ns) is None


def test_what_is_inside_the_margin_already_may_part_and_not_come_nearer():
    """However it came there: here the arms were led there while nobody kept them apart."""
    pair = at_home(asked=False)
    pair.lead(close(0.012), 8.0)
    kept = at_home()
    for side in Side:
        kept.coordinator.body.joint_arms[side].reference.seed(pair.setpoints[side])
    assert goal_checks.check_goals(kept.coordinator, close(0.013), kept.now_ns) is None
    assert goal_checks.check_goals(kept.coordinator, HOME_Q_RAD, kept.now_ns) is None
    refusal = goal_checks.check_goals(kept.coordinator, close(0.011), kept.now_ns)
    assert refusal is not None and "(now 12 mm apart)" in refusal.message


def test_goals_are_not_judged_where_it_is_off():
    """Not asked for, without a model, or with one that is not known to agree: as before."""
    unknown = SpacedPair()
    unknown.model.forget()
    for pair in (SpacedPair(asked=False), SpacedPair(asked=False, has_model=False), unknown):
        assert goal_checks.check_goals(pair.coordinator, MEET, pair.now_ns) is None
        assert goal_checks.check_unguarded(pair.coordinator, (L,), Space.POSE, pair.now_ns) is None


def test_an_arm_in_end_effector_mode_is_not_moved_by_poses_while_arms_are_kept_apart():
    """Nobody knows where its joints would go: refused with the remedy; the other arm's joints may move."""
    pair = SpacedPair(sim=SimSettings(state_period_ns=10 * MS, right_mode="pose"))
    pose = pair.coordinator.store.pose(R)
    assert pose is not None
    refusal = pair.refused(requests.MovePose(epoch=pair.epoch, targets={R: pose.values}, frames={}))
    assert (refusal.code, refusal.field, refusal.bound) == (Code.UNGUARDED, "right_arm", "joint")
    assert "self_collision" in CODES[refusal.code].hint
    stream = requests.OpenStream(epoch=pair.epoch, side=R, space=Space.POSE)
    assert pair.refused(stream).code is Code.UNGUARDED
    pair.move(pair.epoch, {L: HOME_Q_RAD[L]})
