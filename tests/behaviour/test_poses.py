"""End-effector mode, and robots with one arm in each mode: the rules of the behaviour table, in virtual time."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from gateway.core.messages.outputs import FrameKind
from gateway.errors import Code
from gateway.messages.requests import Enable, Hold, Move, MovePose, OpenStream, Recover, Stop, Take
from gateway.robot.topics import (
    FSM_ENABLE,
    STATE_TOPICS,
    ee_pose,
    gripper_command,
    joint_command,
    pose_command,
    shoulder_frame,
)
from gateway.settings.settings import PoseSettings, Settings
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side, Space
from tests.behaviour.scene import Scene, away, scene
from tests.changed import replace
from tests.core.pose_judge import LIMITS, judge
from tests.pair import Pair

MS = 1_000_000
S = 1_000_000_000
L, R = Side.LEFT, Side.RIGHT
MIXED = SimSettings(state_period_ns=10 * MS, right_mode="pose")
FRAME = shoulder_frame(R)
POSE_TOPIC, JOINT_TOPIC = pose_command(R), joint_command(R)


def mixed(where="at rest"):
    """A robot whose right arm is in end-effector mode."""
    pair = Scene(MIXED, snapshot_hz=50)
    pair.topics = STATE_TOPICS  # end effectors' poses among them
    return scene(where, pair)


def sent(pair, topic=POSE_TOPIC):
    """Everything that left on a topic, with its time."""
    return [(at_ns, frame) for at_ns, frame in pair.frames if frame.topic == topic]


def reference(pair):
    """The right arm's last setpoint."""
    return sent(pair)[-1][1].values


def beside(pair, by_m=(0.0, 0.03, 0.03), turn_rad=0.2):
    """A pose near the present setpoint."""
    x, y, z, *quat = reference(pair)
    half = 0.5 * turn_rad
    qx, qy, qz, qw = quat
    s, c = math.sin(half), math.cos(half)  # turned about the frame's z axis
    return (x + by_m[0], y + by_m[1], z + by_m[2],
            c * qx - s * qy, c * qy + s * qx, c * qz + s * qw, c * qw - s * qz)  # fmt: skip


def moving(pair, goal=None):
    """Begin a motion of the right end effector; return its id."""
    request = MovePose(epoch=pair.epoch, targets={R: goal or beside(pair)}, frames={R: FRAME})
    return pair.granted(request, "ann")["motion_id"]


def motion(pair, motion_id):
    """What the outside sees of a motion."""
    return next(view for view in pair.see().motions if view.motion_id == motion_id)


# ----------------------------------------------------------------------------------------------------- starting, moving


def test_each_arm_of_a_mixed_robot_is_streamed_in_its_own_space() -> None:
    """One lease, one enable; no joint setpoint goes to the arm in end-effector mode, and no pose to the other."""
    pair = mixed()
    topics = {frame.topic for _, frame in pair.frames}
    grippers = {gripper_command(side) for side in Side}
    assert topics - grippers == {joint_command(L), POSE_TOPIC, FSM_ENABLE}
    arms = pair.see().arms
    assert (arms["left"].space, arms["right"].space) == ("joint", "pose")
    assert arms["right"].streaming and arms["right"].q_ref_rad == () and arms["right"].ref_p_m


def test_a_pose_stream_starts_within_a_millimetre_of_the_measured_pose() -> None:
    """The first setpoint is where the arm is."""
    pair = mixed("IDLE")
    pair.run(0.4)
    measured = pair.see().arms["right"]
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: bool(sent(pair)))
    first = sent(pair)[0][1]
    assert first.kind is FrameKind.ECHO
    assert math.dist(first.values[:3], measured.p_m) < 0.001


def hanging(reach_m):
    """A robot whose right end effector hangs 0.545 m from its shoulder, more than a tighter configuration allows; owned."""
    pair = Pair(Settings(pose=PoseSettings(reach_m=reach_m)), MIXED)
    pair.run_until(lambda: pair.state == "READ_ONLY" and pair.knows_mode)
    pair.run(0.5)
    pair.epoch = pair.own("ann")
    return pair


def test_a_start_a_centimetre_beyond_the_reach_begins_at_its_end_and_says_so() -> None:
    """The stream starts at the end of the reach; from there it can be moved, inwards."""
    pair = hanging(0.54)
    measured = pair.heard[ee_pose(R)].value.p_m
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE")
    first = reference(pair)
    assert math.hypot(*first[:3]) == pytest.approx(0.54, abs=1e-9) and math.dist(first[:3], measured) < 0.01
    assert Code.START_AT_LIMIT in pair.codes()
    out = MovePose(epoch=pair.epoch, targets={R: beside(pair, (0.0, 0.0, -0.02))}, frames={R: FRAME})
    assert pair.refused(out, "ann").code is Code.OUT_OF_RANGE
    moving(pair)
    pair.run(2.0)
    judge([frame.values for _, frame in sent(pair)], replace(LIMITS, reach_m=0.54))


def test_a_start_far_beyond_the_reach_refuses_enable() -> None:
    """More than a centimetre: with value and bound; nothing is sent."""
    pair = hanging(0.53)
    refusal = pair.refused(Enable(epoch=pair.epoch), "ann")
    assert refusal.code is Code.START_OUTSIDE_LIMITS and refusal.bound == "[0, 0.53]"
    pair.run(0.5)
    assert pair.state == "IDLE" and not sent(pair)


def test_poses_are_sent_at_70_hz_in_intervals_of_one_length() -> None:
    """14.29 ms each: the stream has its own grid beside the arms' 100 Hz."""
    pair = mixed()
    pair.mark()
    pair.run(2.0)
    due = [frame.due_ns for _, frame in sent(pair)]
    assert len(due) >= 139
    assert all(abs(b - a - S / 70) <= 1 for a, b in pairwise(due[-100:]))


def test_a_pose_motion_arrives_within_5_mm_and_0_05_rad_for_half_a_second() -> None:
    """Proven by the measured pose; every setpoint inside the linear and angular limits, the sign never flipping."""
    pair = mixed()
    motion_id = moving(pair)
    pair.run_until(lambda: motion(pair, motion_id).state == "reached", 10.0)
    view = motion(pair, motion_id)
    assert view.space == "pose" and view.error_m < 0.005 and view.error_rad < 0.05
    judge([frame.values for _, frame in sent(pair)], LIMITS)


def test_joints_of_one_arm_and_the_end_effector_of_the_other_move_at_once() -> None:
    """Two motions under one lease; each arrives."""
    pair = mixed()
    right = moving(pair)
    left = pair.granted(Move(epoch=pair.epoch, targets_rad={L: away(pair, L)}), "ann")["motion_id"]
    pair.run_until(lambda: motion(pair, left).state == motion(pair, right).state == "reached", 15.0)


def test_a_stream_of_poses_is_followed_and_expires() -> None:
    """As a stream of joints: without a successor the arm brakes and holds."""
    pair = mixed()
    opening = OpenStream(epoch=pair.epoch, side=R, space=Space.POSE, frame=FRAME, expiry_ns=200 * MS)
    stream_id = pair.granted(opening, "ann")["stream_id"]
    goal = beside(pair)
    for _ in range(40):
        pair.target(pair.epoch, stream_id, goal, "ann")
        pair.run(0.05)
    assert reference(pair) == pytest.approx(goal, abs=1e-9)
    pair.target(pair.epoch, stream_id, beside(pair, (0.05, 0.0, 0.0)), "ann")
    pair.run(1.0)
    assert pair.told(Code.TARGET_EXPIRED)
    judge([frame.values for _, frame in sent(pair)], LIMITS)


@pytest.mark.parametrize(
    ("how", "code"),
    [
        ({"frames": {}}, Code.WRONG_FRAME),
        ({"frames": {R: shoulder_frame(L)}}, Code.WRONG_FRAME),
        ({"targets": {R: (0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0)}}, Code.OUT_OF_RANGE),
        ({"targets": {R: (0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0)}}, Code.OUT_OF_RANGE),
        ({"targets": {R: (0.3, 0.0, 0.0, 0.0, 0.0, 0.0, math.nan)}}, Code.NOT_FINITE),
        ({"targets": {L: (0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)}, "frames": {L: shoulder_frame(L)}},
         Code.MODEL_OFF),
    ],
)  # fmt: skip
def test_what_is_no_pose_for_this_arm_is_refused(how, code) -> None:
    """The wrong arm's frame, none, beyond the reach, no orientation, not finite, or an arm in joint mode and no body model."""
    pair = mixed()
    request = {"epoch": pair.epoch, "targets": {R: beside(pair)}, "frames": {R: FRAME}, **how}
    assert pair.refused(MovePose(**request), "ann").code is code
    assert pair.refused(Move(epoch=pair.epoch, targets_rad={R: away(pair, R)}), "ann").code is Code.WRONG_CONTROL_MODE


# ----------------------------------------------------------------------------------------------------- stopping, losing


@pytest.mark.parametrize("how", ["hold", "stop", "client"])
def test_an_end_effector_brakes_along_its_way_and_is_held(how) -> None:
    """`hold`, `stop` and the loss of the client: no step, no gap, and rest within the limits."""
    pair = mixed()
    moving(pair, beside(pair, (0.0, 0.06, 0.06)))
    pair.run(0.4)
    if how == "hold":
        pair.granted(Hold(epoch=pair.epoch, sides=(R,)), "ann")
    elif how == "stop":
        pair.granted(Stop(), "ann")
    else:
        pair.kill("ann")
    pair.run(2.0)
    frames = sent(pair)
    assert frames[-1][1].kind is FrameKind.HOLD
    assert max(b - a for (a, _), (b, _) in pairwise(frames)) < 100 * MS
    judge([frame.values for _, frame in frames], LIMITS)
    assert pair.state == ("ACTIVE" if how == "hold" else "HOLDING")


def test_a_takeover_in_mid_motion_goes_on_from_the_last_setpoint() -> None:
    """Braked, held, and moved on by the new owner; never seeded anew."""
    pair = mixed()
    moving(pair, beside(pair, (0.0, 0.06, 0.06)))
    pair.run(0.4)
    epoch = pair.granted(Take(name="bob", pid=2, reason="test"), "bob")["epoch"]
    pair.alive.add("bob")
    pair.run(1.5)
    request = MovePose(epoch=epoch, targets={R: beside(pair)}, frames={R: FRAME})
    pair.granted(request, "bob")
    pair.run(1.0)
    judge([frame.values for _, frame in sent(pair)], LIMITS)


def test_a_short_stall_holds_the_pose_and_goes_on() -> None:
    """At rest: the constant pose is repeated for at most 0.8 s, and after it HOLDING."""
    pair = mixed()
    pair.run(0.5)
    held = reference(pair)
    pair.freeze()
    pair.run(0.5)
    assert pair.state == "STALE"
    pair.thaw()
    pair.run_until(lambda: pair.state == "HOLDING", 1.5)
    assert math.dist(reference(pair)[:3], held[:3]) < 0.005


def test_an_end_effector_whose_pose_falls_silent_is_a_dead_part() -> None:
    """Its joints are heard; braked and held, and the motion ends with PART_LOST."""
    pair = mixed()
    motion_id = moving(pair)
    pair.run(0.2)
    pair.robot.inject({"fault": "drop", "topic": ee_pose(R)}, pair.now_ns)
    pair.run(0.3)
    assert pair.state == "HOLDING" and motion(pair, motion_id).code == "PART_LOST"


def test_an_end_effector_that_is_blocked_is_a_tracking_error() -> None:
    """6 cm or 0.3 rad for 0.3 s: braked, held, latched."""
    pair = mixed()
    pair.robot.inject({"fault": "blocked", "side": "right"}, pair.now_ns)
    moving(pair, beside(pair, (0.0, 0.1, 0.1)))
    pair.run_until(lambda: pair.state == "HOLDING", 5.0)
    assert Code.TRACKING_ERROR.value in pair.see().latches


def test_a_held_end_effector_walks_back_to_an_arm_that_was_led_away() -> None:
    """After `recover` the reference goes to where the arm is, inside the limits."""
    pair = mixed()
    pair.robot.inject({"fault": "blocked", "side": "right"}, pair.now_ns)
    moving(pair, beside(pair, (0.0, 0.1, 0.1)))
    pair.run_until(lambda: pair.state == "HOLDING", 5.0)
    pair.run(1.0)
    pair.granted(Recover(), "ann")
    pair.run(5.0)
    assert pair.told(Code.WALK)
    measured = pair.see().arms["right"]
    assert math.dist(reference(pair)[:3], measured.p_m) < 0.01
    judge([frame.values for _, frame in sent(pair)], LIMITS)


def test_an_arm_whose_mode_is_changed_while_it_is_streamed_is_let_go() -> None:
    """As if disabled, with WRONG_CONTROL_MODE in the text; the next `enable` takes it up in its new mode."""
    pair = mixed()
    motion_id = moving(pair)
    pair.run(0.2)
    pair.robot.inject({"fault": "control_mode", "side": "right", "mode": "joint"}, pair.now_ns)
    pair.run(1.5)
    assert pair.state == "HOLDING" and pair.streaming == [L]
    assert motion(pair, motion_id).code == "ARM_DISABLED"
    assert "WRONG_CONTROL_MODE" in motion(pair, motion_id).message
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run(0.5)
    assert sent(pair, JOINT_TOPIC) and pair.see().arms["right"].space == "joint"
    pair.granted(Move(epoch=pair.epoch, targets_rad={R: away(pair, R)}), "ann")
