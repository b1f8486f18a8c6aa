"""Rules that join the robot's parts: heartbeat, readiness, MUX, modes, watchdogs and faults, in virtual time."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cdr_types.messages import geometry_msgs, std_msgs
from gateway.sim.robot import report
from gateway.sim.robot.faults import FaultError
from gateway.sim.robot.geometry import arm_geometry
from gateway.sim.robot.manual import LOWER_RAD, MS, STATE_TOPICS, UPPER_RAD, Fsm, S, Side
from gateway.sim.robot.model import SimRobot
from gateway.sim.robot.settings import HANGING_RAD, SimSettings
from tests.sim.drivers import as_pose, joints

LEFT_CMD, RIGHT_CMD = "/api/left_arm/joint_cmd", "/api/right_arm/joint_cmd"
ENABLE = "/api/fsm/enable"
START = {side: np.array(HANGING_RAD[side]) for side in Side}


def enable(value: float = 1.0) -> std_msgs.Float32:
    """A heartbeat."""
    return std_msgs.Float32(data=value)


def array(*values: float) -> std_msgs.Float32MultiArray:
    """A chassis or lift command."""
    return std_msgs.Float32MultiArray(data=list(values))


class User:
    """Sends at fixed rates and steps the robot by 10 ms."""

    def __init__(self, robot: SimRobot) -> None:
        self.robot = robot
        self.targets = {side: START[side].copy() for side in Side}

    def live(self, duration_s: float, *, heartbeat: bool = True, arms=tuple(Side), also=()) -> None:
        """Live for a time: heartbeat at 20 Hz, arm targets at 100 Hz, other messages at 20 Hz."""
        begin_ns = self.robot.now_ns
        for step in range(round(duration_s * 100)):
            now_ns = begin_ns + step * 10 * MS
            if step % 5 == 0:
                if heartbeat:
                    self.robot.receive(ENABLE, enable(), now_ns)
                for topic, message in also:
                    self.robot.receive(topic, message, now_ns)
            for side in arms:
                self.robot.receive(f"/api/{side.value}_arm/joint_cmd", joints(self.targets[side]), now_ns)
            self.robot.advance(now_ns + 10 * MS, latest_only=True)

    def ready(self) -> None:
        """Get to READY."""
        self.live(0.4)
        assert self.robot.fsm.state is Fsm.READY


def test_heartbeat_alone_reaches_ready():
    """With no target yet the target is the pose at enabling, so 1.0 at 20 Hz is enough (§4.7)."""
    user = User(SimRobot())
    user.live(0.15, arms=())
    assert user.robot.fsm.state is Fsm.SLOW_START
    user.live(0.1, arms=())
    assert user.robot.fsm.state is Fsm.READY
    assert np.array_equal(user.robot.arms[Side.LEFT].q_rad, START[Side.LEFT])


def test_a_far_target_is_approached_slowly_and_delays_ready():
    """With a target 0.5 rad away SLOW_START lasts about a second, and the arm never exceeds 0.5 rad/s."""
    user = User(SimRobot())
    user.targets[Side.LEFT][0] += 0.5
    fastest, lasted_s = 0.0, 0.0
    while user.robot.fsm.state is not Fsm.READY and lasted_s < 5.0:
        user.live(0.05)
        lasted_s += 0.05
        fastest = max(fastest, float(np.max(np.abs(user.robot.arms[Side.LEFT].v_radps))))
    assert 0.9 < lasted_s < 1.4
    assert fastest < 0.5 + 0.08


def test_only_enabled_arms_count_for_ready():
    """The commands of a disabled arm are not taken and its place is not waited for."""
    robot = SimRobot(SimSettings(enable_right_arm=False))
    user = User(robot)
    user.targets[Side.RIGHT][0] -= 1.0
    user.live(0.4)
    assert robot.fsm.state is Fsm.READY
    assert np.array_equal(robot.arms[Side.RIGHT].q_rad, START[Side.RIGHT])
    assert "ARM_DISABLED" in robot.journal.codes()


def test_arms_follow_only_when_ready_or_starting():
    """Before the first 1.0 targets move nothing (§4.7)."""
    user = User(SimRobot())
    user.targets[Side.LEFT][0] += 0.3
    user.live(1.0, heartbeat=False)
    assert np.array_equal(user.robot.arms[Side.LEFT].q_rad, START[Side.LEFT])


def test_zero_stops_following_at_once():
    """0.0 pauses: from the same instant the arm only brakes (§1.4, §4.7)."""
    user = User(SimRobot())
    user.ready()
    user.targets[Side.LEFT][0] += 0.3
    user.live(0.05)
    user.robot.receive(ENABLE, enable(0.0), user.robot.now_ns)
    user.live(1.0, heartbeat=False)
    assert user.robot.fsm.state is Fsm.PAUSE
    moved = user.robot.arms[Side.LEFT].q_rad - START[Side.LEFT]
    assert 0.05 < moved[0] < 0.29


def test_a_lost_heartbeat_pauses_after_one_second():
    """1 s after the last 1.0 the robot still follows; right after it pauses (§4.7)."""
    user = User(SimRobot())
    user.ready()
    user.robot.receive(ENABLE, enable(), user.robot.now_ns)
    user.live(1.0, heartbeat=False)
    assert user.robot.fsm.state is Fsm.READY
    user.live(0.01, heartbeat=False)
    assert user.robot.fsm.state is Fsm.PAUSE
    assert "HEARTBEAT_LOST" in user.robot.journal.codes()


def test_an_arm_stream_gap_stops_that_arm_only():
    """More than 0.15 s without a command: zero velocity for this arm; FSM and the other arm go on (§4.10)."""
    user = User(SimRobot())
    user.ready()
    user.live(0.17, arms=(Side.RIGHT,))
    arms = user.robot.arms
    assert (arms[Side.LEFT].is_streamed, arms[Side.RIGHT].is_streamed) == (False, True)
    assert (arms[Side.LEFT].stream_losses, arms[Side.RIGHT].stream_losses) == (1, 0)
    assert user.robot.fsm.state is Fsm.READY


def test_commands_every_150_ms_keep_the_stream():
    """The bound itself is no gap."""
    user = User(SimRobot())
    user.ready()
    for _ in range(10):
        user.robot.receive(ENABLE, enable(), user.robot.now_ns)
        user.robot.receive(LEFT_CMD, joints(START[Side.LEFT]), user.robot.now_ns)
        user.robot.advance(user.robot.now_ns + 150 * MS)
        assert user.robot.arms[Side.LEFT].is_streamed


def test_limits_are_clipped_and_only_the_journal_tells():
    """A target beyond §4.13 is followed up to the limit."""
    user = User(SimRobot(SimSettings()))
    user.ready()
    user.targets[Side.LEFT] = np.array(UPPER_RAD[Side.LEFT]) + 0.4
    user.targets[Side.RIGHT] = np.array(LOWER_RAD[Side.RIGHT]) - 0.4
    user.live(1.0)
    assert user.robot.arms[Side.LEFT].q_rad == pytest.approx(UPPER_RAD[Side.LEFT], abs=1e-6)
    assert user.robot.arms[Side.RIGHT].q_rad == pytest.approx(LOWER_RAD[Side.RIGHT], abs=1e-6)
    assert user.robot.journal.counts["CLIPPED"] == 200


def test_names_are_ignored():
    """The array order decides, whatever the names say (§4.0.3, §4.10)."""
    user = User(SimRobot(SimSettings()))
    user.ready()
    target = START[Side.LEFT] + np.array([0.1, 0, 0, 0, 0, 0, -0.1])
    names = [f"l_joint{n}" for n in range(7, 0, -1)]
    for _ in range(60):
        now_ns = user.robot.now_ns
        user.robot.receive(LEFT_CMD, joints(target, names), now_ns)
        user.live(0.01, arms=(Side.RIGHT,))
    assert user.robot.arms[Side.LEFT].q_rad == pytest.approx(target, abs=1e-4)


@pytest.mark.parametrize("message", [joints([0.0] * 6), joints([]), joints([math.nan] * 7)])
def test_refused_targets_do_not_keep_the_stream_alive(message):
    """Too few values or NaN: the message does not count (§4.10)."""
    user = User(SimRobot())
    user.ready()
    user.live(0.2, arms=(Side.RIGHT,), also=((LEFT_CMD, message),))
    assert not user.robot.arms[Side.LEFT].is_streamed


@pytest.mark.parametrize(("mode", "topic"), [("pose", "joint_cmd"), ("joint", "target_pose")])
def test_an_arm_takes_only_the_commands_of_its_mode(mode, topic):
    """A pose moves no arm in joint mode, joints move none in pose mode (§4.1)."""
    robot = SimRobot(SimSettings(left_mode=mode))
    pose = arm_geometry(Side.LEFT).forward(START[Side.LEFT])
    message = joints(START[Side.LEFT]) if topic == "joint_cmd" else as_pose(pose.position_m, pose.quat_xyzw)
    robot.receive(f"/api/left_arm/{topic}", message, 0)
    assert "WRONG_MODE" in robot.journal.codes()
    assert not robot.arms[Side.LEFT].is_streamed


def test_pose_mode_moves_the_hand_to_the_pose():
    """In pose mode the robot's own IK turns targets into motion (§4.2)."""
    robot = SimRobot(SimSettings(left_mode="pose"))
    user = User(robot)
    user.live(0.4, arms=(Side.RIGHT,))
    pose = arm_geometry(Side.LEFT).forward(START[Side.LEFT])
    x, y, z = pose.position_m
    target = ("/api/left_arm/target_pose", as_pose((x, y, z + 0.02), pose.quat_xyzw))
    user.live(1.0, arms=(Side.RIGHT,), also=(target,))
    reached = arm_geometry(Side.LEFT).forward(robot.arms[Side.LEFT].q_rad)
    assert reached.position_m == pytest.approx((x, y, z + 0.02), abs=1e-4)


def test_an_invalid_pose_protects_the_arm():
    """An unreachable pose is not passed on; the arm stands (§4.10)."""
    robot = SimRobot(SimSettings(left_mode="pose"))
    user = User(robot)
    user.live(0.4, arms=(Side.RIGHT,))
    far = ("/api/left_arm/target_pose", geometry_msgs.Pose(position=geometry_msgs.Point(x=3.0)))
    user.live(0.5, arms=(Side.RIGHT,), also=(far,))
    assert np.array_equal(robot.arms[Side.LEFT].q_rad, START[Side.LEFT])
    assert robot.journal.counts["IK_INVALID"] == robot.arms[Side.LEFT].unsolved == 10


def test_an_invalid_pose_keeps_no_grip():
    """It is not passed on (§4.10), and the gripper needs what is (§4.4): 100 ms later the torque is cancelled."""
    robot = SimRobot(SimSettings(left_mode="pose"))
    user = User(robot)
    pose = arm_geometry(Side.LEFT).forward(START[Side.LEFT])
    near = ("/api/left_arm/target_pose", as_pose(pose.position_m, pose.quat_xyzw))
    far = ("/api/left_arm/target_pose", geometry_msgs.Pose(position=geometry_msgs.Point(x=3.0)))
    user.live(0.5, arms=(Side.RIGHT,), also=(near, ("/api/left_gripper/cmd", enable(0.5))))
    assert robot.grippers[Side.LEFT].is_engaged
    user.live(0.2, arms=(Side.RIGHT,), also=(far,))
    assert not robot.grippers[Side.LEFT].is_engaged and robot.grippers[Side.RIGHT].is_engaged


def test_vr_mode_takes_no_api_commands_but_the_enable():
    """The MUX blocks arms, grippers and chassis; `/api/fsm/enable` reaches the FSM (§3.1.1)."""
    robot = SimRobot(SimSettings(api_mode=False))
    user = User(robot)
    user.targets[Side.LEFT][0] += 0.3
    also = (("/api/chassis/velocity", array(0.1, 0.0, 0.0)), ("/api/left_gripper/cmd", enable(1.0)))
    user.live(0.5, also=also)
    assert robot.fsm.state is Fsm.READY
    assert np.array_equal(robot.arms[Side.LEFT].q_rad, START[Side.LEFT])
    assert robot.chassis.travel == [0.0, 0.0, 0.0]
    assert robot.grippers[Side.LEFT].level_01 is None
    robot.receive(ENABLE, enable(0.0), robot.now_ns)
    assert robot.fsm.state is Fsm.PAUSE


def test_gripper_force_follows_the_arms_stream_not_its_own():
    """One command is enough while the arm's stream lives; 100 ms after that stream the torque is gone (§4.4)."""
    user = User(SimRobot())
    user.ready()
    user.robot.receive("/api/left_gripper/cmd", enable(0.8), user.robot.now_ns)
    user.live(1.0)
    gripper = user.robot.grippers[Side.LEFT]
    assert gripper.effort_nm < -1.0
    user.live(0.1, arms=(Side.RIGHT,))
    assert gripper.effort_nm == 0.0


def test_chassis_and_lift_need_no_heartbeat():
    """They move in PAUSE (§4.5, §4.6)."""
    robot = SimRobot(SimSettings(model="lift"))
    also = (("/api/chassis/velocity", array(0.1, 0.0, 0.0)), ("/api/servo/cmd", array(0.2, 1.0)))
    User(robot).live(1.0, heartbeat=False, arms=(), also=also)
    assert robot.fsm.state is Fsm.PAUSE
    assert robot.chassis.travel[0] > 0.05
    assert robot.lift is not None
    assert robot.lift.lowered_m < 0.30


def test_chassis_stops_by_itself_after_a_second_of_silence():
    """The last target stays for a second, then it brakes at 0.6 (§4.5)."""
    robot = SimRobot()
    User(robot).live(1.0, arms=(), also=(("/api/chassis/velocity", array(0.1, 0.0, 0.0)),))
    robot.advance(robot.now_ns + 900 * MS)
    assert robot.chassis.velocity[0] == pytest.approx(0.1)
    robot.advance(robot.now_ns + 500 * MS)
    assert robot.chassis.velocity == [0.0, 0.0, 0.0]


def test_a_disabled_chassis_takes_nothing():
    """Without the switch in the configuration nothing moves (§4.1)."""
    robot = SimRobot(SimSettings(enable_chassis=False))
    robot.receive("/api/chassis/velocity", array(0.1, 0.0, 0.0), 0)
    assert "CHASSIS_DISABLED" in robot.journal.codes()
    assert json.loads(report.mode_json(robot))["enable_chassis"] is False


@pytest.mark.parametrize(
    ("part", "begin"),
    [("left_arm", "left_"), ("right_arm", "right_"), ("chassis", "chassis/"), ("lift_servo", "servo/")],
)
def test_a_part_that_is_switched_off_is_not_visible(part, begin):
    """Topics of the other parts are, and of those alone something comes (§2.7.1)."""
    whole = SimRobot(SimSettings(model="lift"))
    robot = SimRobot(SimSettings(model="lift", **{f"enable_{part}": False}))
    gone = {topic for topic in {*whole.states, *whole.commands} if topic.startswith((f"/{begin}", f"/api/{begin}"))}
    assert gone and robot.states.keys() == whole.states.keys() - gone
    assert robot.commands.keys() == whole.commands.keys() - gone
    assert {topic for topic, _ in whole.advance(1 * S, latest_only=True)} == set(STATE_TOPICS)
    assert {topic for topic, _ in robot.advance(1 * S, latest_only=True)} == robot.states.keys()


@pytest.mark.parametrize("model", ["lite", "standard"])
def test_models_without_a_lift_have_no_servo_topic(model):
    """`/api/servo/cmd` exists on the lift model only (§1.2)."""
    robot = SimRobot(SimSettings(model=model))
    assert "/api/servo/cmd" not in robot.commands
    robot.receive("/api/servo/cmd", array(0.3, 1.0), 0)
    assert robot.journal.codes() == {"NOT_A_COMMAND"}


def test_error_stops_arms_and_lift():
    """ERROR: zero velocity for the arms, a controlled stop of the lift; cleared, the robot is paused (§4.6, §4.10)."""
    robot = SimRobot(SimSettings(model="lift"))
    user = User(robot)
    user.ready()
    user.live(0.5, also=(("/api/servo/cmd", array(0.2, 1.0)),))
    robot.inject({"fault": "fsm_error"}, robot.now_ns)
    user.targets[Side.LEFT][0] += 0.3
    before = robot.arms[Side.LEFT].q_rad.copy()
    user.live(0.5, also=(("/api/servo/cmd", array(0.2, 1.0)),))
    assert dict(robot.advance(robot.now_ns + 50 * MS))["/fsm_state"].data == -1
    assert robot.arms[Side.LEFT].q_rad == pytest.approx(before, abs=1e-3)
    assert robot.lift is not None
    assert robot.lift.motor_radps == 0.0
    robot.clear()
    assert robot.fsm.state is Fsm.PAUSE


def test_current_mode_is_compact_json_with_the_fields_of_the_manual():
    """Integers for modes, booleans for switches, nothing else (§4.11.2)."""
    robot = SimRobot(SimSettings(left_mode="pose", enable_right_arm=False, model="lift"))
    text = dict(robot.advance(0))["/api/current_mode"].data
    assert " " not in text
    assert json.loads(text) == {
        "meta_mode": 1,
        "left_arm_control_mode": 0,
        "right_arm_control_mode": 1,
        "enable_left_arm": True,
        "enable_right_arm": False,
        "enable_chassis": True,
        "enable_lift_servo": True,
        "enable_collision_check": True,
    }


def test_a_spontaneous_pause_is_over_with_the_next_one():
    """1.0 starts the robot again, through SLOW_START; with a duration only after it."""
    user = User(SimRobot())
    user.ready()
    user.robot.inject({"fault": "pause"}, user.robot.now_ns)
    assert user.robot.fsm.state is Fsm.PAUSE
    user.live(0.05)
    assert user.robot.fsm.state is Fsm.SLOW_START
    user.robot.inject({"fault": "pause", "duration_s": 0.5}, user.robot.now_ns)
    user.live(0.45)
    assert user.robot.fsm.state is Fsm.PAUSE
    user.live(0.2)
    assert user.robot.fsm.state is Fsm.SLOW_START


def test_mode_faults_change_what_current_mode_says_and_what_is_taken():
    """VR mode, a disabled arm and another control mode, each for its duration."""
    robot = SimRobot()
    user = User(robot)
    user.ready()
    for command in (
        {"fault": "vr_mode", "duration_s": 0.5},
        {"fault": "arm_disabled", "side": "left", "duration_s": 0.5},
        {"fault": "control_mode", "side": "right", "mode": "pose", "duration_s": 0.5},
    ):
        robot.inject(command, robot.now_ns)
    mode = json.loads(report.mode_json(robot))
    assert (mode["meta_mode"], mode["enable_left_arm"], mode["right_arm_control_mode"]) == (0, False, 0)
    user.live(0.3)
    assert not any(arm.is_streamed for arm in robot.arms.values())
    user.live(0.3)
    mode = json.loads(report.mode_json(robot))
    assert (mode["meta_mode"], mode["enable_left_arm"], mode["right_arm_control_mode"]) == (1, True, 1)
    assert all(arm.is_streamed for arm in robot.arms.values())


def test_a_jump_is_measured_but_not_made():
    """The encoder is off, the arm is not; joint numbers count from one."""
    robot = SimRobot()
    robot.inject({"fault": "jump", "side": "left", "joint": 2, "delta_rad": 0.5, "duration_s": 1.0}, 0)
    jumped = dict(robot.advance(0))["/left_arm/joint_states"].position
    assert np.array(jumped) - START[Side.LEFT] == pytest.approx([0, 0.5, 0, 0, 0, 0, 0], abs=2e-3)
    assert robot.arms[Side.LEFT].q_rad.tolist() == list(START[Side.LEFT])
    back = dict(robot.advance(2 * S, latest_only=True))["/left_arm/joint_states"].position
    assert np.array(back) == pytest.approx(START[Side.LEFT], abs=2e-3)


def test_a_blocked_arm_falls_behind_its_target():
    """Commands are accepted and not followed: tracking error."""
    user = User(SimRobot())
    user.ready()
    user.robot.inject({"fault": "blocked", "side": "left"}, user.robot.now_ns)
    user.targets[Side.LEFT][0] += 0.4
    user.live(0.5)
    assert user.robot.arms[Side.LEFT].deviation_rad > 0.35


@pytest.mark.parametrize("needs", [True, False])
def test_ready_waits_for_commands_of_each_enabled_arm_where_that_was_chosen(needs):
    """Those since the slow start began count (§6.10); by default none is needed (§6.1)."""
    user = User(SimRobot(SimSettings(ready_needs_commands=needs)))
    user.ready()
    robot, one = user.robot, std_msgs.Float32(data=1.0)

    def slow_start(*commanded):
        robot.receive("/api/fsm/enable", std_msgs.Float32(data=0.0), robot.now_ns)
        for _ in range(10):
            robot.receive("/api/fsm/enable", one, robot.now_ns)
            for side in commanded:
                target = joints(robot.arms[side].q_rad)
                robot.receive(f"/api/{side.value}_arm/joint_cmd", target, robot.now_ns)
            robot.advance(robot.now_ns + 50 * MS)
        return robot.fsm.state

    assert slow_start() is slow_start(Side.LEFT) is (Fsm.SLOW_START if needs else Fsm.READY)
    assert slow_start(*Side) is Fsm.READY
    robot.inject({"fault": "arm_disabled", "side": "right"}, robot.now_ns)
    assert slow_start(Side.LEFT) is Fsm.READY


@pytest.mark.parametrize("is_blocked", [False, True])
def test_what_is_told_of_a_stuck_joint_stays_under_fresh_stamps(is_blocked):
    """One of two CAN lines is dead (§4.8): position, speed and effort are old, the pose is made of them; the rest is live."""
    user = User(SimRobot())
    user.ready()
    robot, topics = user.robot, ("/left_arm/joint_states", "/left_arm/current_ee_pose")
    robot.inject({"fault": "stuck", "side": "left", "joint": 4}, robot.now_ns)
    if is_blocked:
        robot.inject({"fault": "blocked", "side": "left"}, robot.now_ns)
    user.targets[Side.LEFT][3] += 0.1
    told = []
    for _ in range(20):
        user.live(0.02)
        came = dict(robot.advance(robot.now_ns + 5 * MS))
        told.append([came[topic] for topic in topics])
    first, last = told[0][0], told[-1][0]
    assert first.header.stamp != last.header.stamp
    for name in ("position", "velocity", "effort"):
        differ = [a != b for a, b in zip(getattr(first, name), getattr(last, name), strict=True)]
        assert differ == [True, True, True, False, True, True, True]
    pose = arm_geometry(Side.LEFT).forward(last.position)
    assert (told[-1][1].position.x, told[-1][1].position.y) == pytest.approx(pose.position_m[:2], abs=1e-12)
    off = robot.arms[Side.LEFT].q_rad[3] - last.position[3]
    assert off == pytest.approx(0.0 if is_blocked else 0.1, abs=2e-3)
    robot.clear("stuck")
    seen = dict(robot.advance(robot.now_ns + 5 * MS))[topics[0]].position
    assert seen == pytest.approx(robot.arms[Side.LEFT].q_rad, abs=2e-3)


def test_a_joint_whose_zero_is_off_puts_the_hand_elsewhere():
    """It reports and takes the angles of before; the pose is that of the real ones, and the robot's own IK knows them."""
    robot = SimRobot(SimSettings(noise_rad=0.0, left_mode="pose"), 0)
    before = dict(robot.advance(0))
    robot.inject({"fault": "joint_zero", "side": "left", "joint": 2, "delta_rad": -0.05}, 0)
    after = dict(robot.advance(5 * MS))
    assert after["/left_arm/joint_states"].position == before["/left_arm/joint_states"].position
    q_rad = np.array(after["/left_arm/joint_states"].position)
    real = arm_geometry(Side.LEFT).forward(q_rad + np.array([0, -0.05, 0, 0, 0, 0, 0]))
    pose = after["/left_arm/current_ee_pose"]
    assert (pose.position.x, pose.position.y, pose.position.z) == pytest.approx(real.position_m, abs=1e-12)
    moved = math.dist(real.position_m, arm_geometry(Side.LEFT).forward(q_rad).position_m)
    assert moved > 0.01
    arm = robot.arms[Side.LEFT]
    assert arm.command_pose(real, 5 * MS)
    assert arm.target_rad == pytest.approx(q_rad, abs=2e-3)
    robot.clear("joint_zero")
    assert (
        dict(robot.advance(10 * MS))["/left_arm/current_ee_pose"].position
        == before["/left_arm/current_ee_pose"].position
    )


def test_a_tight_limit_clips_inside_the_manuals():
    """This robot stops short of §4.13 on one joint; the others follow, and nothing is said but in its own log."""
    user = User(SimRobot())
    user.ready()
    user.robot.inject({"fault": "tight_limit", "side": "left", "joint": 2, "margin_rad": 0.4}, user.robot.now_ns)
    user.targets[Side.LEFT][0] += 0.1
    user.targets[Side.LEFT][1] = 1.8
    user.live(0.5)
    arm = user.robot.arms[Side.LEFT]
    assert arm.target_rad[1] == pytest.approx(1.5) and arm.target_rad[0] == pytest.approx(START[Side.LEFT][0] + 0.1)
    assert user.robot.journal.counts["CLIPPED"] and user.robot.clear() == 1
    user.live(0.5)
    assert arm.target_rad[1] == pytest.approx(1.8)


def test_an_arm_without_ik_takes_no_pose():
    """Every pose is an invalid IK result: zero-velocity protection (§4.10), as long as it lasts."""
    robot = SimRobot(SimSettings(left_mode="pose"))
    message = dict(robot.advance(0))["/left_arm/current_ee_pose"]
    robot.inject({"fault": "no_ik", "side": "left", "duration_s": 1.0}, 0)
    robot.receive("/api/left_arm/target_pose", message, 1 * MS)
    assert robot.journal.counts["IK_INVALID"] == 1 and robot.arms[Side.LEFT].accepted == 0
    robot.receive("/api/left_arm/target_pose", message, 2 * S)
    assert robot.arms[Side.LEFT].accepted == 1


def test_a_clock_step_moves_the_stamps_only():
    """One hour ahead: stamps jump, rates stay."""
    robot = SimRobot(epoch_ns=0)
    robot.inject({"fault": "clock_step", "step_s": 3600.0}, 0)
    published = [m for topic, m in robot.advance(1 * S) if topic == "/left_arm/joint_states"]
    assert published[-1].header.stamp.sec == 3601
    assert len(published) == 201


def test_a_clock_drift_adds_to_that_of_the_settings_and_what_it_made_stays():
    """100 ppm of its own and 900 more for ten seconds: 10 ms there, and 1 ms in the ten seconds after it."""
    robot = SimRobot(SimSettings(clock_drift_ppm=100.0, clock_offset_ns=-5 * S), epoch_ns=5 * S)
    robot.inject({"fault": "clock_drift", "drift_ppm": 900.0, "duration_s": 10.0}, 0)
    robot.advance(10 * S, topics=())
    assert robot.clock.stamp_ns(10 * S) == 10 * S + 10 * MS
    robot.advance(20 * S, topics=())
    assert robot.clock.stamp_ns(20 * S) == 20 * S + 11 * MS


def test_a_clock_beyond_2038_stops_nothing():
    """The seconds of a stamp are an int32: they go on from the other end."""
    robot = SimRobot(epoch_ns=0)
    robot.inject({"fault": "clock_step", "step_s": 2.0**31}, 0)
    published = dict(robot.advance(0))["/left_arm/joint_states"]
    assert published.header.stamp.sec == -(2**31)


def test_a_pinned_fsm_value_is_published():
    """Values of VR and playback, and unknown ones, can be shown; arms do not follow then."""
    user = User(SimRobot())
    user.ready()
    user.robot.inject({"fault": "fsm_value", "value": 3}, user.robot.now_ns)
    user.targets[Side.LEFT][0] += 0.3
    before = user.robot.arms[Side.LEFT].q_rad.copy()
    user.live(0.3)
    assert dict(user.robot.advance(user.robot.now_ns + 50 * MS))["/fsm_state"].data == 3
    assert user.robot.arms[Side.LEFT].q_rad == pytest.approx(before, abs=1e-3)


def test_a_delayed_command_acts_late():
    """A command under way is obeyed when it arrives at the robot's node."""
    robot = SimRobot()
    robot.inject({"fault": "delay", "topic": ENABLE, "delay_s": 0.3}, 0)
    robot.receive(ENABLE, enable(), 0)
    robot.advance(299 * MS)
    assert robot.fsm.state is Fsm.PAUSE
    robot.advance(300 * MS)
    assert robot.fsm.state is Fsm.SLOW_START


def test_a_delayed_state_arrives_late_with_its_old_stamp():
    """Every message is shifted, none is lost."""
    robot = SimRobot(epoch_ns=0)
    robot.inject({"fault": "delay", "topic": "/left_arm/joint_states", "delay_s": 0.1}, 0)
    assert not [1 for topic, _ in robot.advance(99 * MS) if topic == "/left_arm/joint_states"]
    late = [m for topic, m in robot.advance(150 * MS) if topic == "/left_arm/joint_states"]
    assert [m.header.stamp.nanosec // MS for m in late] == list(range(0, 55, 5))


def test_node_faults_need_a_node():
    """The pure robot has no process and no bridge."""
    with pytest.raises(FaultError, match="running node"):
        SimRobot().inject({"fault": "router_stop"}, 0)


def test_an_arrival_in_the_past_counts_as_now():
    """A message stamped before the robot's present does not turn time back."""
    robot = SimRobot()
    robot.advance(1 * S)
    robot.receive(ENABLE, enable(), 0)
    assert robot.now_ns == 1 * S
    assert robot.fsm.state is Fsm.SLOW_START


def test_wrong_types_and_unknown_topics_are_journalled():
    """Neither is a command."""
    robot = SimRobot()
    robot.receive("/left_arm/joint_states", joints([0.0] * 7), 0)
    robot.receive(LEFT_CMD, enable(), 0)
    assert robot.journal.counts["NOT_A_COMMAND"] == 2


@settings(max_examples=15)
@given(
    targets=st.lists(st.floats(-0.3, 0.3), min_size=1, max_size=6),
    step_ns=st.integers(3, 40).map(lambda n: n * MS),
    gap_ms=st.integers(5, 400),
    fault=st.sampled_from(["", "pause", "vr_mode", "fsm_error"]),
)
def test_the_robot_does_not_depend_on_how_it_is_stepped(targets, step_ns, gap_ms, fault):
    """The same messages at the same times lead to the same state in steps of any length."""
    ends = []
    for step in (step_ns, 500 * MS):
        robot = SimRobot()
        robot.receive(ENABLE, enable(), 0)
        now_ns = 0
        for number, offset in enumerate(targets):
            at_ns = now_ns + gap_ms * MS
            while now_ns + step < at_ns:
                now_ns += step
                robot.advance(now_ns, latest_only=True)
            now_ns = at_ns
            if fault and number == 1:
                robot.inject({"fault": fault, "duration_s": 0.3}, now_ns)
            robot.receive(ENABLE, enable(), now_ns)
            robot.receive(LEFT_CMD, joints(START[Side.LEFT] + offset), now_ns)
            robot.receive("/api/chassis/velocity", array(offset, 0.0, -offset), now_ns)
        robot.advance(now_ns + 700 * MS)
        ends.append(robot)
    one, other = ends
    assert one.fsm.state is other.fsm.state
    assert one.journal.counts == other.journal.counts
    assert one.arms[Side.LEFT].q_rad == pytest.approx(other.arms[Side.LEFT].q_rad, abs=1e-9)
    assert one.chassis.travel == pytest.approx(other.chassis.travel, abs=1e-9)


def test_a_long_hold_neither_drifts_nor_trips_a_watchdog():
    """After twenty seconds of the same target the arm stands where it stood, and no stream was lost."""
    user = User(SimRobot(SimSettings(state_period_ns=10 * MS, compliance_radpnm=1e-3)))
    user.ready()
    user.live(20.0)
    robot = user.robot
    assert robot.fsm.state is Fsm.READY
    assert robot.arms[Side.LEFT].stream_losses == 0
    assert robot.arms[Side.LEFT].q_rad - START[Side.LEFT] == pytest.approx(robot.settings.sag_rad(Side.LEFT), abs=1e-9)
