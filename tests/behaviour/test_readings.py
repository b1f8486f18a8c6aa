"""BEHAVIOUR, Where the manual can be read in two ways: what the gateway promises holds under both."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.errors import Code
from gateway.messages.requests import Enable, Move, MovePose
from gateway.robot.topics import STATE_TOPICS, joint_command, pose_command, shoulder_frame
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side, Vector
from tests.behaviour.scene import HOME, Scene, scene
from tests.pair import MS, S

R = Side.RIGHT
COMMANDS = {"joint": joint_command(R), "pose": pose_command(R)}


def robot_with(mode: str, state: str = "at rest", **choices: object) -> Scene:
    """Return a scene whose right arm is in a control mode, with further choices about the robot."""
    sim = SimSettings(state_period_ns=10 * MS, right_mode=mode, **choices)  # type: ignore[arg-type]  # names of settings
    pair = Scene(sim, snapshot_hz=50)
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
def test_joints_that_are_told_to_stand_still_end_the_motion_wherever_they_are(mode: str, is_held: bool) -> None:
    """Fresh stamps over old values: tracking error, brake, then one setpoint; free again, the arm ends there and no further."""
    pair = robot_with(mode)
    arm, start = pair.robot.arms[R], sent(pair, mode)[-1]
    for joint in (4, 5, 6, 7) if mode == "joint" else range(1, 8):
        pair.robot.inject({"fault": "stuck", "side": "right", "joint": joint}, pair.now_ns)
    if is_held:
        pair.robot.inject({"fault": "blocked", "side": "right"}, pair.now_ns)
    begin_motion(pair, mode)
    pair.run_until(lambda: pair.state == "HOLDING", 4.0)
    pair.run(1.0)
    shown, held = pair.see(), sent(pair, mode)[-1]
    assert shown.motions[0].code == "TRACKING_ERROR" and list(pair.engine.latches) == [Code.TRACKING_ERROR]
    assert {found.code for found in shown.findings} & {"TRACKING_STALL", "CLIPPED_BY_ROBOT", "IK_REFUSED"}
    if mode == "joint":
        limits = pair.settings.arm
        v, a, j = limits.v_radps, limits.a_radps2, limits.j_radps3
        braking = v * v / (2 * a) + v * a / (2 * j)
        late = v * (limits.tracking_ns + 20 * MS) / S
        assert max(abs(h - s) for h, s in zip(held, start, strict=True)) < limits.tracking_rad + late + braking
    pair.mark()
    pair.robot.clear()
    off_rad = np.abs(arm.q_rad - arm.target_rad)
    for _ in range(100):
        pair.run(0.02)
        assert np.all(np.abs(arm.q_rad - arm.target_rad) <= off_rad + 0.01), "it went beyond what is held"
    assert np.max(np.abs(arm.q_rad - arm.target_rad)) < 0.01 and pair.state == "HOLDING"
    assert set(sent(pair, mode, pair.mark_ns)) == {held} and pair.engine.latches


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
