"""Tests of `ta2 view` against the real engine and the simulated robot, in virtual time."""

from __future__ import annotations

import os
import signal
import socket
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from tests.cli.scene.rrd import read

from gateway.cli.scene import view as viewing
from tests.client.robot_world import RobotWorld


@pytest.fixture
def robot(shell):
    """A shell whose commands find a robot in joint mode."""
    shell.world = RobotWorld()
    return shell


def test_a_file_holds_joints_hands_body_and_what_was_told(robot, tmp_path):
    """It is a client under its own name, which owns nothing."""
    file = tmp_path / "a.rrd"
    ended = robot.run("view", "--save", str(file), "--seconds", "0.5")
    assert ended.status == 0, ended.err
    assert ended.out.strip() == str(file) and robot.names == ["ta2 view"]
    found, arms = read(file), robot.world.pair.see().arms
    for side in ("left", "right"):
        rows = found[f"joints/{side}/measured"]["scalars"]
        assert rows[-1] == pytest.approx(arms[side].measured.q_rad, abs=0.01)
        hand = found[f"virtual_base/{side}_base_virtual/{side}_shoulder_base/measured"]["translation"]
        assert hand[-1][0] == pytest.approx(arms[side].p_m, abs=0.01)
    assert found["virtual_base/chest/body"]["lengths"]
    assert not robot.world.pair.see().lease.owned


def test_an_arm_that_is_silent_is_not_drawn_as_if_it_were_now(robot, tmp_path):
    """Neither its joints nor its hand, nor a body of which half is old; what it is told goes on."""
    for topic in ("joint_states", "current_ee_pose"):
        fault = {"fault": "drop", "topic": f"/right_arm/{topic}"}
        robot.world.pair.robot.inject(fault, robot.world.now_ns())
    robot.world.run(1.0)
    file = tmp_path / "a.rrd"
    assert robot.run("view", "--save", str(file), "--seconds", "0.5").status == 0
    found = read(file)
    assert found["joints/left/measured"]["scalars"] and found["hands/left"]["scalars"]
    assert not found["joints/right/measured"]["scalars"] and not found["hands/right"]["scalars"]
    assert "virtual_base/chest/body" not in found


def test_a_signal_ends_it_and_the_file_is_whole(robot, tmp_path):
    """SIGTERM, as whoever started it sends it; the status says so."""
    file = tmp_path / "a.rrd"
    robot.world.after(1.0, lambda: os.kill(os.getpid(), signal.SIGTERM))
    assert robot.run("view", "--save", str(file)).status == 128 + signal.SIGTERM
    assert read(file)["joints/left/measured"]["scalars"]


def test_ctrl_c_is_its_normal_end(robot, tmp_path):
    """Status 0, and the file's name."""
    file = tmp_path / "a.rrd"
    robot.world.after(1.0, lambda: os.kill(os.getpid(), signal.SIGINT))
    ended = robot.run("view", "--save", str(file))
    assert ended.status == 0 and ended.out.strip() == str(file)


def test_a_gateway_that_is_gone_is_waited_for(robot, tmp_path, monkeypatch):
    """Nothing is drawn meanwhile, and nothing ends."""
    monkeypatch.setattr(viewing, "AWAY_S", 0.0)
    plane, file = robot.world.plane, tmp_path / "a.rrd"
    publish, seen = plane.publish_snapshot, []

    def silent(snapshot):
        seen.append(snapshot)
        if not 5 < len(seen) < 150:
            publish(snapshot)

    monkeypatch.setattr(plane, "publish_snapshot", silent)
    robot.world.after(6.0, lambda: os.kill(os.getpid(), signal.SIGINT))
    assert robot.run("view", "--save", str(file)).status == 0
    assert len(seen) > 200 and len(read(file)["joints/left/measured"]["scalars"]) > 20


def test_what_cannot_be_is_said_in_a_line(shell, tmp_path):
    """A file that is none of Rerun's, settings that are wrong, and a place that cannot be written."""
    assert "does not end with .rrd" in shell.run("view", "--save", "a.mp4").err
    wrong = tmp_path / "a.toml"
    wrong.write_text("[arm]\nv_radps = 30\n")
    assert shell.run("view", "--save", str(tmp_path / "a.rrd"), "--config", str(wrong)).status == 2
    shell.world = RobotWorld()
    ended = shell.run("view", "--save", str(tmp_path / "no" / "a.rrd"))
    assert ended.status == 1 and ended.err.splitlines()[-1].startswith("BAD_REQUEST: ")


def test_pictures_are_shown_each_once(robot, tmp_path, monkeypatch):
    """The newest of the cameras, by the names of the manual."""
    frame = SimpleNamespace(seq=7, views={"head_left_eye": np.zeros((64, 48, 3), np.uint8)})
    monkeypatch.setattr(viewing, "_cameras", lambda _, port: nullcontext(SimpleNamespace(latest=frame)))
    file = tmp_path / "a.rrd"
    robot.world.after(1.0, lambda: os.kill(os.getpid(), signal.SIGINT))
    assert robot.run("view", "--video", "--save", str(file)).status == 0
    found = read(file)
    assert found["cameras/head_left_eye"]["media_type"] == [["image/jpeg"]]
    assert len(found["joints/left/measured"]["scalars"]) > 1


def test_a_port_of_pictures_that_is_taken_is_said_before_anything_is_shown(robot, tmp_path):
    """Two receivers of one stream would each get half of it."""
    pytest.importorskip("av")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("", 0))
        port = str(taken.getsockname()[1])
        ended = robot.run("view", "--video", "--video-port", port, "--save", str(tmp_path / "a.rrd"))
    assert ended.status == 1 and port in ended.err and not (tmp_path / "a.rrd").exists()
