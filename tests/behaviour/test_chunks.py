"""Trajectories and action chunks of the owner against the simulated robot: the jump, both arms, and what ends them."""

from __future__ import annotations

import math
from typing import Any

import pytest

from gateway.core.messages.outputs import FrameKind
from gateway.core.motion.poses.quaternion import exp, multiply
from gateway.errors import Code
from gateway.messages.requests import Follow, Stop
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import STATE_TOPICS, pose_command, shoulder_frame
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side, Space, Vector
from tests.behaviour.scene import Scene, scene, watched
from tests.core.pose_judge import LIMITS, judge
from tests.pair import MS, S

LEFT, RIGHT = Side.LEFT, Side.RIGHT


def chunk_from(pair: Scene, *sides: Side, off_rad: float = 0.0, count: int = 60, rate: float = 1.0) -> dict[str, Any]:
    """A swing of joint 3 by 0.2 rad at 30 Hz, beginning so far from where these arms are held."""
    swings = [0.1 * (1.0 - math.cos(rate * n / 30)) + off_rad for n in range(count)]
    held = pair.arm_frames_now()
    points = {side: [(*held[side][:2], held[side][2] + s, *held[side][3:]) for s in swings] for side in sides}
    return {"points": points, "dt_s": 1 / 30}


def test_a_chunk_may_begin_a_tenth_of_a_radian_from_the_reference() -> None:
    """It is joined inside all limits, and reached."""
    pair = watched()
    motion = pair.granted(Follow(epoch=pair.epoch, **chunk_from(pair, LEFT, off_rad=0.099)), "ann")["motion_id"]
    pair.run(3.0)
    assert pair.motion_view(motion).state == "reached"


def test_a_chunk_that_begins_farther_away_is_refused() -> None:
    """With joint, value, bound and what to do; nothing moves."""
    pair = watched()
    refusal = pair.refused(Follow(epoch=pair.epoch, **chunk_from(pair, LEFT, off_rad=0.101)), "ann")
    assert (refusal.code, refusal.field, refusal.unit) == (Code.JUMP_TOO_FAR, "left_arm[0][2]", "rad")
    assert refusal.value.startswith("0.101") and refusal.bound == "0.1"
    pair.run(0.2)
    assert pair.kinds_since(pair.mark_ns) <= {FrameKind.HOLD, FrameKind.BEAT} and not pair.moved()


def test_a_chunk_of_two_arms_of_which_one_is_lost_aborts_for_both() -> None:
    """With a code for each; the other arm brakes and holds."""
    pair = watched()
    motion = pair.granted(Follow(epoch=pair.epoch, **chunk_from(pair, LEFT, RIGHT)), "ann")["motion_id"]
    pair.run(0.8)
    pair.mark()
    pair.disable_arm(RIGHT)
    pair.brakes_and_holds()
    view = pair.motion_view(motion)
    assert (view.state, view.code) == ("aborted", "ARM_DISABLED")
    assert "left arm PART_LOST" in view.message and "right arm ARM_DISABLED" in view.message


def test_a_stop_ends_a_chunk_and_one_that_waits() -> None:
    """The chunk under way and its successor alike: the arms brake and hold, and nothing begins later."""
    pair = watched()
    pair.granted(Follow(epoch=pair.epoch, **chunk_from(pair, LEFT, RIGHT), open_end=True), "ann")
    pair.run(0.8)
    later = Follow(epoch=pair.epoch, **chunk_from(pair, LEFT, RIGHT), start_in_ns=400_000_000)
    motion = pair.granted(later, "ann")["motion_id"]
    pair.run(0.1)
    pair.granted(Stop(), "ann")
    pair.mark()
    pair.brakes_and_holds()
    assert pair.motion_view(motion).code == "STOPPED"


# ------------------------------------------------------------------------------------------------ poses

MIXED = SimSettings(state_period_ns=10 * MS, right_mode="pose")
FRAMES = {RIGHT: shoulder_frame(RIGHT)}


@pytest.fixture
def mixed() -> Scene:
    """A robot whose right arm is in end-effector mode, held."""
    pair = Scene(MIXED, snapshot_hz=50)
    pair.topics = STATE_TOPICS  # end effectors' poses among them
    return scene("at rest", pair)


def poses_from(pair: Scene, *, off_m: float = 0.0, count: int = 60, rate: float = 1.2) -> dict[str, Any]:
    """A swing of the right end effector by 5 cm at 30 Hz, turning a little, beginning so far from where it is held."""
    x, y, z, *quat = pair.sent_on(pose_command(RIGHT))[-1][1].values
    rows = []
    for n in range(count):
        s = 1.0 - math.cos(rate * n / 30)
        turned = multiply(exp((0.0, 0.0, 0.1 * s)), tuple(quat))
        sign = -1.0 if n % 3 == 0 else 1.0
        rows.append((x - 0.025 * s, y, z + 0.01 * s + off_m, *(sign * c for c in turned)))
    return {"points": {RIGHT: rows}, "dt_s": 1 / 30, "space": Space.POSE}


def poses_sent(pair: Scene) -> list[Vector]:
    """Every pose that was sent."""
    return [frame.values for _, frame in pair.sent_on(pose_command(RIGHT))]


def test_a_chunk_of_poses_may_begin_two_centimetres_from_the_reference(mixed: Scene) -> None:
    """It is followed inside all limits, its quaternions in any signs, and reached; its successor takes over at speed."""
    first = Follow(epoch=mixed.epoch, **poses_from(mixed, off_m=0.019), frames=FRAMES, open_end=True)
    mixed.granted(first, "ann")
    chunk = poses_from(mixed, off_m=0.019)
    mixed.run(0.8)
    tolerances = {RIGHT: (0.03, 0.2)}
    later = Follow(
        epoch=mixed.epoch,
        **chunk,
        frames=FRAMES,
        start_in_ns=-810 * MS,
        path_tolerance=tolerances,
        goal_time_ns=2 * S,
    )
    facts = mixed.granted(later, "ann")
    assert facts["skipped"] in {24, 25}
    mixed.run_until(lambda: mixed.motion_view(facts["motion_id"]).state == "reached", 6.0)
    judge(poses_sent(mixed), LIMITS)
    goal = chunk["points"][RIGHT][-1]
    assert math.dist(poses_sent(mixed)[-1][:3], goal[:3]) < 1e-6


def test_a_chunk_of_poses_that_begins_farther_away_is_refused(mixed: Scene) -> None:
    """As is one in the other arm's frame, one in no frame, and one of joints for an arm in end-effector mode."""
    far = mixed.refused(Follow(epoch=mixed.epoch, **poses_from(mixed, off_m=0.021), frames=FRAMES), "ann")
    assert (far.code, far.unit, far.bound) == (Code.JUMP_TOO_FAR, "m", "0.02")
    chunk = poses_from(mixed)
    other = {RIGHT: shoulder_frame(LEFT)}
    assert mixed.refused(Follow(epoch=mixed.epoch, **chunk, frames=other), "ann").code is Code.WRONG_FRAME
    assert mixed.refused(Follow(epoch=mixed.epoch, **chunk), "ann").code is Code.WRONG_FRAME
    joints = {"points": {RIGHT: [HOME_Q_RAD[RIGHT]] * 3}, "dt_s": 0.1}
    assert mixed.refused(Follow(epoch=mixed.epoch, **joints), "ann").code is Code.WRONG_CONTROL_MODE
    fast = poses_from(mixed, rate=9.0)
    refusal = mixed.refused(Follow(epoch=mixed.epoch, **fast, frames=FRAMES), "ann")
    assert refusal.code is Code.TOO_FAST and "stretch=" in refusal.hint


def test_a_chunk_of_poses_that_runs_out_brakes_and_holds(mixed: Scene) -> None:
    """UNDERRUN; the end effector comes to rest inside its limits."""
    request = Follow(epoch=mixed.epoch, **poses_from(mixed, count=30), frames=FRAMES, open_end=True)
    motion = mixed.granted(request, "ann")["motion_id"]
    mixed.run(3.0)
    assert mixed.motion_view(motion).code == "UNDERRUN"
    sent = poses_sent(mixed)
    judge(sent, LIMITS)
    assert sent[-1] == sent[-20]
