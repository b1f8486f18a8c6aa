"""Tests of LeRobot's teleoperator `teleavatar_leader`: a robot that is looked at leads another one."""

from __future__ import annotations

import pytest

from gateway.client import connect
from tests.client.robot_world import RobotWorld
from tests.plugins.test_teleavatar import HOME_Q_RAD, HZ, JOINTS, Side, shown


@pytest.fixture
def ahead(place):
    """Return the leader's world."""
    return place.setdefault("unix:/leader", RobotWorld())


@pytest.fixture
def leader(plugin, ahead):
    """Return a leader that is connected."""
    with plugin.TeleavatarLeader(plugin.TeleavatarLeaderConfig(id="l1", gateway="unix:/leader")) as leader:
        yield leader


def test_its_actions_are_those_of_the_robot(plugin, leader, errors):
    """By name and kind; it feels nothing and is calibrated."""
    robot = plugin.Teleavatar(plugin.TeleavatarConfig())
    assert leader.action_features == robot.action_features and leader.feedback_features == {}
    assert (leader.name, leader.config.type) == ("teleavatar_leader",) * 2 and leader.is_calibrated
    leader.send_feedback({})
    with pytest.raises(errors.DeviceAlreadyConnectedError):
        leader.connect()
    leader.disconnect()
    for call in (leader.get_action, leader.disconnect, lambda: leader.send_feedback({})):
        with pytest.raises(errors.DeviceNotConnectedError):
            call()
    leader.connect()


def test_it_is_only_looked_at(ahead, leader):
    """Whoever moves it owns it."""
    leader.get_action()
    assert not shown(ahead).lease.owned


def test_a_follower_does_what_it_does(world, ahead, leader, robot):
    """Somebody moves the leader and closes its gripper; the other robot follows, the grip as torque."""
    home = {"left": HOME_Q_RAD[Side.LEFT], "right": HOME_Q_RAD[Side.RIGHT]}
    with connect(transport=ahead.transport(), name="mover") as mover, mover.control() as own:
        own.enable()
        own.left_gripper.set(1.0)
        own.move_to(home)
        for _ in range(4 * HZ):
            robot.get_observation()
            robot.send_action(leader.get_action())
            ahead.run(1 / HZ)
            world.run(1 / HZ)
    led, seen = leader.get_action(), robot.get_observation()
    assert max(abs(led[name] - seen[name]) for name in JOINTS) < 0.02
    assert seen["left_joint2.pos"] == pytest.approx(home["left"][1], abs=0.02)
    assert shown(world).grip("left").torque_nm == pytest.approx(-1.6, abs=0.2)


def test_its_loss_is_borne_for_a_while(ahead, leader, errors):
    """It stands where it was; then it is an error."""
    before = leader.get_action()
    ahead.pair.freeze()
    ahead.run(1.0)
    assert leader.get_action() == before
    ahead.run(1.9)
    assert leader.get_action() == before
    ahead.run(0.2)
    with pytest.raises(errors.DeviceNotConnectedError, match=r"no new state of the robot for 2\.1 s: "):
        leader.get_action()
    ahead.pair.thaw()
    ahead.run(0.5)
    leader.get_action()


def test_a_gripper_that_is_not_heard_any_more_leads_nobody(ahead, leader, errors):
    """Its last torque would be gripped with for ever; the arms say nothing of it."""
    leader.get_action()
    ahead.pair.robot.inject({"fault": "freeze", "topic": "/left_gripper/joint_states"}, ahead.pair.now_ns)
    ahead.run(1.0)
    leader.get_action()
    ahead.run(2.5)
    with pytest.raises(errors.DeviceNotConnectedError, match="left_gripper"):
        leader.get_action()
