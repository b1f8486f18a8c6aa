"""Tests of LeRobot's robot `teleavatar`: as LeRobot means it, and held in every loss."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from gateway import video
from gateway.client import connect
from gateway.errors import Code, failure
from gateway.robot.limits import HOME_Q_RAD, JOINT_UPPER_RAD
from gateway.robot.vector_layout import EYES, STATE_NAMES
from gateway.values import Side
from gateway.video.errors import VideoCode, VideoTimeout
from tests.client.robot_world import RobotWorld

HZ = 30
JOINTS = [f"{side}_joint{n}.pos" for side in ("left", "right") for n in range(1, 8)]
HOME = dict(zip(JOINTS, (*HOME_Q_RAD[Side.LEFT], *HOME_Q_RAD[Side.RIGHT]), strict=True))
ACTION = {**HOME, "left_gripper.torque": -0.8, "right_gripper.torque": 0.0}


def play(world, robot, action, seconds):
    """Play LeRobot's loop; return what was observed and what was sent last."""
    for _ in range(round(seconds * HZ)):
        seen = robot.get_observation()
        sent = robot.send_action(action)
        world.run(1 / HZ)
    return seen, sent


def shown(world):
    """Return the gateway's state, as anybody sees it."""
    with connect(transport=world.transport(), name="looker") as looker:
        return looker.state


def test_features_have_lerobots_names_in_the_order_of_the_robot(plugin):
    """16 numbers each; what a gripper is told is a torque. They are known before anything is connected."""
    robot = plugin.Teleavatar(plugin.TeleavatarConfig(id="r1"))
    assert list(robot.observation_features)[:8] == [*JOINTS[:7], "left_gripper.pos"]
    assert list(robot.action_features)[8:] == [*JOINTS[7:], "right_gripper.torque"]
    assert set(robot.observation_features.values()) == set(robot.action_features.values()) == {float}
    assert len(robot.observation_features) == len(robot.action_features) == 16
    assert (robot.name, robot.config.type, robot.robot_type) == ("teleavatar",) * 3
    assert not robot.cameras and robot.is_calibrated and not robot.is_connected


def test_cameras_are_those_of_our_datasets_in_the_sizes_of_the_manual(plugin):
    """Without an address of the video there are none; `resize` makes squares."""
    robot = plugin.Teleavatar(plugin.TeleavatarConfig(video="any"))
    assert robot.cameras == EYES["vendor_openpi"]
    shapes = {name: shape for name, shape in robot.observation_features.items() if name in robot.cameras}
    assert shapes == {"head_camera": (960, 960, 3), "left_color": (400, 640, 3), "right_color": (400, 640, 3)}
    small = plugin.Teleavatar(plugin.TeleavatarConfig(video="any", resize=224, views={"a": "head_left_eye"}))
    assert small.observation_features["a"] == (224, 224, 3)
    with pytest.raises(ValueError, match=r"no view nose: there are head_right_eye"):
        plugin.Teleavatar(plugin.TeleavatarConfig(views={"a": "nose"}))


def test_connecting_owns_and_enables_and_disconnecting_pauses(plugin, world, robot, errors):
    """Twice is an error each, as LeRobot has it; nothing moves by connecting."""
    before = robot.get_observation()
    state = shown(world)
    assert state.state == "ACTIVE" and state.lease.name == "lerobot r1"
    world.run(0.5)
    after = robot.get_observation()
    assert max(abs(after[name] - before[name]) for name in JOINTS) < 0.01
    with pytest.raises(errors.DeviceAlreadyConnectedError):
        robot.connect()
    robot.calibrate()
    robot.configure()
    robot.disconnect()
    assert shown(world).state == "READ_ONLY" and not robot.is_connected
    for call in (robot.disconnect, robot.get_observation, lambda: robot.send_action(ACTION)):
        with pytest.raises(errors.DeviceNotConnectedError, match="r1 Teleavatar is not connected"):
            call()
    robot.connect()  # again


def test_it_can_be_left_held(plugin, world):
    """With the grip, for who carries something: `on_disconnect=hold`."""
    robot = plugin.Teleavatar(plugin.TeleavatarConfig(on_disconnect="hold"))
    robot.connect()
    robot.disconnect()
    world.run(0.1)
    assert shown(world).state == "HOLDING"


def test_what_stands_against_it_is_lerobots_error_in_the_gateways_words(plugin, world, errors):
    """Somebody owns the robot; nothing stays open."""
    with connect(transport=world.transport(), name="policy-a") as other, other.control():
        robot = plugin.Teleavatar(plugin.TeleavatarConfig(id="r1"))
        with pytest.raises(errors.DeviceNotConnectedError, match=r"LEASE_HELD.*policy-a"):
            robot.connect()
        assert not robot.is_connected
    robot.connect()
    robot.disconnect()


@pytest.mark.parametrize("is_silent", [True, False])
def test_an_arm_that_is_disabled_is_told_before_anything_moves(plugin, place, errors, is_silent):
    """With the remedy, whether or not it still tells of itself (manual §2.7.1); else the other arm would move alone."""
    world = place.setdefault(None, RobotWorld(enable_right_arm=not is_silent))
    if not is_silent:
        world.pair.robot.inject({"fault": "arm_disabled", "side": "right"}, world.pair.now_ns)
        world.run(1.5)
    robot = plugin.Teleavatar(plugin.TeleavatarConfig(id="r1"))
    with pytest.raises(errors.DeviceNotConnectedError, match=r"ARM_DISABLED: the right arm .* -> enable the arm"):
        robot.connect()
    assert not robot.is_connected and not shown(world).lease.owned


def test_actions_move_both_arms_and_grippers(world, robot):
    """Through the gateway's limits; the simulated robot is where it was told."""
    seen, sent = play(world, robot, ACTION, 3.0)
    assert all(math.isclose(seen[name], HOME[name], abs_tol=0.01) for name in JOINTS)
    assert sent == pytest.approx(ACTION)
    assert shown(world).grip("left").torque_nm == pytest.approx(-0.8)


def test_what_is_returned_is_what_is_followed(world, robot):
    """Joints clipped to their limits, torque to the gripper's; the robot never sees more."""
    wild = {**ACTION, "left_joint1.pos": 9.0, "right_gripper.torque": -7.0}
    seen, sent = play(world, robot, wild, 3.0)
    upper = JOINT_UPPER_RAD[Side.LEFT][0]
    assert sent["left_joint1.pos"] == pytest.approx(upper) and sent["right_gripper.torque"] == pytest.approx(-1.6)
    assert seen["left_joint1.pos"] < upper + 0.01


def test_what_was_sent_is_returned_though_a_gripper_takes_nothing(world, robot, errors):
    """The arms follow; nobody says that they were told what they were told before, or that all is held."""
    play(world, robot, ACTION, 1.0)

    def refused(command):
        raise failure(Code.PART_STALE, "the right gripper is not heard")

    robot._arms[1]._gripper = SimpleNamespace(set=refused)
    away = {**ACTION, "left_joint5.pos": 0.5, "right_joint5.pos": 0.5, "right_gripper.torque": -1.6}
    _, sent = play(world, robot, away, 0.5)
    assert sent == pytest.approx({**away, "right_gripper.torque": 0.0})
    with pytest.raises(errors.DeviceNotConnectedError, match=r"not all targets are followed.*gripper is not heard"):
        play(world, robot, away, 3.0)


def test_grippers_are_told_changes_only(world, robot):
    """A loop of 30 Hz asks nothing of the gateway for a grip that stays."""
    play(world, robot, ACTION, 0.2)
    asked = []
    for arm in robot._arms:
        arm._gripper = SimpleNamespace(set=asked.append)
    play(world, robot, ACTION, 0.5)
    play(world, robot, {**ACTION, "left_gripper.torque": -1.6}, 0.2)
    assert asked == [pytest.approx(1.0)]


def test_an_action_may_have_the_names_of_our_datasets(world, robot):
    """`lerobot-replay` plays what `ta2 dataset build` made: 48 dims and more, of which 16 are followed."""
    built = dict.fromkeys(STATE_NAMES, 0.0)
    for name, value in ACTION.items():
        built[name.replace(".pos", "_position").replace(".torque", "_effort")] = np.float32(value)
    assert robot.send_action(built) == pytest.approx(ACTION, abs=1e-6)


def test_what_is_no_action_is_refused_by_name(world, robot):
    """And the robot stays connected."""
    with pytest.raises(ValueError, match=r"without right_joint7.pos \(or right_joint7_position\)"):
        robot.send_action({name: value for name, value in ACTION.items() if name != "right_joint7.pos"})
    with pytest.raises(ValueError, match="NOT_FINITE"):
        robot.send_action({**ACTION, "left_joint3.pos": math.nan})
    with pytest.raises(ValueError, match="nan"):
        robot.send_action({**ACTION, "left_gripper.torque": math.nan})
    play(world, robot, ACTION, 0.2)


def test_half_an_action_is_none(world, robot):
    """What is wrong with the right arm keeps the left one, too, where it is."""
    sent = []
    for arm in robot._arms:
        arm.send = lambda target: sent.append(target) or target
    with pytest.raises(ValueError, match="NOT_FINITE"):
        robot.send_action({**ACTION, "right_joint3.pos": math.inf})
    assert not sent


def test_a_loop_may_rest_while_an_episode_is_saved(world, robot):
    """Targets expire, the arms brake and hold; the next action goes on, and nobody is told of an error."""
    play(world, robot, ACTION, 0.5)
    world.run(4.0)
    assert max(map(abs, shown(world).left_arm.dq_ref)) == 0.0
    away = {**ACTION, "left_joint5.pos": 0.5}
    seen, _ = play(world, robot, away, 2.0)
    assert seen["left_joint5.pos"] == pytest.approx(0.5, abs=0.01)


def test_a_short_loss_is_borne_while_the_robot_is_held(world, robot):
    """The last observation and the last sent action meanwhile; then it goes on by itself."""
    play(world, robot, ACTION, 3.0)
    world.pair.freeze()
    seen, sent = play(world, robot, ACTION, 0.4)
    assert seen == robot.get_observation() and sent == pytest.approx(ACTION)
    world.pair.thaw()
    away = {**ACTION, "left_joint5.pos": 0.5}
    seen, _ = play(world, robot, away, 3.0)
    assert seen["left_joint5.pos"] == pytest.approx(0.5, abs=0.01)
    assert shown(world).state == "ACTIVE"


def test_a_part_that_is_silent_stays_as_it_was_while_the_others_are_observed_on(world, robot, errors):
    """The arms move on, and LeRobot sees where they are; the part that is lost is an error after `patience_s`."""
    play(world, robot, ACTION, 3.0)
    world.pair.robot.inject({"fault": "drop", "topic": "/right_gripper/joint_states"}, world.now_ns())
    world.run(0.2)
    away = {**ACTION, "left_joint5.pos": 0.5, "right_gripper.torque": -1.6}
    before = robot.get_observation()
    seen, _ = play(world, robot, away, 1.4)
    assert seen["right_gripper.pos"] == before["right_gripper.pos"]
    assert seen["left_joint5.pos"] == pytest.approx(0.5, abs=0.01)
    with pytest.raises(errors.DeviceNotConnectedError, match=r"no new state.*right_gripper"):
        play(world, robot, away, 1.0)


def test_a_long_loss_is_an_error_and_the_robot_is_not_enabled_again(world, robot, errors):
    """Whoever lost it for longer than `patience_s` looks first: it may have been the emergency stop."""
    play(world, robot, ACTION, 1.0)
    world.pair.freeze()
    began_ns = world.now_ns()
    with pytest.raises(errors.DeviceNotConnectedError, match=r"for 2\.0 s: "):
        play(world, robot, ACTION, 4.0)
    assert (world.now_ns() - began_ns) / 1e9 == pytest.approx(2.1, abs=0.2)
    world.pair.thaw()
    world.run(1.0)
    with pytest.raises(errors.DeviceNotConnectedError, match="not all targets are followed"):
        play(world, robot, ACTION, 3.0)
    assert shown(world).state in ("IDLE", "PAUSED") and robot.is_connected
    robot.disconnect()  # no error


def test_a_stop_by_somebody_ends_the_loop(world, robot, errors):
    """The arms are held from the stop on, though the loop goes on for `patience_s`."""
    play(world, robot, ACTION, 0.5)
    with connect(transport=world.transport(), name="someone") as other:
        other.stop("too near")
    world.run(0.5)
    held = robot.get_observation()
    with pytest.raises(errors.DeviceNotConnectedError, match="LATCHED"):
        play(world, robot, ACTION, 3.0)
    after = robot.get_observation()
    assert max(abs(after[name] - held[name]) for name in JOINTS) < 0.01


class Pictures:
    """A stand-in of the video: one picture, as old as somebody says."""

    age = 0.0
    has_any = True

    def __init__(self, source, port, strict):
        self.source, self.port, self.strict = source, port, strict
        self.ended = False

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.ended = True

    def __getitem__(self, view):
        picture = np.full((400, 640, 3), 7, np.uint8)
        picture.flags.writeable = False
        return picture

    @property
    def latest(self):
        return self

    def wait_frame(self, timeout):
        return self if self.has_any else None

    def silence(self, seconds):
        return VideoTimeout(VideoCode.NO_PACKETS, f"no picture came in {seconds:g} s", "see `ta2 video check`")


def test_pictures_come_with_the_numbers(plugin, world, monkeypatch):
    """Writable copies, squares where they are asked for."""
    monkeypatch.setattr(video, "Video", Pictures, raising=False)
    with plugin.Teleavatar(plugin.TeleavatarConfig(video="10.0.0.1", video_port=5000)) as robot:
        seen = robot.get_observation()
        assert {"left_color", "right_color", "head_camera"} < set(seen) and len(seen) == 19
        assert seen["left_color"].shape == (400, 640, 3) and seen["left_color"].flags.writeable
        pictures = robot._video
        assert (pictures.source, pictures.port, pictures.strict) == ("10.0.0.1", 5000, True)
        robot.config.resize = 224
        assert robot.get_observation()["left_color"].shape == (224, 224, 3)
    assert pictures.ended


def test_no_new_undamaged_picture_is_warned_of_and_then_an_error(plugin, world, monkeypatch, errors, caplog):
    """As numbers: the last one for `patience_s`. Damaged ones are withheld by the video, and do not count as new."""
    monkeypatch.setattr(video, "Video", Pictures, raising=False)
    with plugin.Teleavatar(plugin.TeleavatarConfig(video="10.0.0.1")) as robot:
        pictures = robot._video
        assert pictures.strict
        play(world, robot, ACTION, 0.2)
        assert "picture" not in caplog.text
        pictures.age = 0.6
        seen, _ = play(world, robot, ACTION, 1.0)
        assert "left_color" in seen and caplog.text.count("no new undamaged picture: NO_PACKETS") == 1
        pictures.age = 0.1
        play(world, robot, ACTION, 0.1)
        assert "no new undamaged picture: over" in caplog.text
        pictures.age = 0.6
        with pytest.raises(errors.DeviceNotConnectedError, match=r"no new undamaged picture for 2\.\d s: NO_PACKETS"):
            play(world, robot, ACTION, 3.0)


def test_without_a_picture_nothing_is_owned(plugin, world, monkeypatch, errors):
    """`connect` waits for one, and says what `ta2 video check` would."""
    monkeypatch.setattr(video, "Video", Pictures, raising=False)
    monkeypatch.setattr(Pictures, "has_any", False)
    robot = plugin.Teleavatar(plugin.TeleavatarConfig(video="any"))
    with pytest.raises(errors.DeviceNotConnectedError, match="NO_PACKETS"):
        robot.connect()
    assert not shown(world).lease.owned and not robot.is_connected
