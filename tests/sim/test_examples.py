"""The message sequences of the manual's examples 6.1 to 6.7 have the effects that the manual expects."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gateway.sim.remote import SimControl
from gateway.sim.robot import report
from gateway.sim.robot.geometry import arm_geometry
from gateway.sim.robot.manual import EXAMPLE_HOME_RAD, MS, Fsm, S, Side
from gateway.sim.robot.model import SimRobot
from gateway.sim.robot.settings import HANGING_RAD, PHYSICS, SimSettings
from tests.sim import drivers
from tests.sim.physics.mujoco_needed import REASON
from tests.sim.wire import User, sim_process, until
from tests.thoroughness import IS_THOROUGH

POSE_ROBOT, JOINT_ROBOT = "tcp/127.0.0.1:19120", "tcp/127.0.0.1:19121"


def play(
    node: drivers.Node,
    settings: SimSettings,
    limit_s: float,
    *,
    ends: bool = True,
    watch: Callable[[SimRobot], None] = lambda robot: None,
) -> SimRobot:
    """Run an example in virtual time, a millisecond a step, until it is done or the time is up."""
    robot = SimRobot(settings)
    while not node.is_done and robot.now_ns < limit_s * S:
        now_ns = robot.now_ns + MS
        for topic, message in node.tick(now_ns):
            robot.receive(topic, message, now_ns)
        for topic, message in robot.advance(now_ns):
            for answer_topic, answer in node.take(topic, message):
                robot.receive(answer_topic, answer, now_ns)
        watch(robot)
    for topic, message in node.last_words() if ends else ():
        robot.receive(topic, message, robot.now_ns)
    return robot


@pytest.mark.parametrize("right", [True, False])
def test_6_1_reaches_its_pose_and_pauses(right):
    """The left hand is within 5 mm when the example looks; it then disables, and the FSM pauses."""
    node = drivers.MoveToPose()
    robot = play(node, SimSettings(left_mode="pose", enable_right_arm=right), 10.0)
    assert node.is_done
    assert node.error_m < 0.005
    assert robot.fsm.state is Fsm.PAUSE
    assert "IK_INVALID" not in robot.journal.codes()


@pytest.mark.parametrize("seed", range(3))
def test_6_1_has_arrived_when_its_stream_is_interrupted(seed):
    """It stops publishing after the last point; 0.15 s later the arm stands, and that must be within 5 mm."""
    node = drivers.MoveToPose(looks=False)
    robot = play(node, SimSettings(left_mode="pose", seed=seed), 3.0, ends=False)
    assert node.has_sent_all
    assert robot.arms[Side.LEFT].stream_losses == 1
    hand = arm_geometry(Side.LEFT).forward(robot.arms[Side.LEFT].q_rad)
    assert np.linalg.norm(np.subtract(hand.position_m, drivers.TARGET_61_M)) < 0.004


def test_6_2_keeps_both_streams_and_opens_both_grippers():
    """0.04 is an opening torque; the arms' streams carry it."""
    robot = play(drivers.GripInJointMode(), SimSettings(), 2.0, ends=False)
    assert robot.fsm.state is Fsm.READY
    for side in Side:
        assert robot.grippers[side].effort_nm == pytest.approx(1.2)
        assert robot.grippers[side].angle_rad == 1.0
        assert robot.arms[side].stream_losses == 0


def strayed_by_echo_rad(settings: SimSettings, rate_hz: int, limit_s: float) -> float:
    """Return how far a joint of either arm got from where it hung while §6.2 echoed what was measured [rad]."""
    strayed_rad = 0.0

    def watch(robot: SimRobot) -> None:
        nonlocal strayed_rad
        for side, arm in robot.arms.items():
            strayed_rad = max(strayed_rad, float(np.max(np.abs(arm.q_rad - HANGING_RAD[side]))))

    robot = play(drivers.GripInJointMode(S // rate_hz), settings, limit_s, ends=False, watch=watch)
    assert robot.fsm.state is Fsm.READY and all(arm.stream_losses == 0 for arm in robot.arms.values())
    return strayed_rad


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [20, 50])
@pytest.mark.parametrize("physics", PHYSICS)
def test_6_2_holds_both_arms_for_a_minute(physics, rate_hz):
    """Its echo of measured joints is how the manual holds an arm: within 0.05 rad, with noise, on both bodies."""
    if physics == "mujoco":
        pytest.importorskip("mujoco", reason=REASON)
    assert strayed_by_echo_rad(SimSettings(physics=physics), rate_hz, 60.0) < 0.05


def test_an_echo_lets_compliant_arms_sink():
    """Each echo lets them down by what the servos give under gravity once more: 0.3 rad in 5 s by 3 mrad."""
    assert strayed_by_echo_rad(SimSettings(compliance_radpnm=1e-3), 50, 5.0) > 0.2


def test_6_3_holds_the_latched_pose_and_opens_both_grippers():
    """The pose does not wander; 0.0 opens with full torque."""
    robot = play(drivers.GripInPoseMode(), SimSettings(left_mode="pose", right_mode="pose"), 2.0, ends=False)
    begin = {side: arm_geometry(side).forward(SimRobot().arms[side].q_rad) for side in Side}
    for side in Side:
        hand = arm_geometry(side).forward(robot.arms[side].q_rad)
        assert np.linalg.norm(np.subtract(hand.position_m, begin[side].position_m)) < 0.005
        assert robot.grippers[side].effort_nm == 2.0
        assert robot.arms[side].stream_losses == 0


def test_6_4_approaches_slowly_and_keeps_its_configuration():
    """The fixed far target is reached through SLOW_START and held."""
    node = drivers.FixedTargets()
    robot = play(node, SimSettings(), 5.0, ends=False)
    assert robot.fsm.state is Fsm.READY
    for side in Side:
        assert robot.arms[side].q_rad == pytest.approx(drivers.TARGET_64[side], abs=0.01)
    peak = max(report.stats(robot)["arms"]["left"]["moved"]["peak_radps"])
    assert peak < 0.6


def test_6_5_drives_ahead_for_two_seconds_and_stops():
    """About 0.1 m ahead, nothing sideways, standing in the end, without any heartbeat."""
    node = drivers.DriveChassis()
    robot = play(node, SimSettings(), 5.0)
    robot.advance(robot.now_ns + S)
    assert node.is_done
    assert robot.fsm.state is Fsm.PAUSE
    assert robot.chassis.velocity == [0.0, 0.0, 0.0]
    assert robot.chassis.travel == pytest.approx([0.093, 0.0, 0.0], abs=0.002)


def test_6_6_converges_in_time_and_disables():
    """Both arms at the initial position half a second after the five seconds, then PAUSE."""
    node = drivers.InitialPosition()
    robot = play(node, SimSettings(), 20.0)
    assert node.is_done
    assert 5.4 < robot.now_ns / S < 5.8
    assert robot.fsm.state is Fsm.PAUSE
    for side in Side:
        assert robot.arms[side].q_rad == pytest.approx(EXAMPLE_HOME_RAD[side], abs=0.02)
        assert robot.arms[side].stream_losses == 0
    assert robot.journal.counts["CLIPPED"] == 0


def test_6_7_lifts_pauses_lowers_and_disables():
    """Up, a rest, down again to about where it was, servo off in the end."""
    heights: list[float] = []
    robot = play(
        drivers.LiftDemo(), SimSettings(model="lift"), 6.0, watch=lambda robot: heights.append(robot.lift.lowered_m)
    )
    robot.advance(robot.now_ns + S)
    assert min(heights) == pytest.approx(0.30 - 0.3 * 0.5 * 1.5, abs=0.03)
    assert robot.lift.lowered_m == pytest.approx(0.30, abs=0.03)
    assert not robot.lift.is_powered


@pytest.mark.thorough
@pytest.mark.e2e
def test_examples_in_pose_mode_over_the_wire():
    """6.1 and 6.3 over loopback zenoh against the node as a process."""
    with sim_process(POSE_ROBOT, "--mode", "pose"), SimControl(POSE_ROBOT) as control:
        user = User(POSE_ROBOT)
        try:
            move = drivers.MoveToPose()
            user.play(move, 15.0)
            assert move.is_done
            until(lambda: control.ask("state")["fsm"] == 0)
            user.play(drivers.GripInPoseMode(), 2.0)
            state = control.ask("state")
            assert all(gripper["angle_rad"] == 1.0 for gripper in state["grippers"].values())
            assert control.ask("stats")["counts"].get("IK_INVALID") is None
        finally:
            user.close()


@pytest.mark.thorough
@pytest.mark.e2e
def test_examples_in_joint_mode_over_the_wire():
    """6.6, 6.2, 6.5 and in CI also 6.4 and 6.7, over loopback zenoh against the node as a process."""
    with sim_process(JOINT_ROBOT, "--mode", "joint", "--model", "lift"), SimControl(JOINT_ROBOT) as control:
        user = User(JOINT_ROBOT)
        try:
            home = drivers.InitialPosition()
            user.play(home, 15.0)
            assert home.is_done
            until(lambda: control.ask("state")["fsm"] == 0)
            if IS_THOROUGH:
                user.play(drivers.FixedTargets(), 5.0)
                arms = control.ask("state")["arms"]
                for side in Side:
                    assert arms[side.value]["q_rad"] == pytest.approx(drivers.TARGET_64[side], abs=0.02)
            held = [arm["q_rad"] for arm in control.ask("state")["arms"].values()]
            user.play(drivers.GripInJointMode(), 1.5)
            now = [arm["q_rad"] for arm in control.ask("state")["arms"].values()]
            assert np.max(np.abs(np.subtract(now, held))) < 0.05
            assert all(g["angle_rad"] == 1.0 for g in control.ask("state")["grippers"].values())
            user.play(drivers.DriveChassis(), 5.0)
            until(lambda: control.ask("state")["chassis"]["velocity"] == [0.0, 0.0, 0.0])
            assert control.ask("state")["chassis"]["travel"][0] == pytest.approx(0.093, abs=0.02)
            if IS_THOROUGH:
                user.play(drivers.LiftDemo(), 6.0)
                until(lambda: control.ask("state")["lift"]["is_powered"] is False)
                assert control.ask("state")["lift"]["lowered_m"] == pytest.approx(0.30, abs=0.05)
        finally:
            user.close()
