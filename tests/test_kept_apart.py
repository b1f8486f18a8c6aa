"""Arms that are kept apart, as a whole and in virtual time: whatever is streamed, moved or followed, 2 cm stay free."""

from __future__ import annotations

import math
import random

import pytest

from gateway.errors import Code
from gateway.messages import requests
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import shoulder_frame
from gateway.settings.settings import ArmSettings
from gateway.values import Side
from tests.kinematics.guarded_arms import LIMITS, MARGIN_M, MEET, ROUNDING_M, free_posture, model, random_joints
from tests.kinematics.peer import has_pinocchio, pinocchio_least
from tests.spaced import SpacedPair
from tests.thoroughness import either

L, R = Side.LEFT, Side.RIGHT
FRAMES = {side: shoulder_frame(side) for side in Side}
SAG_M = 0.004
"""How much nearer the simulated arms come than their setpoints: they lag, and sag by some milliradians."""


def limits(v_radps, a_radps2, j_radps3):
    """Return settings of arms."""
    return ArmSettings(v_radps=v_radps, a_radps2=a_radps2, j_radps3=j_radps3)


def test_without_it_these_targets_are_a_collision():
    """What the other tests show is not that nothing was near."""
    pair = SpacedPair(asked=False)
    pair.lead(HOME_Q_RAD, 10.0)
    pair.lead(MEET, 6.0)
    assert pair.least_m < -0.05


@pytest.mark.parametrize("limit", either(LIMITS[:2], LIMITS))
def test_arms_that_stream_towards_each_other_stop_with_two_centimetres_left_and_part_again(limit):
    """By the setpoints and by pinocchio's capsules as well; the robot's own arms come as near as they sag."""
    pair, slow = SpacedPair(limits(*limit)), 3.0 if limit[0] < 0.3 else 1.0
    pair.lead(HOME_Q_RAD, 8.0 * slow)
    pair.lead(MEET, 8.0 * slow)
    near = pair.look()
    assert pair.least_m >= MARGIN_M - ROUNDING_M and pair.least_measured_m >= MARGIN_M - SAG_M
    assert near.gap_m < MARGIN_M + 0.01 and pair.off_rad(MEET) > 0.05
    assert {near.first.partition("_")[0], near.second.partition("_")[0]} == {"left", "right"}
    if has_pinocchio():
        assert pinocchio_least(model())(pair.setpoints) == pytest.approx(near.gap_m, abs=1e-6)
    spacing = pair.see().spacing
    assert spacing is not None and spacing.on and spacing.gap_m == pytest.approx(near.gap_m, abs=SAG_M)
    assert spacing.held
    assert pair.codes().count(Code.COLLISION_AHEAD) >= 1
    pair.lead(HOME_Q_RAD, 10.0 * slow)
    assert pair.off_rad(HOME_Q_RAD) < 1e-9 and pair.least_m >= MARGIN_M - ROUNDING_M
    assert pair.state == "ACTIVE" and not pair.engine.latches


def test_arms_of_a_calibrated_robot_stop_with_the_margin_between_where_they_really_are():
    """Zeros that are off by up to 60 mrad, and a model that knows it: setpoints alone tell of other places."""
    pair = SpacedPair(is_calibrated=True)
    pair.lead(HOME_Q_RAD, 8.0)
    pair.lead(MEET, 8.0)
    assert pair.look().gap_m < MARGIN_M + 0.01 and pair.off_rad(MEET) > 0.05
    assert pair.least_m >= MARGIN_M - ROUNDING_M and pair.least_measured_m >= MARGIN_M - SAG_M
    assert Code.COLLISION_AHEAD in pair.codes() and pair.see().spacing.on


def test_random_targets_at_any_limits_keep_the_margin():
    """Both arms, new targets before the last ones are reached, in collision or not, limits anywhere in the config's range."""
    rng, held = random.Random(17), 0
    for _ in range(either(3, 24)):
        limit = (math.exp(rng.uniform(-1.0, math.log(3.0))), rng.uniform(1.0, 15.0), rng.uniform(5.0, 300.0))
        pair = SpacedPair(limits(*limit))
        for _ in range(5):
            pair.lead(
                {side: random_joints(rng)[side] for side in rng.choice([(L,), (R,), (L, R), (L, R)])},
                rng.uniform(0.3, 2.5),
            )
        held += Code.COLLISION_AHEAD in pair.codes()
        assert pair.least_m >= MARGIN_M - ROUNDING_M, (limit, pair.look())
        assert pair.state == "ACTIVE" and not pair.engine.latches
    assert held


def test_random_moves_end_at_their_goals_or_before_anything_is_touched():
    """Goals that are free: most are reached; where the straight way leads through something, the motion ends before it."""
    rng, ended = random.Random(23), []
    pair = SpacedPair()
    for _ in range(either(8, 40)):
        goals = free_posture(rng)
        sides = rng.choice([(L,), (R,), (L, R)])
        reply = pair.ask(requests.Move(epoch=pair.epoch, targets_rad={side: goals[side] for side in sides}))
        if reply.refusal is not None:
            assert reply.refusal.code is Code.GOAL_TOO_NEAR
            continue
        for _ in range(1000):
            pair.step()
            pair.look()
            if not pair.coordinator.body.motions.running:
                break
        ended.append(pair.coordinator.body.motions.views()[-1].code)
        assert pair.least_m >= MARGIN_M - ROUNDING_M
    # Straight ways between random postures of the whole range lead through the body about every other time.
    assert set(ended) == {"", "COLLISION_AHEAD"} and ended.count("") > ended.count("COLLISION_AHEAD")


def test_a_stop_near_the_other_arm_is_a_stop_as_quick_as_ever():
    """At full speed towards each other: both arms rest after v/a + a/j, with the margin left."""
    pair = SpacedPair()
    pair.lead(HOME_Q_RAD, 8.0)
    pair.lead(MEET, 0.7)
    assert not pair.coordinator.body.is_at_rest
    pair.granted(requests.Stop())
    pair.run(0.55)
    assert pair.coordinator.body.is_at_rest and pair.state == "HOLDING"
    pair.look()
    assert pair.least_m >= MARGIN_M - ROUNDING_M


def script(pair):
    """Move, stream, follow a chunk and brake, far from everything; return all frames as they left."""
    pair.move(pair.epoch, HOME_Q_RAD, speed=0.3)
    pair.run(5.0)
    aside = {side: tuple(q + 0.1 * (n % 3 - 1) for n, q in enumerate(HOME_Q_RAD[side])) for side in Side}
    pair.lead(aside, 1.0)
    pair.lead({L: HOME_Q_RAD[L]}, 0.5)
    begin = pair.setpoints[R]
    rows = [tuple(q + 0.002 * n for q in begin) for n in range(20)]
    pair.granted(requests.Follow(epoch=pair.epoch, points={R: rows}, dt_s=0.05))
    pair.run(0.6)
    pair.granted(requests.Stop())
    pair.run(1.0)
    return [(at_ns, frame.topic, frame.kind, frame.values) for at_ns, frame in pair.frames]


def test_where_it_is_off_and_where_nothing_is_near_not_a_bit_of_a_setpoint_is_another():
    """Without a model, with one that keeps nothing apart, and with one that does: the same frames at the same times."""
    without = script(SpacedPair(asked=False, has_model=False))
    assert len(without) > 1000
    assert script(SpacedPair(asked=False)) == without
    kept = SpacedPair()
    assert script(kept) == without
    assert kept.see().spacing.on and Code.COLLISION_AHEAD not in kept.codes()


@pytest.mark.parametrize(("straight", "through"), [(True, "COLLISION_AHEAD"), (False, "reached")])
def test_poses_of_an_arm_in_joint_mode_are_kept_apart_like_any_path(straight, through):
    """Beside an arm that is in the way or is not: reached, refused at once, or ended before anything is touched."""
    pair, states = SpacedPair(), []
    pair.lead(HOME_Q_RAD, 8.0)
    held = pair.coordinator.model.arms[L].forward(HOME_Q_RAD[L])
    for way_m in ((0.0, -0.1, 0.0), (0.0, -0.3, 0.15), (-0.05, -0.35, 0.05), (0.0, 0.0, 0.0)):
        target = (*(a + b for a, b in zip(held.p_m, way_m, strict=True)), *held.quat_xyzw)
        asked = requests.MovePose(epoch=pair.epoch, targets={L: target}, frames=FRAMES, straight=straight)
        reply = pair.ask(asked)
        if reply.refusal is not None:
            states.append(reply.refusal.code.value)
            continue
        for _ in range(1500):
            pair.step()
            pair.look()
            if not pair.coordinator.body.motions.running:
                break
        view = pair.coordinator.body.motions.views()[-1]
        states.append(view.code or view.state)
        assert pair.least_m >= MARGIN_M - ROUNDING_M
    assert states == ["reached", through, "GOAL_TOO_NEAR", "reached"]
    assert pair.state == "ACTIVE" and not pair.engine.latches
