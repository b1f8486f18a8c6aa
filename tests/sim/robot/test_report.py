"""Rules of the reports about a simulated robot."""

from __future__ import annotations

import json

import pytest

from cdr_types.messages import builtin_interfaces, geometry_msgs, sensor_msgs, std_msgs
from gateway.sim.robot import report
from gateway.sim.robot.manual import MS, S
from gateway.sim.robot.model import SimRobot
from gateway.sim.robot.settings import SimSettings
from tests.sim.drivers import joints


def used() -> SimRobot:
    """A robot that got a second of joint commands, with one gap of 120 ms."""
    robot = SimRobot(SimSettings(model="lift"))
    for number in range(100):
        now_ns = number * 10 * MS + (110 * MS if number > 50 else 0)
        robot.receive("/api/left_arm/joint_cmd", joints([0.0, 1.0, 0.0, 5.0, 0.0, 0.0, number * 1e-4]), now_ns)
    robot.receive("/api/right_arm/target_pose", geometry_msgs.Pose(), S)
    robot.receive("/api/chassis/velocity", std_msgs.Float32MultiArray(data=[0.5, 0.0, 0.25]), S)
    robot.receive("/api/fsm/enable", std_msgs.Float32(data=1.0), S)
    robot.advance(2 * S)
    return robot


def test_stats_tell_what_the_robot_saw():
    """Count, gaps, last value, clips and refusals, and how hard the arm was driven."""
    stats = report.stats(used())
    commands, left = stats["commands"], stats["arms"]["left"]
    assert commands["/api/left_arm/joint_cmd"]["count"] == 100
    assert commands["/api/left_arm/joint_cmd"]["worst_gap_alive_ms"] == 120.0
    assert commands["/api/left_arm/joint_cmd"]["last"][3] == 5.0
    assert commands["/api/chassis/velocity"]["last"] == [0.5, 0.0, 0.25]
    assert len(commands["/api/right_arm/target_pose"]["last"]) == 7
    assert (left["accepted"], left["clips"]) == (100, 100)
    assert left["commanded"]["peak_radps"][6] == pytest.approx(0.01, rel=0.05)
    assert stats["counts"]["WRONG_MODE"] == 1
    assert "/api/right_arm/joint_cmd" not in commands


def test_reset_starts_the_figures_anew():
    """Afterwards nothing was seen; the journal's counts stay."""
    robot = used()
    robot.reset_stats()
    stats = report.stats(robot)
    assert stats["commands"] == {}
    assert stats["arms"]["left"]["clips"] == 0
    assert max(stats["arms"]["left"]["commanded"]["peak_radps"]) == 0.0
    assert stats["counts"]["CLIPPED"] == 100


def test_state_tells_the_truth_of_every_part():
    """More than the topics say: true joints, targets, torques, travel, the lift's height."""
    state = report.state(used())
    assert state["arms"]["left"]["target_rad"][3] == 2.2
    assert len(state["arms"]["right"]["q_rad"]) == 7
    assert state["grippers"]["left"]["level_01"] is None
    assert state["chassis"]["velocity"][0] > 0.2
    assert state["lift"]["lowered_m"] == 0.30
    assert state["mode"]["meta_mode"] == 1
    assert report.state(SimRobot())["lift"] is None


def test_reports_are_json():
    """Everything can cross the control channel."""
    robot = used()
    robot.inject({"fault": "vr_mode"}, robot.now_ns)
    assert json.loads(json.dumps(report.stats(robot)))["now_ns"] == 2 * S
    assert json.loads(json.dumps(report.state(robot)))["faults"] == ["vr_mode"]


def test_only_command_types_have_content():
    """A message that is no command has nothing to report."""
    assert report.content(std_msgs.Int32(data=3)) is None


def test_only_joint_setpoints_say_when_they_were_sent():
    """The header's stamp (§4.3); a pose has no header."""
    stamp = builtin_interfaces.Time(sec=3, nanosec=7)
    message = sensor_msgs.JointState(
        header=std_msgs.Header(stamp=stamp, frame_id=""), name=[], position=[], velocity=[], effort=[]
    )
    assert report.sent_ns(message) == 3 * S + 7
    assert report.sent_ns(geometry_msgs.Pose()) is None
