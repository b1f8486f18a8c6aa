"""Stop endpoints of both clients, with the real engine in virtual time: a deadman's whole life."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from gateway.api import protocol
from gateway.client import aio, connect
from gateway.errors import Aborted, Code, Disconnected, NotReady, Rejected
from tests.client.playing import play
from tests.client.robot_world import RobotWorld
from tests.e2e.pages import blocks
from tests.e2e.system import ROOT


@pytest.fixture
def world():
    """A robot and its gateway."""
    return RobotWorld()


@pytest.fixture
def robot(world):
    """A client that may watch."""
    with connect(transport=world.transport(), name="page") as robot:
        yield robot


def names(robot):
    """Names of the stop endpoints that a state shows."""
    return [endpoint.name for endpoint in robot.fresh_state().endpoints]


def test_a_block_registers_checks_in_and_leaves(world, robot):
    """A second client sees it, its period and what it chose."""
    with robot.stop_endpoint(0.4, "pause") as endpoint:
        for _ in range(20):
            endpoint.check_in()
            world.run(0.1)
        (view,) = robot.fresh_state().endpoints
        assert (view.name, view.timeout_ns, view.on_silence, view.is_silent) == ("page", 400_000_000, "pause", False)
        assert endpoint.is_registered and "number 1" in repr(endpoint)
    world.run(0.1)
    assert names(robot) == [] and not endpoint.is_registered and "not registered" in repr(endpoint)
    endpoint.leave()  # may be called again


class Button:
    """A deadman's button that is held for a while, and then is not; raises `Released` when that has been long enough."""

    class Released(Exception):
        """The test has seen what it wanted."""

    def __init__(self):
        self.asked = 0

    def is_held(self):
        self.asked += 1
        if self.asked > 30:
            raise self.Released
        return self.asked <= 10

    def check_in_as_the_docs_say(self, world, robot):
        """Run the page's loop with this button, on the world's time."""
        (text,) = (block.text for block in blocks(ROOT / "docs" / "stopping.md") if "check_in()" in block.text)
        exec(text, {"robot": robot, "button": self, "time": SimpleNamespace(sleep=world.run)})


def test_releasing_the_button_of_the_docs_deadman_holds_the_robot(world, robot):
    """Not so where the loop ends with the button: its block ends in order, and the motion goes on."""
    with connect(transport=world.transport()) as other, other.control() as own:
        own.enable()
        motion = own.left_arm.move_by(np.full(7, 0.2), speed=0.01)
        with pytest.raises(Button.Released):
            Button().check_in_as_the_docs_say(world, robot)
        with pytest.raises(Aborted) as caught:
            motion.result(timeout=0.1)
        assert caught.value.code is Code.ENDPOINT_SILENT and other.state.endpoints[0].is_silent


def test_no_thread_of_ours_checks_in(world, robot):
    """An owner's keepalives go on by themselves; as a watcher he is silent, and his own motion ends."""
    with robot.control() as own:
        own.enable()
        endpoint = robot.stop_endpoint(0.3).register()
        motion = own.left_arm.move_by(np.full(7, 0.2), speed=0.05)
        with pytest.raises(Aborted) as caught:
            motion.result(timeout=5.0)
        assert caught.value.code is Code.ENDPOINT_SILENT
        with pytest.raises(NotReady, match="was not heard"):
            own.left_arm.move_by(np.full(7, 0.1))
        endpoint.check_in()
        world.run(0.05)
        own.left_arm.move_by(np.full(7, 0.01))  # by hand
        endpoint.leave()


def test_a_block_left_by_an_exception_stays_registered(world, robot):
    """Whatever went wrong with the watcher, the robot is held."""
    with pytest.raises(KeyError), robot.stop_endpoint(0.2):
        raise KeyError
    world.run(0.4)
    assert robot.fresh_state().endpoints[0].is_silent


def test_one_that_was_let_go_is_told(world, robot):
    """A check-in after a `recover` with a reason does nothing in secret."""
    endpoint = robot.stop_endpoint(0.2).register()
    world.run(0.5)
    with pytest.raises(NotReady) as caught:
        robot.recover()
    assert caught.value.code is Code.ENDPOINT_SILENT and "reason" in caught.value.hint
    robot.recover("the page was closed")
    world.run(0.1)
    for _ in range(2):
        with pytest.raises(NotReady) as caught:
            endpoint.check_in()
        assert caught.value.code is Code.ENDPOINT_UNKNOWN


def test_without_a_daemon_a_check_in_says_so(world, robot):
    """After a second without one."""
    endpoint = robot.stop_endpoint().register()
    world.plane.set_reachable(False)
    endpoint.check_in()  # a hiccup of the connection
    world.run(1.1)
    with pytest.raises(Disconnected):
        endpoint.check_in()


def test_nobody_checks_in_for_another(world, robot):
    """A wrong secret, and none, are dropped and counted."""
    robot.stop_endpoint(0.3).register()
    transport = world.transport()
    for _ in range(5):
        transport.put(protocol.check_in_key(robot.client_id, "guessed"), b"")
        transport.put(protocol.check_in_key(robot.client_id, ""), b"")
        world.run(0.1)
    assert robot.fresh_state().endpoints[0].is_silent


@pytest.mark.parametrize(("timeout", "code"), [(0.05, Code.OUT_OF_RANGE), (11.0, Code.OUT_OF_RANGE)])
def test_a_period_out_of_its_bounds_is_refused(robot, timeout, code):
    """By the daemon, with the bound."""
    with pytest.raises(Rejected) as caught:
        robot.stop_endpoint(timeout).register()
    assert caught.value.code is code and caught.value.bound == "[0.1, 10]"


def test_a_choice_that_there_is_not_is_refused(robot):
    """Before anything is sent."""
    with pytest.raises(Rejected, match="hold, pause"):
        robot.stop_endpoint(0.5, "brake")


def test_the_same_is_true_for_asyncio(world):
    """Register, check in, leave; an exception leaves it registered."""

    async def live():
        async with aio.connect(transport=world.transport(), name="page") as robot:
            async with robot.stop_endpoint(0.5) as endpoint:
                endpoint.check_in()
                assert len((await robot.fresh_state()).endpoints) == 1
            assert not endpoint.is_registered
            with pytest.raises(KeyError):
                async with robot.stop_endpoint(0.5) as endpoint:
                    raise KeyError
            await robot.recover()
            assert endpoint.is_registered

    play(world, live)
