"""BEHAVIOUR, Where the manual can be read in two ways: what the gateway promises holds under both."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.core.guardian import Phase
from gateway.errors import Code
from gateway.messages.requests import Disable, Enable, Move, MovePose, SetGripper, Stop
from gateway.robot.topics import STATE_TOPICS, arm_state, joint_command, pose_command, shoulder_frame
from gateway.settings.settings import LocalSettings, ModelSettings, PoseSettings, Settings
from gateway.sim.robot.geometry import arm_geometry
from gateway.sim.robot.settings import POSE_SILENCE, SimSettings
from gateway.values import Side, Vector
from tests.behaviour.scene import HOME, Scene, scene
from tests.guarded import Guarded
from tests.pair import MS, Pair, S

R = Side.RIGHT
COMMANDS = {"joint": joint_command(R), "pose": pose_command(R)}


def robot_with(mode: str, state: str = "at rest", pose: PoseSettings | None = None, **choices: object) -> Scene:
    """Return a scene whose right arm is in a control mode, with further choices about the robot."""
    sim = SimSettings(state_period_ns=10 * MS, right_mode=mode, **choices)  # type: ignore[arg-type]  # names of settings
    pair = Scene(sim, snapshot_hz=50, pose=pose)
    pair.topics = STATE_TOPICS
    return scene(state, pair)


def sent(pair: Scene, mode: str, since_ns: int = 0) -> list[Vector]:
    """Return the right arm's setpoints since a time."""
    return [frame.values for _, frame in pair.sent_on(COMMANDS[mode], since_ns)]


def begin_motion(pair: Scene, mode: str) -> None:
    """Move the right arm far: home, or its end effector by 0.2 m."""
    request: Move | MovePose = Move(epoch=pair.epoch, targets_rad={R: HOME[R]})
    if mode == "pose":
        x, y, z, *quat_xyzw = sent(pair, mode)[-1]
        goal = (x + 0.14, y, z + 0.14, *quat_xyzw)
        request = MovePose(epoch=pair.epoch, targets={R: goal}, frames={R: shoulder_frame(R)})
    pair.granted(request, "ann")


# ------------------------------------------------------------------------------------- values that stand still (§4.8)


@pytest.mark.parametrize("is_held", [True, False])
@pytest.mark.parametrize("mode", COMMANDS)
def test_joints_that_are_told_to_stand_still_end_the_motion_and_give_way_to_what_is_told(
    mode: str, is_held: bool
) -> None:
    """Fresh stamps over old values: tracking error, brake, walk. A held arm is free without a jump, one elsewhere goes back."""
    pair = robot_with(mode)
    arm, start = pair.robot.arms[R], sent(pair, mode)[-1]
    for joint in (4, 5, 6, 7) if mode == "joint" else range(1, 8):
        pair.robot.inject({"fault": "stuck", "side": "right", "joint": joint}, pair.now_ns)
    if is_held:
        pair.robot.inject({"fault": "blocked", "side": "right"}, pair.now_ns)
    begin_motion(pair, mode)
    pair.run_until(lambda: pair.state == "HOLDING", 4.0)
    pair.run_until(lambda: bool(pair.told(Code.WALK)), 1.0)
    shown, furthest = pair.see(), sent(pair, mode)[-1]
    assert shown.motions[0].code == "TRACKING_ERROR" and list(pair.engine.latches) == [Code.TRACKING_ERROR]
    assert {found.code for found in shown.findings} & {"TRACKING_STALL", "CLIPPED_BY_ROBOT", "IK_REFUSED"}
    if mode == "joint":
        limits = pair.settings.arm
        v, a, j = limits.v_radps, limits.a_radps2, limits.j_radps3
        braking = v * v / (2 * a) + v * a / (2 * j)
        late = v * (limits.tracking_ns + 20 * MS) / S
        assert max(abs(h - s) for h, s in zip(furthest, start, strict=True)) < limits.tracking_rad + late + braking
    fastest_radps = 0.0
    for _ in range(300):
        before = arm.q_rad.copy()
        pair.run(0.02)
        fastest_radps = max(fastest_radps, float(np.max(np.abs(arm.q_rad - before))) / 0.02)
    told_rad = pair.heard[arm_state(R)].value.q_rad
    assert np.allclose(arm.q_rad, told_rad, atol=0.02) and fastest_radps < 0.6
    pair.robot.clear()
    pair.run(1.0)
    assert np.allclose(arm.q_rad, told_rad, atol=0.02) and pair.state == "HOLDING" and pair.engine.latches


# ------------------------------------------------------------------------------- READY after commands (§6.10) or without


@pytest.mark.parametrize("needs", [True, False])
@pytest.mark.parametrize(("mode", "off"), [("joint", None), ("pose", None), ("joint", "left"), ("pose", "left")])
def test_arms_are_enabled_whether_or_not_ready_waits_for_their_commands(
    mode: str, off: str | None, needs: bool
) -> None:
    """The echo of where they are goes on under 1.0; after a pause, too."""
    pair = robot_with(mode, "IDLE", ready_needs_commands=needs, enable_left_arm=off is None)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE", 2.0)
    assert all(pair.robot.arms[side].is_told for side in pair.streaming) and len(set(sent(pair, mode))) == 1
    pair.robot.inject({"fault": "pause"}, pair.now_ns)
    pair.run_until(lambda: pair.state == "PAUSED", 0.2)
    pair.run(0.5)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE", 2.0)
    begin_motion(pair, mode)


@pytest.mark.parametrize("needs", [True, False])
def test_commands_that_are_lost_on_their_way_keep_such_a_robot_from_ready(needs: bool) -> None:
    """Then the enabling ends after 10 s with 0.0 and the reason; without that reading the next motion finds it."""
    pair = robot_with("joint", "IDLE", ready_needs_commands=needs)
    pair.robot.inject({"fault": "drop", "topic": COMMANDS["joint"]}, pair.now_ns)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == ("IDLE" if needs else "ACTIVE"), 10.2)
    if needs:
        pair.run(0.2)
        assert pair.see().enable.code == "ENABLE_TIMEOUT" and pair.beats[-1] == 0.0 and pair.fsm == 0
        return
    begin_motion(pair, "joint")
    pair.run_until(lambda: pair.state == "HOLDING", 4.0)
    assert list(pair.engine.latches) == [Code.TRACKING_ERROR]


# ------------------------------------------------------------------------- silence in end-effector mode (§4.2, §4.3, §4.10)

SILENCES = pytest.mark.parametrize("silence", POSE_SILENCE)
FAST = PoseSettings(v_mps=0.5, a_mps2=5.0, j_mps3=100.0, w_radps=1.5, dw_radps2=15.0, ddw_radps3=300.0)
"""The hard bounds: what a robot follows furthest behind."""
LAGGING_S = 0.05
"""A robot that follows so late [s]: 25 mm behind at 0.5 m/s."""


def hand_m(pair: Pair) -> Vector:
    """Where the right hand really is [m], in its shoulder's frame."""
    return arm_geometry(R).forward(pair.robot.arms[R].q_rad.tolist()).position_m


def goal_of(pair: Pair) -> Vector:
    """The last pose that was sent, its position [m]."""
    return pair.sent_on(COMMANDS["pose"])[-1][1].values[:3]


def gone_m(pair: Pair, seconds: float, *, is_dead: bool = False) -> float:
    """Let time pass, without whoever commands if it is dead; return the furthest that the right hand was from here [m]."""
    here, furthest, until_ns = hand_m(pair), 0.0, pair.now_ns + round(seconds * S)
    while pair.now_ns < until_ns:
        if is_dead:
            pair.now_ns += 10 * MS
            pair.robot.advance(pair.now_ns, latest_only=True)
        else:
            pair.step()
        furthest = max(furthest, math.dist(here, hand_m(pair)))
    return furthest


def fast_hand(silence: str) -> Scene:
    """Return a scene in which the right hand is under way at 0.5 m/s."""
    sim = {"pose_silence": silence, "lag_s": LAGGING_S}
    pair = robot_with("pose", pose=FAST, **sim)
    begin_motion(pair, "pose")
    pair.run(0.25)
    return pair


@SILENCES
@pytest.mark.parametrize("loss", ["both dead", "not heard", "transport"])
def test_in_silence_a_hand_goes_no_further_than_to_the_setpoint_that_it_is_behind(silence: str, loss: str) -> None:
    """A few centimetres at the hard bounds; within the robot's second without 1.0 it is paused."""
    pair = fast_hand(silence)
    is_dead = loss == "both dead"
    if loss == "not heard":
        pair.is_deaf = True
        pair.run_until(lambda: pair.state == "STALE", 0.2)
    elif loss == "transport":
        pair.down()
    behind_m = math.dist(hand_m(pair), goal_of(pair))
    assert 0.02 < behind_m < pair.settings.pose.tracking_m, "the hand is not at full speed: the test proves nothing"
    sent_before = len(pair.sent_on(COMMANDS["pose"]))
    assert gone_m(pair, 2.5, is_dead=is_dead) < behind_m + 0.003
    assert len(pair.sent_on(COMMANDS["pose"])) == sent_before and pair.robot.fsm.published == 0
    left_m = math.dist(hand_m(pair), goal_of(pair))
    assert left_m < 0.002 if silence == "pursues" else left_m < behind_m


@SILENCES
@pytest.mark.parametrize("end", ["client", "stop", "late"])
def test_while_the_gateway_lives_a_hand_is_braked_and_held_by_poses(silence: str, end: str) -> None:
    """A killed client, a stop, a tick that was too late: there is no silence that anything could be left to."""
    pair = fast_hand(silence)
    if end == "client":
        pair.kill("ann")
    elif end == "stop":
        pair.granted(Stop(), "ann")
    else:
        pair.late_ns = 300 * MS
        pair.step(pair.now_ns + 300 * MS)
        pair.run(0.2)
        said = "150 ms ends the robot's patience (manual §4.3, of joint commands)"
        assert any(COMMANDS["pose"] in text and said in text for text in pair.told(Code.STREAM_LATE))
    pair.run_until(lambda: pair.state == "HOLDING", 0.5)
    pair.run(1.0)
    held = goal_of(pair)
    assert gone_m(pair, 2.0) < 1e-3 and goal_of(pair) == held and math.dist(hand_m(pair), held) < 0.005


@SILENCES
def test_a_guard_brakes_and_holds_the_hand_of_a_dead_daemon_and_its_silence_moves_nothing(silence: str) -> None:
    """Within the braking way, one smooth motion; after 10 s 0.0, and then nothing is pursued."""
    sim = SimSettings(state_period_ns=10 * MS, right_mode="pose", pose_silence=silence, lag_s=LAGGING_S)
    pair = Guarded(Settings(pose=FAST), sim)
    pair.topics = STATE_TOPICS
    epoch = pair.activate()
    x, y, z, *quat_xyzw = pair.sent_on(COMMANDS["pose"])[-1][1].values
    goal, frames = (x + 0.14, y, z + 0.14, *quat_xyzw), {R: shoulder_frame(R)}
    pair.granted(MovePose(epoch=epoch, targets={R: goal}, frames=frames))
    pair.run(0.25)
    behind_m = math.dist(hand_m(pair), goal_of(pair))
    pair.die()
    braking_m = 0.5 * FAST.v_mps**2 / FAST.a_mps2 + 0.5 * FAST.v_mps * FAST.a_mps2 / FAST.j_mps3
    assert gone_m(pair, 9.0) < behind_m + braking_m + FAST.v_mps * 0.02 and pair.state == "HOLDING"
    pair.run_until(lambda: pair.guardian.phase is Phase.DONE, 5.0)
    assert gone_m(pair, 2.0) < 1e-3 and pair.robot.fsm.published == 0


@SILENCES
def test_an_arm_that_was_moved_in_the_silence_is_enabled_where_it_is(silence: str) -> None:
    """Poses come before the first 1.0: no pose of before is gone back to."""
    pair = robot_with("pose", pose_silence=silence)
    pair.granted(Disable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "IDLE", 3.0)
    pair.push(R, 0.3)
    pair.robot.clear()
    pair.run(0.5)
    here = hand_m(pair)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    assert gone_m(pair, 2.0) < 0.005 and pair.state == "ACTIVE"
    assert math.dist(here, hand_m(pair)) < 0.005


# ------------------------------------------------------------------ where a gripper is closed (§4.4.2, §4.8), and its PAUSE


@pytest.mark.parametrize("survives", [True, False])
@pytest.mark.parametrize("zero_rad", [0.0, 0.13, -0.4])
def test_whether_a_gripper_holds_something_is_told_by_where_it_is_closed_and_not_in_a_pause(
    zero_rad: float, survives: bool
) -> None:
    """Of one that met something, and one that closed, with their angles told from another zero; PAUSE may take the torque."""
    sim = SimSettings(
        state_period_ns=10 * MS, gripper_zero_rad=zero_rad, grip_survives_pause=survives, right_object_rad=0.06
    )
    closed = ModelSettings(left_gripper_closed_rad=zero_rad, right_gripper_closed_rad=zero_rad)
    pair = Pair(Settings(local=LocalSettings(snapshot_hz=50), model=closed), sim)
    epoch = pair.activate()
    for side in Side:
        pair.granted(SetGripper(epoch=epoch, side=side, raw=0.8))
    pair.run(1.5)
    assert {side: grip.holding for side, grip in pair.see().grips.items()} == {"left": False, "right": True}
    pair.robot.inject({"fault": "pause"}, pair.now_ns)
    pair.run(1.0)
    assert pair.state == "PAUSED" and {grip.holding for grip in pair.see().grips.values()} == {None}
    pair.granted(Enable(epoch=epoch))
    pair.run(1.5)
    assert {side: grip.holding for side, grip in pair.see().grips.items()} == {"left": False, "right": True}
