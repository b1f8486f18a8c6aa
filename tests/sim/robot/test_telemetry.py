"""Rules of what the robot publishes (§4.1.1, §4.8, §4.11)."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.sim.robot.geometry import arm_geometry
from gateway.sim.robot.manual import MS, STATE_TOPICS, S, Side
from gateway.sim.robot.model import SimRobot
from gateway.sim.robot.settings import HANGING_RAD, SimSettings
from gateway.sim.robot.telemetry import Grid


def one_cycle(robot: SimRobot, now_ns: int = 0) -> dict:
    """Messages of one instant by topic."""
    return dict(robot.advance(now_ns))


def test_a_grid_skips_to_the_last_due_point():
    """After a late look only the newest point is left; a point in the future stays."""
    grid = Grid(7, 5)
    grid.skip_to(29)
    assert grid.next_ns == 27
    grid.skip_to(28)
    assert grid.next_ns == 27
    grid.advance()
    grid.skip_to(0)
    assert grid.next_ns == 32


@pytest.mark.parametrize("start_ns", [0, 123_456_789])
def test_every_topic_has_its_nominal_rate(start_ns):
    """Over one second each topic is published as often as the manual says, on its own absolute grid."""
    robot = SimRobot(start_ns=start_ns)
    counts = dict.fromkeys(STATE_TOPICS, 0)
    for step_ns in range(0, S, 7 * MS):
        for topic, _ in robot.advance(start_ns + min(step_ns + 7 * MS, S) - 1):
            counts[topic] += 1
    assert counts == {topic: rate for topic, (_, rate) in STATE_TOPICS.items()}


@pytest.mark.parametrize("side", Side)
def test_joint_states_look_as_sampled_on_the_real_robot(side):
    """Names, order, frame and lengths of §4.8."""
    messages = one_cycle(SimRobot())
    arm = messages[f"/{side.value}_arm/joint_states"]
    assert arm.header.frame_id == f"{side.value}_arm"
    assert arm.name == [f"{side.value[0]}_joint{n}" for n in range(1, 8)]
    assert [len(arm.position), len(arm.velocity), len(arm.effort)] == [7, 7, 7]
    assert arm.position == pytest.approx(HANGING_RAD[side], abs=2e-3)
    gripper = messages[f"/{side.value}_gripper/joint_states"]
    assert gripper.header.frame_id == f"{side.value}_gripper"
    assert gripper.name == [f"{side.value[0]}_joint8"]
    assert [len(gripper.position), len(gripper.velocity), len(gripper.effort)] == [1, 1, 1]


def test_chassis_states_look_as_sampled_on_the_real_robot():
    """Three wheels with the names of §4.8."""
    wheels = one_cycle(SimRobot())["/chassis/joint_states"]
    assert wheels.header.frame_id == "chassis"
    assert wheels.name == ["chassis_joint1", "chassis_joint2", "chassis_joint3"]
    assert [len(wheels.position), len(wheels.velocity), len(wheels.effort)] == [3, 3, 3]


@pytest.mark.parametrize("side", Side)
def test_the_pose_is_that_of_the_measured_joints(side):
    """`current_ee_pose` belongs to the joint state published with it (§4.0.2)."""
    messages = one_cycle(SimRobot())
    pose = messages[f"/{side.value}_arm/current_ee_pose"]
    expected = arm_geometry(side).forward(messages[f"/{side.value}_arm/joint_states"].position)
    assert (pose.position.x, pose.position.y, pose.position.z) == pytest.approx(expected.position_m, abs=1e-12)
    o = pose.orientation
    assert (o.x, o.y, o.z, o.w) == pytest.approx(expected.quat_xyzw, abs=1e-12)


def test_stamps_are_the_robots_own_clock():
    """The stamp is the publishing time on a clock with an offset of its own; nanoseconds stay below a second."""
    epoch_ns = 1_790_000_000 * S + 999_999_999
    robot = SimRobot(SimSettings(clock_offset_ns=-3 * MS), epoch_ns=epoch_ns)
    for topic, message in robot.advance(20 * MS):
        if topic == "/left_arm/joint_states":
            stamp = message.header.stamp
            assert 0 <= stamp.nanosec < S
            last_ns = stamp.sec * S + stamp.nanosec
    assert last_ns == epoch_ns + 17 * MS


ARM = "/left_arm/joint_states"


def measured(seed: int, step_ns: int) -> np.ndarray:
    """Positions published over a second, stepped in a certain way."""
    robot = SimRobot(SimSettings(seed=seed))
    rows = []
    for now_ns in range(step_ns, S + 1, step_ns):
        rows += [m.position for topic, m in robot.advance(now_ns) if topic == "/left_arm/joint_states"]
    return np.array(rows)


def test_noise_is_small_and_depends_on_the_seed_only():
    """The same seed gives the same samples however the robot is stepped; another seed gives others."""
    once, again, other = measured(1, 5 * MS), measured(1, 125 * MS), measured(2, 5 * MS)
    assert np.array_equal(once, again)
    assert not np.array_equal(once, other)
    assert np.std(once - HANGING_RAD[Side.LEFT]) == pytest.approx(2e-4, rel=0.2)


@pytest.mark.parametrize("every", [1, 4, 10])
def test_noise_favours_no_direction(every):
    """Nor for those who look at 50 or 20 Hz: over a minute its mean is a hundredth of a sample's, in every joint."""
    robot = SimRobot()
    rows = [m.position for topic, m in robot.advance(60 * S, topics=(ARM,)) if topic == ARM][::every]
    assert np.max(np.abs(np.mean(rows, axis=0) - HANGING_RAD[Side.LEFT])) < 1.2e-5


def test_only_wanted_topics_are_built():
    """Topics that nobody listens to cost nothing and are not returned."""
    robot = SimRobot()
    assert {topic for topic, _ in robot.advance(S, topics=("/fsm_state",))} == {"/fsm_state"}
    assert robot.advance(2 * S, topics=()) == []


def test_latest_only_gives_one_message_of_each_topic():
    """A long step with `latest_only` returns the last due message, with the stamp of its own grid point."""
    robot = SimRobot(epoch_ns=0)
    published = robot.advance(10 * S + 3 * MS, latest_only=True)
    assert sorted(topic for topic, _ in published) == sorted(STATE_TOPICS)
    assert dict(published)["/left_arm/joint_states"].header.stamp.sec == 10
