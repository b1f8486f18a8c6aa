"""Motions, chunks and streams that end at a touch, as a user asks for them: the real engine in virtual time."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.client import connect, contact
from gateway.errors import Aborted, Code, GatewayError, GatewayTimeout, NotReady
from tests.client.robot_world import RobotWorld
from tests.pushed import LEFT, Pushed, felt

PUSHED = felt(0.0, 0.0, 20.0)
FREE = felt(0.0, 0.0, 0.0)
TABLE = contact(8, (0, 0, 1), back_off_m=0.02)


@pytest.fixture
def world():
    """A robot whose gateway feels what a test says."""
    world = RobotWorld(is_modelled=True)
    world.pair.model.contacts = world.pushed = Pushed()
    return world


@pytest.fixture
def own(world):
    """A client that owns the robot, with the arms enabled."""
    with connect(transport=world.transport(), name="tester") as robot, robot.control(on_exit="hold") as own:
        own.enable()
        own.robot = robot
        yield own


def push(world, view=PUSHED):
    """Push the left hand from now on."""
    world.pushed.views[LEFT] = view


def elsewhere(own, by_rad=0.4):
    """Return the left arm's joints with the first and the fourth elsewhere."""
    return own.robot.state.left_arm.q + by_rad * np.eye(7)[0] + by_rad * np.eye(7)[3]


@pytest.mark.parametrize("direction", ["up", (0, 1), ((0, 0, 1), (0, 0)), True, ()])
def test_a_direction_that_is_none_is_refused_where_it_is_written(direction):
    """With what is needed; so is a force that is no number."""
    with pytest.raises(GatewayError) as caught:
        contact(8, direction)
    assert caught.value.code is Code.WRONG_SHAPE and caught.value.field == "direction"
    with pytest.raises(GatewayError) as caught:
        contact("8")
    assert caught.value.code is Code.BAD_REQUEST and caught.value.field == "force_n"


def test_a_motion_that_is_to_end_at_a_touch_ends_well_there_or_at_its_goal(world, own):
    """`result` waits until the hand is back, and tells the touch; without one it is as ever."""
    goal = elsewhere(own)
    handle = own.left_arm.move_to(goal, until=TABLE)
    world.after(0.6, lambda: push(world))
    world.after(0.7, lambda: push(world, FREE))
    result = handle.result()
    assert handle.state == "touched" and result.touch.number == 1 and result.touch.force_n == 20.0
    states = [motion.state for motion in world.pair.see().motions]
    assert states == ["touched", "reached"] and result.touch.back_id == 2
    assert own.left_arm.move_to(goal, until=TABLE).result().touch is None


def test_the_way_back_counts_against_the_time_of_the_wait(world, own):
    """It goes on; whatever ends it is raised."""
    handle = own.left_arm.move_to(elsewhere(own), until=TABLE)
    world.after(0.6, lambda: push(world))
    with pytest.raises(GatewayTimeout):
        handle.result(timeout=0.7)
    world.after(0.05, lambda: own.robot.stop())
    with pytest.raises(Aborted) as caught:
        handle.result()
    assert caught.value.code is Code.STOPPED


def test_who_was_told_of_a_touch_may_ask_again_at_once_and_who_was_not_may_not(world, own):
    """A chunk that was under way is refused; after `result` the next one is not."""
    there = elsewhere(own)
    handle = own.left_arm.move_to(there, until=contact(8))
    world.after(0.4, lambda: push(world))
    world.after(0.45, lambda: push(world, FREE))
    world.run(0.5)
    points = np.linspace(own.robot.state.left_arm.q_ref, there, 20)
    with pytest.raises(Aborted) as caught:
        own.left_arm.follow(points, 0.2, until=contact(8))
    assert caught.value.code is Code.CONTACT
    assert handle.result().touch.number == 1
    own.left_arm.move_to(there, until=contact(8))
    own.left_arm.hold()


def test_a_stream_tells_the_touch_that_ended_it(world, own):
    """The next tick raises with the code, and from then on its user knows."""
    there = elsewhere(own)
    with pytest.raises(Aborted) as caught, own.left_arm.stream(until=contact(8)) as out:
        assert out.touch is None
        world.after(0.4, lambda: push(world))
        for _ in range(50):
            out.set(there)
            out.tick()
    assert caught.value.code is Code.CONTACT and out.touch.number == 1
    push(world, FREE)
    with own.left_arm.stream(until=contact(8)) as out:
        out.tick()


def test_poses_may_end_at_a_touch_and_nothing_begins_that_would_not_feel_it(world, own):
    """Straight and otherwise, of one arm and of both."""
    world.pair.run_until(lambda: not any(world.pair.model.refusal(side, world.now_ns()) for side in world.pushed.views))
    pose = own.robot.state.left_arm.pose
    world.pushed.views[LEFT] = felt(None, None, None)
    for ask in (
        lambda: own.left_arm.move_pose(pose.p, pose.quat_xyzw, frame=pose.frame, until=TABLE),
        lambda: own.left_arm.move_linear(pose.p, pose.quat_xyzw, frame=pose.frame, until=TABLE),
        lambda: own.move_pose({"left": pose}, until=TABLE),
        lambda: own.move_linear({"left": pose}, until=TABLE),
        lambda: own.move_by({"left": np.zeros(7)}, until=TABLE),
        lambda: own.left_arm.move_by(np.zeros(7), until=TABLE),
    ):
        with pytest.raises(NotReady) as caught:
            ask()
        assert caught.value.code is Code.CONTACT_UNKNOWN
