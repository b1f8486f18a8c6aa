"""The whole simulated robot on physics, in virtual time: its rules as ever, its motions with forces."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from cdr_types.messages import std_msgs
from gateway.sim.control import Control
from gateway.sim.physics.scene import MARK_M
from gateway.sim.robot import report
from gateway.sim.robot.manual import (
    CHASSIS_CMD,
    EXAMPLE_HOME_RAD,
    FSM_ENABLE,
    MS,
    Fsm,
    S,
    Side,
    arm_state_topic,
    joint_cmd_topic,
)
from gateway.sim.robot.model import SimRobot
from gateway.sim.robot.settings import HANGING_RAD, SimSettings
from tests.sim.drivers import joints
from tests.sim.physics.mujoco_needed import REASON

pytest.importorskip("mujoco", reason=REASON)

from tests.sim.physics.hands_on import Hands

LEFT = Side.LEFT
HOME = {side: np.array(EXAMPLE_HOME_RAD[side]) for side in Side}


# ------------------------------------------------------------------------------------------------------ a whole task


@pytest.mark.slow
def test_a_block_is_picked_from_the_table_and_put_on_the_mark():
    """Drive 0.5 m, lower the lift, grip from above, raise, put down, let go: all by the robot's topics; judged by the world."""
    user = Hands("lift")
    user.wait(1.0)
    assert user.robot.fsm.state is Fsm.READY
    user.levels[LEFT] = 0.0
    user.lift_to(0.10)
    user.move({LEFT: user.above((0.44, 0.22, 0.97), HOME[LEFT])}, 2.5)
    user.drive((0.5, 0.0, 0.0))
    assert user.world.base() == pytest.approx((0.5, 0.0, 0.0), abs=5e-3)
    x_m, y_m, z_m = user.world.place("block").position_m
    user.move({LEFT: user.above((x_m, y_m, z_m + 0.2), user.targets[LEFT])}, 1.5)
    user.lift_to(0.30)
    user.move({LEFT: user.above((x_m, y_m, z_m), user.targets[LEFT])}, 1.0)
    user.levels[LEFT] = 0.7
    user.wait(2.0)
    user.lift_to(0.20)
    assert user.world.place("block").position_m[2] == pytest.approx(z_m + 0.1, abs=0.01)
    user.move({LEFT: user.above((*MARK_M, z_m + 0.1), user.targets[LEFT])}, 2.5)
    user.lift_to(0.30)
    user.levels[LEFT] = 0.0
    user.wait(1.0)
    user.lift_to(0.15)
    assert user.world.place("block").position_m == pytest.approx((*MARK_M, z_m), abs=0.01)
    assert not user.robot.journal.codes() & {"ARM_STREAM_LOST", "GRIPPER_WATCHDOG", "CLIPPED", "PHYSICS_SLOW"}


# ------------------------------------------------------------------------------------------------------------- rules


def test_it_starts_hanging_and_comes_to_ready_by_the_same_rules():
    """PAUSE, SLOW_START, then READY after five settled checks of the 20 Hz cycle (§4.7)."""
    user = Hands()
    assert user.robot.fsm.state is Fsm.PAUSE
    assert user.robot.arms[LEFT].q_rad == pytest.approx(HANGING_RAD[LEFT], abs=1e-9)
    user.tick()
    assert user.robot.fsm.state is Fsm.SLOW_START
    user.wait(0.4)
    assert user.robot.fsm.state is Fsm.READY


def test_a_slow_start_approaches_at_half_a_radian_per_second():
    """Whatever the distance; the reference moves, the arm follows it."""
    user = Hands()
    for side in Side:
        user.targets[side] = HOME[side]
    user.wait(0.5)
    assert user.robot.fsm.state is Fsm.SLOW_START
    for side in Side:
        way = np.abs(user.robot.arms[side].q_rad - HANGING_RAD[side])
        assert way.max() < 0.3
        assert np.abs(user.robot.arms[side].v_radps).max() < 0.8
    user.wait(3.0)
    assert user.robot.fsm.state is Fsm.READY


def test_a_silent_stream_brakes_the_arm_and_holds_no_position():
    """More than 0.15 s without a command: zero velocity (§4.10); a push moves it then, and it stays moved."""
    user = Hands()
    user.wait(1.0)
    target = user.targets.pop(LEFT)
    user.wait(0.3)
    arm = user.robot.arms[LEFT]
    assert user.robot.journal.counts["ARM_STREAM_LOST"] == 1 and not arm.is_streamed
    hand = user.world.model.body("lg_base_link").id
    user.world.data.xfrc_applied[hand, 0] = 15.0
    user.wait(1.0)
    user.world.data.xfrc_applied[hand, 0] = 0.0
    moved = arm.q_rad.copy()
    user.wait(1.0)
    assert np.abs(moved - target).max() > 0.1
    assert arm.q_rad == pytest.approx(moved, abs=0.05)


def test_the_grip_is_lost_100_ms_after_the_arm_s_stream():
    """The torque ends with the stream (§4.4); dry friction and gravity decide about the fingers."""
    user = Hands()
    user.levels[LEFT] = 0.8
    user.wait(1.0)
    assert user.robot.grippers[LEFT].effort_nm < -1.0
    assert user.world.data.actuator("left_gripper").force[0] == pytest.approx(user.robot.grippers[LEFT].effort_nm)
    user.targets.pop(LEFT)
    user.wait(0.2)
    assert user.robot.grippers[LEFT].effort_nm == 0.0
    assert user.world.data.actuator("left_gripper").force[0] == 0.0
    assert user.world.data.actuator("right_gripper").force[0] == 0.0


def test_a_gripper_meets_the_object_of_the_settings():
    """The thing that only the settings know of stops the motor as it does without physics; opening is free."""
    robot = SimRobot(SimSettings(physics="mujoco", left_object_rad=0.3))
    user = Hands(robot=robot)
    user.levels.update({side: 0.8 for side in Side})
    user.wait(3.0)
    assert robot.grippers[LEFT].angle_rad == pytest.approx(0.3, abs=0.01)
    assert robot.grippers[Side.RIGHT].angle_rad == pytest.approx(0.0, abs=0.01)
    assert robot.grippers[LEFT].effort_nm < -1.0
    user.levels[LEFT] = 0.0
    user.wait(2.0)
    assert robot.grippers[LEFT].angle_rad == pytest.approx(1.0, abs=0.01)


def test_wheels_turn_as_the_chassis_is_told_and_carry_the_base():
    """Wheel states are those of the commanded speeds (§4.5); the base is where its wheels took it, watchdog included."""
    user = Hands()
    user.velocity = (0.0, 0.2, 0.0)
    user.wait(2.0)
    user.velocity = None  # silence: the last target stays for a second, then it ramps down
    user.wait(2.5)
    assert user.robot.chassis.velocity == [0.0, 0.0, 0.0]
    travel = user.robot.chassis.travel
    assert travel[1] > 0.5
    assert user.world.base() == pytest.approx(tuple(travel), abs=2e-3)
    assert user.world.wheels()[0] == pytest.approx(user.robot.chassis.wheels()[0], abs=2e-2)


def test_a_spoiled_chassis_still_stops():
    """NaN makes its speeds invalid (§4.5); the base comes to rest all the same."""
    user = Hands()
    user.velocity = (0.2, 0.0, 0.0)
    user.wait(1.0)
    user.velocity = (math.nan, 0.0, 0.0)
    user.wait(1.5)
    rest = user.world.base()
    user.wait(0.5)
    assert user.world.base() == pytest.approx(rest, abs=1e-4)
    assert np.isfinite(user.world.data.qpos).all()


def test_measured_efforts_are_the_motors_torques():
    """What `/left_arm/joint_states` says is what the servo carries: gravity, at rest."""
    user = Hands()
    user.wait(1.0)
    for side in Side:
        user.targets[side] = HOME[side]
    user.wait(3.0)
    (message,) = [
        message
        for topic, message in user.robot.advance(user.robot.now_ns + 5 * MS, latest_only=True)
        if topic == arm_state_topic(LEFT)
    ]
    assert message.effort == pytest.approx(user.robot.arms[LEFT].effort_nm.tolist())
    assert message.position == pytest.approx(user.robot.arms[LEFT].q_rad.tolist())
    assert abs(message.effort[0]) > 1.0


# -------------------------------------------------------------------------------------------------------------- time


def commanded(step_ns: int) -> SimRobot:
    """A robot that was told the same things at the same times, stepped in its own way between them."""
    robot = SimRobot(SimSettings(physics="mujoco", model="lift"), start_ns=7 * S + 123_457)
    begin_ns = robot.now_ns
    for number in range(100):
        at_ns = begin_ns + number * 19_700_003
        while robot.now_ns < at_ns:
            robot.advance(min(robot.now_ns + step_ns, at_ns), latest_only=True)
        robot.receive(FSM_ENABLE, std_msgs.Float32(data=1.0), at_ns)
        robot.receive(joint_cmd_topic(LEFT), joints(HOME[LEFT]), at_ns)
        robot.receive(CHASSIS_CMD, std_msgs.Float32MultiArray(data=[0.1, 0.0, 0.1]), at_ns)
    robot.advance(begin_ns + 2 * S, latest_only=True)
    return robot


def test_the_same_messages_at_the_same_times_give_the_same_world_however_it_is_stepped():
    """Physics has a grid of its own: a step of the robot is none of physics. Sums of ramps differ in their last digits."""
    worlds = [commanded(step_ns).dynamics.world for step_ns in (5 * MS, 1_300_001, 40 * MS)]
    for other in worlds[1:]:
        assert other.steps == worlds[0].steps == 1000
        assert other.data.qpos == pytest.approx(worlds[0].data.qpos, abs=1e-7)


def test_a_machine_that_is_too_slow_loses_time_of_physics_and_says_so():
    """More than 20 ms behind is given up: watchdogs and grids go on by the clock, the factor and the robot's log tell."""
    robot = SimRobot(SimSettings(physics="mujoco"))
    for number in range(1, 51):
        robot.dynamics.shed(number * 40 * MS)  # a cycle takes 40 ms, of which 20 are simulated
        robot.advance(number * 40 * MS, latest_only=True)
    assert robot.now_ns == 2 * S
    told = robot.dynamics.report()
    assert told["real_time_factor"] == pytest.approx(0.5, abs=0.06)
    assert told["time_s"] + told["lost_s"] == pytest.approx(2.0, abs=0.025)
    entry = next(entry for entry in robot.journal.entries if entry.code == "PHYSICS_SLOW")
    assert "real-time factor 0.5" in entry.text


def test_slowness_is_told_at_once_then_twice_a_minute_with_the_worst_and_when_it_is_over():
    """Not every second: whoever runs it on a busy machine reads other lines too."""
    robot = SimRobot(SimSettings(physics="mujoco"))
    now_ms = 0
    for seconds, cycle_ms in ((2, 10), (10, 40), (10, 80), (15, 40), (3, 10)):
        for _ in range(seconds * 1000 // cycle_ms):
            now_ms += cycle_ms
            robot.dynamics.shed(now_ms * MS)  # what is over 20 ms is not simulated
            robot.advance(now_ms * MS, latest_only=True)
    told = [
        (entry.code, entry.text.removeprefix("physics: real-time factor ")[:3])
        for entry in robot.journal.entries
        if entry.code.startswith("PHYSICS")
    ]
    assert told == [("PHYSICS", "1.0"), ("PHYSICS_SLOW", "0.5"), ("PHYSICS_SLOW", "0.2"), ("PHYSICS", "1.0")]


def test_who_keeps_up_loses_nothing():
    """Cycles of 5 ms, and one of 20."""
    robot = SimRobot(SimSettings(physics="mujoco"))
    for at_ns in (*range(5 * MS, 1000 * MS, 5 * MS), 1015 * MS, 1020 * MS, 2030 * MS):
        if at_ns < 2 * S:
            robot.dynamics.shed(at_ns)
        robot.advance(at_ns, latest_only=True)
    told = robot.dynamics.report()
    assert told["lost_s"] == 0.0 and told["real_time_factor"] == pytest.approx(1.0, abs=1e-2)
    assert [entry.code for entry in robot.journal.entries] == ["PHYSICS"]


# --------------------------------------------------------------------------------------------------- what it tells


class NoNode:
    """The node of a control channel that has none."""


def test_the_control_channel_tells_the_world_s_true_state():
    """Base, hands, openings and things in `state`; the factor in `stats`; nothing of it for the kinematic robot."""
    robot = SimRobot(SimSettings(physics="mujoco", model="lift"))
    robot.advance(1500 * MS, latest_only=True)
    answer = json.loads(Control(robot, NoNode()).answer('{"do": "state"}', robot.now_ns))
    told = answer["physics"]
    assert answer["ok"] and told["base"] == pytest.approx({"x_m": 0.0, "y_m": 0.0, "yaw_rad": 0.0}, abs=1e-6)
    assert set(told["things"]) == {"block", "can", "ball"}
    assert told["hands"]["left"]["position_m"][2] == pytest.approx(0.60, abs=0.02)
    assert told["lowered_m"] == pytest.approx(0.30, abs=1e-3)
    assert 0.03 < told["openings_m"]["left"] < 0.05
    assert report.stats(robot)["physics"]["real_time_factor"] == pytest.approx(1.0, abs=1e-2)
    kinematic = SimRobot(SimSettings(model="lift"))
    assert "physics" not in report.state(kinematic) and "physics" not in report.stats(kinematic)


def test_positions_are_handed_out_to_who_draws_the_scene():
    """All of them for the robot with forces; a robot without a scene says how to get one."""
    robot = SimRobot(SimSettings(physics="mujoco"))
    answer = json.loads(Control(robot, NoNode()).answer('{"do": "world"}', robot.now_ns))
    assert answer == {"ok": True, "positions": robot.dynamics.world.data.qpos.tolist()}
    refused = json.loads(Control(SimRobot(), NoNode()).answer('{"do": "world"}', 0))
    assert not refused["ok"] and "--physics mujoco" in refused["error"]


def test_what_a_hand_is_made_to_hold_its_motors_carry():
    """As much as it weighs, at its lever; let go again when the fault ends."""
    user = Hands()
    user.move(HOME, 1.0)
    empty_nm = user.world.arm(LEFT)[2]
    user.robot.inject({"fault": "load", "side": "left", "kg": 0.5}, user.robot.now_ns)
    user.wait(1.0)
    wrist_m, load_m = (user.world.data.body(name).xpos for name in ("armL5_link", "left_load"))
    assert user.world.model.body("right_load").mass == 0.0 and np.linalg.norm(load_m - wrist_m) > 0.3
    heavier_nm = np.abs(user.world.arm(LEFT)[2] - empty_nm)
    assert heavier_nm.max() > 1.0
    user.robot.clear("load")
    user.wait(1.0)
    assert user.world.model.body("left_load").mass == 0.0
    assert user.world.arm(LEFT)[2] == pytest.approx(empty_nm, abs=1.0)


def test_a_robot_that_differs_is_as_far_off_as_was_asked_and_the_same_for_the_same_seed():
    """Masses with their inertias, friction, and noise of the efforts alone; nothing else of the scene."""
    usual, first, again, other = (
        SimRobot(SimSettings(physics="mujoco", differs_percent=percent, seed=seed))
        for percent, seed in ((0.0, 1), (10.0, 1), (10.0, 1), (10.0, 2))
    )
    models = [robot.dynamics.world.model for robot in (usual, first, again, other)]
    joints_of_arms = [models[0].joint(f"arm{side}{number}_joint").id for side in "LR" for number in range(1, 8)]
    links, dofs = models[0].jnt_bodyid[joints_of_arms], models[0].jnt_dofadr[joints_of_arms]
    for name, rows in (("body_mass", links), ("dof_frictionloss", dofs)):
        plain, off, same, else_ = (getattr(model, name) for model in models)
        part = np.abs(off[rows] / plain[rows] - 1.0)
        assert (part >= 0.05 - 1e-12).all() and (part <= 0.1 + 1e-12).all() and (off == same).all()
        assert (off[rows] != else_[rows]).all()
        assert (np.delete(off, rows) == np.delete(plain, rows)).all()
    assert (usual.arms[LEFT].effort_noise_nm == 0.0).all()
    assert first.arms[LEFT].effort_noise_nm == pytest.approx([0.4, 0.4, 0.2, 0.2, 0.06, 0.05, 0.06])
    said = [
        np.array([message.effort for topic, message in robot.advance(2 * S) if topic == arm_state_topic(LEFT)])
        for robot in (first, again)
    ]
    assert (said[0] == said[1]).all()
    noise = np.diff(said[0][200:], axis=0).std(axis=0) / np.sqrt(2.0)
    assert noise == pytest.approx(first.arms[LEFT].effort_noise_nm, rel=0.3)
