"""Somebody else writes what we write, as ROS nodes do it: from the robot's own DDS domain, and from behind a host bridge.

Then what no ROS node sends: bytes that stop a CycloneDDS reader for half a second, put into the robot's router.
"""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import zenoh

from tests.interop.bridge_process import demand

demand(module=True)

from gateway.client import Robot
from gateway.errors import Code, GatewayError
from gateway.robot.topics import joint_command
from gateway.sim.robot.manual import command_topics
from gateway.values import Side
from tests.e2e.system import System, wait_for
from tests.e2e.test_heart import moving
from tests.interop.bridge_process import bridge_settings, start_bridge
from tests.interop.dds_node import ROBOT_DOMAIN, DdsNode, loopback
from tests.sim.drivers import joints

pytestmark = [pytest.mark.e2e, pytest.mark.interop]

LEFT = joint_command(Side.LEFT)
TYPES = command_topics(has_lift=False)
HOST_DOMAIN = 42

OWNER = """
with robot.control() as own:
    own.enable(timeout=15.0)
    own.move_to(HOME, speed=0.15)
    time.sleep(120)
"""


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[System]:
    """A DDS robot behind a real bridge, and a daemon."""
    monkeypatch.setattr(System, "kind", "dds")
    made = System(tmp_path)
    yield made
    made.close()


class Elsewhere:
    """Where somebody else writes from: the robot's own domain, or a ROS host with a bridge of its own (§2.4).

    Args:
        side: `robot` or `host`.
        system: Of the robot.
        monkeypatch: For the environment in which nodes are made.
    """

    def __init__(self, side: str, system: System, monkeypatch: pytest.MonkeyPatch) -> None:
        self.side = side
        self._bridge: subprocess.Popen[bytes] | None = None
        self._node: DdsNode | None = None
        self._domain = ROBOT_DOMAIN
        tag = system.graph
        with system.connect("probe"):
            pass  # a bridge that only connects ends when nobody listens yet
        if side == "host":
            self._domain, tag = HOST_DOMAIN, f"{system.graph}-host"
            settings = bridge_settings("", domain=HOST_DOMAIN, connect=(system.endpoint,))
            self._bridge = start_bridge(settings, system.folder, name="host", loopback=loopback(tag))
        monkeypatch.setenv("CYCLONEDDS_URI", loopback(tag))

    def appear(self) -> None:
        """Let a node announce that it will write setpoints of the left arm; it sends nothing."""
        self._node = DdsNode("somebody", publishes={LEFT: TYPES[LEFT]}, subscribes={}, domain=self._domain)

    def write(self, q_rad: list[float]) -> None:
        """Send one setpoint."""
        assert self._node is not None
        self._node.write(LEFT, joints(q_rad))

    def leave(self) -> None:
        """End the node."""
        if self._node is not None:
            self._node.close()
            self._node = None

    def close(self) -> None:
        """End the node and the host's bridge."""
        self.leave()
        if self._bridge is not None:
            self._bridge.terminate()
            with suppress(subprocess.TimeoutExpired):
                self._bridge.wait(5.0)
            self._bridge.kill()
            self._bridge.wait()


@pytest.fixture(params=["robot", "host"])
def elsewhere(system: System, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[Elsewhere]:
    """Somebody at the robot's own side, or behind a host bridge."""
    made = Elsewhere(request.param, system, monkeypatch)
    yield made
    made.close()


def refusal(action: Callable[[], object]) -> GatewayError:
    """Return why an action was refused."""
    with pytest.raises(GatewayError) as caught:
        action()
    return caught.value


def ours(system: System, watcher: Robot) -> int:
    """Return how many setpoints of the left arm this gateway has sent."""
    return watcher.state.view.streams[LEFT].sent


def test_an_announcement_stops_us_before_its_first_sample_and_is_named(system: System, elsewhere: Elsewhere) -> None:
    """The bridge's token comes first: brake and hold, latched, who it is; gone again, recovery and enabling work."""
    with system.connect("watcher") as watcher:
        system.client("owner", OWNER)
        moving(system, watcher)
        elsewhere.appear()
        wait_for(lambda: Code.FOREIGN_WRITER.value in watcher.state.latches, "the latch", 10.0)
        wait_for(lambda: watcher.state.state == "HOLDING" and system.is_still(), "a hold", 3.0)
        assert system.robot_state()["fsm"] == 2, "nobody writes yet: the arms stay under torque"
        (seen,) = [other for other in watcher.state.others.seen if other.topic == LEFT]
        assert (seen.kind, seen.count) == ("token", 0)
        words = watcher.state.latches[Code.FOREIGN_WRITER.value]
        assert seen.zid in words
        if elsewhere.side == "host":
            assert seen.link.startswith("tcp/127.0.0.1:"), "a host is told with its address"
        else:
            assert seen.zid == watcher.state.link.router_zid and "the robot's own bridge" in words
        assert refusal(watcher.recover).code is Code.LATCH_PERSISTS
        elsewhere.leave()
        wait_for(lambda: not watcher.state.others.seen, "nobody else", 15.0)
        watcher.recover()
        wait_for(lambda: not watcher.state.latches, "no latch", 2.0)


def test_nobody_can_enable_while_somebody_announces_setpoints(system: System, elsewhere: Elsewhere) -> None:
    """A condition, no latch, while nothing of ours runs: it ends when he leaves."""
    with system.connect("owner") as robot, robot.control() as own:
        elsewhere.appear()
        wait_for(lambda: [other for other in robot.state.others.seen if other.topic == LEFT], "somebody else", 10.0)
        assert refusal(lambda: own.enable(timeout=10.0)).code is Code.FOREIGN_WRITER
        assert not robot.state.latches
        elsewhere.leave()
        wait_for(lambda: not robot.state.others.seen, "nobody else", 15.0)
        own.enable(timeout=15.0)


def test_setpoints_of_somebody_else_end_ours_at_once(system: System, elsewhere: Elsewhere) -> None:
    """0.0 once and silence, never two in turn; his setpoints go on alone, and the latch says whose they are."""
    with system.connect("watcher") as watcher:
        system.client("owner", OWNER)
        moving(system, watcher)
        elsewhere.appear()
        here = [float(q) for q in watcher.state.left_arm.q]

        def is_seen() -> bool:
            elsewhere.write(here)
            time.sleep(0.01)  # his rate
            return any(other.kind == "data" for other in watcher.state.others.seen)

        wait_for(is_seen, "his data", 10.0)
        wait_for(lambda: watcher.state.state == "IDLE", f"IDLE, not {watcher.state.state}", 2.0)
        assert Code.FOREIGN_WRITER.value in watcher.state.latches
        before = ours(system, watcher)
        his = system.count(LEFT)
        for _ in range(100):
            elsewhere.write(here)
            time.sleep(0.01)
        assert ours(system, watcher) == before
        assert system.count(LEFT) - his >= 90, "only his arrive"


POISON = {
    "nothing": b"",
    "one byte": b"\x00",
    "a garbage header": b"\xff\xff\xff\xff" + bytes(320),
    "a deletion": None,
}


@pytest.mark.parametrize("poison", POISON)
def test_bytes_that_stop_a_reader_for_half_a_second_end_our_motion_without_a_jump(system: System, poison: str) -> None:
    """A CycloneDDS reader stands still for 0.5 s after it (wire.md 3.2): what waits behind it must be no step."""
    payload = POISON[poison]
    config = {
        "mode": "client",
        "connect": {"endpoints": [system.endpoint]},
        "scouting": {"multicast": {"enabled": False}},
    }
    with system.connect("watcher") as watcher, zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
        system.client("owner", OWNER)
        moving(system, watcher)
        if payload is None:
            session.delete(LEFT.strip("/"))
        else:
            session.put(LEFT.strip("/"), payload)
        wait_for(lambda: Code.FOREIGN_WRITER.value in watcher.state.latches, "the latch", 3.0)
        wait_for(lambda: watcher.state.state == "IDLE", f"IDLE, not {watcher.state.state}", 2.0)
        wait_for(lambda: system.robot_state()["fsm"] == 0 and system.is_still(), "a paused robot at rest", 3.0)
        q, seq = system.arm_q(), watcher.state.seq
        wait_for(lambda: watcher.state.seq > seq + 50, "a second of snapshots")
        assert max(abs(a - b) for a, b in zip(q, system.arm_q(), strict=True)) < 0.01
        for side, arm in system.stats()["arms"].items():
            assert max(arm["commanded"]["peak_step_rad"]) < 0.01 and not arm["clips"], (side, arm)
            assert max(arm["moved"]["peak_radps"]) < 0.4, (side, arm)
