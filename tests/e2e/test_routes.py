"""The robot's bridge and router misbehave, end to end: a dead route is declared again, a restarted router is another robot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.client import Robot
from gateway.errors import Code
from gateway.robot.topics import FSM_ENABLE, TOPICS, arm_state, joint_command
from gateway.values import Side
from tests.e2e.system import System, wait_for
from tests.stranger import Stranger

pytestmark = [pytest.mark.e2e, pytest.mark.body_free("the wire is the matter")]

Systems = Callable[..., System]

HOLD = """
with robot.control() as own:
    own.enable(timeout=12.0)
    print("enabled", flush=True)
    time.sleep(60)
"""


def told(robot: Robot, code: Code) -> list[str]:
    """Messages of the notices with a code, as far as they are known."""
    return [notice.message for notice in robot.events(timeout=0.1) if notice.code == code.value]


@pytest.mark.sim_only("a real bridge has no switch that kills its readers")
def test_dead_routes_under_a_live_link_are_declared_again_and_nothing_moves(tmp_path: Path, systems: Systems) -> None:
    """The bridge has lost all its readers: told by topic, state back within seconds, the arms where they were, down."""
    system = systems(tmp_path)
    with system.connect("watcher") as watcher:
        system.client("owner", HOLD)
        wait_for(lambda: watcher.state.state == "ACTIVE", "ACTIVE")
        before = system.arm_q()
        system.control.fault("route_dead", topic="*")
        wait_for(lambda: not watcher.state.link.fresh, "a silent robot", 3.0)
        assert watcher.state.link.up
        wait_for(lambda: watcher.state.link.fresh, "state again", 10.0)
        wait_for(lambda: watcher.state.state in {"IDLE", "HOLDING"}, "an outcome", 5.0)
        dead = told(watcher, Code.ROUTE_DEAD)
        assert any(arm_state(Side.LEFT) in text for text in dead), dead
        assert max(abs(a - b) for a, b in zip(before, system.arm_q(), strict=True)) < 0.02


@pytest.mark.thorough
@pytest.mark.sim_only("a real bridge has no switch that kills its readers")
def test_the_remedy_of_a_dead_route_names_who_keeps_it_dead(tmp_path: Path, systems: Systems) -> None:
    """While somebody else subscribes, declaring again cannot help: it is done at most four times, and he is named."""
    system = systems(tmp_path)
    topic = arm_state(Side.LEFT)
    with system.connect("watcher") as watcher:
        viewer = Stranger(system.endpoint)
        viewer.listen(topic[1:])
        system.control.fault("route_dead", topic=topic)
        (text,) = wait_for(lambda: told(watcher, Code.ROUTE_DEAD), "the dead route", 10.0)
        assert topic in text and viewer.zid in text and "cannot help while somebody else subscribes" in text
        assert watcher.state.view.topics[topic].age_ns > 500_000_000
        viewer.close()
        wait_for(lambda: watcher.state.view.topics[topic].age_ns < 100_000_000, "state again", 15.0)


def test_a_part_that_is_switched_off_is_no_lost_route(tmp_path: Path, systems: Systems) -> None:
    """Its topics are not visible (§2.7.1): nothing is told of them, and the other arm can be enabled."""
    system = systems(tmp_path, sim_options=("--disable", "right_arm", "--disable", "chassis"))
    with system.connect("ann") as robot:
        wire = wait_for(lambda: (wire := robot.routes().wire).up_ns > 4_000_000_000 and wire, "seconds of a link", 20.0)
        absent = {topic.name for topic in wire.topics if topic.route == "unannounced"}
        assert absent == {name for name in TOPICS if name.removeprefix("/api").startswith(("/right_", "/chassis/"))}
        with robot.control() as own:
            own.enable(timeout=12.0)
            assert robot.state.state in {"ACTIVE", "HOLDING"}
        codes = {notice.code for notice in robot.events(timeout=0.1)}
    assert not codes & {Code.ROUTE_LOST.value, Code.ROUTE_DEAD.value, Code.ROUTE_SUSPECT.value}
    assert "ROUTE_" not in system.daemon.text()


def test_a_restarted_router_is_another_robot_and_nothing_is_armed_again(tmp_path: Path, systems: Systems) -> None:
    """Its zenoh id is new: OFFLINE, then the base, told; the owner keeps the lease and enables explicitly."""
    system = systems(tmp_path)
    with system.connect("ann") as robot, robot.control() as own:
        own.enable(timeout=12.0)
        before = robot.state.link.router_zid
        system.control.fault("router_stop", duration_s=0.5)
        wait_for(lambda: robot.state.link.up and robot.state.link.router_zid != before, "another router", 10.0)
        wait_for(lambda: robot.state.link.fresh and robot.state.mode is not None, "state", 10.0)
        system.forget_control()
        beats = system.count(FSM_ENABLE)
        wait_for(lambda: robot.state.state == "IDLE" and robot.state.fsm == 0, "the base", 10.0)
        assert told(robot, Code.ROBOT_RESTARTED) and robot.state.lease.owned
        assert system.stats()["commands"].get(joint_command(Side.LEFT), {"count": 0})["count"] >= 0
        assert system.count(FSM_ENABLE) - beats <= 45, "1.0 went on by itself"
        own.enable(timeout=12.0)
        assert robot.state.state == "ACTIVE"
