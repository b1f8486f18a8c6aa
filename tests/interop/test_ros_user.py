"""The simulated robot as a robot for people who have ROS: a real host bridge connects to it, and their nodes see a robot.

The other way round than the DDS robot: `gateway.sim` acts the robot's router and bridge, the plugin on the user's side is
the public one, and behind it are nodes of Humble's shape in a DDS domain that is not the robot's.
"""

from __future__ import annotations

import json
import os
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.interop.bridge_process import demand

demand(module=True)

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import Policy
from cyclonedds.domain import DomainParticipant
from pycdr2 import IdlStruct

from gateway.client import connect
from gateway.link.surveyor import look
from gateway.settings.settings import LinkSettings
from gateway.sim.remote import SimControl
from gateway.sim.robot.manual import (
    COMMAND_TOPICS,
    CURRENT_MODE,
    EXAMPLE_HOME_RAD,
    FSM_STATE,
    MS,
    STATE_TOPICS,
    Fsm,
    Side,
    arm_state_topic,
    command_topics,
    joint_cmd_topic,
)
from tests.e2e.system import Process, free_port, wait_for
from tests.interop.bridge_process import bridge_settings, start_bridge
from tests.interop.dds_node import DdsNode, loopback
from tests.sim import drivers

pytestmark = [pytest.mark.e2e, pytest.mark.interop]

USER_DOMAIN = 42
"""Where the users' nodes are: any domain but the robot's."""
STATES = {topic: kind for topic, (kind, _) in STATE_TOPICS.items()}


@dataclass
class Host:
    """A user's computer beside a simulated robot.

    Attributes:
        control: The robot's own channel: what is true there.
        endpoint: Of the robot's router.
    """

    control: SimControl
    endpoint: str

    def node(self, name: str, publishes: dict[str, str], subscribes: dict[str, str]) -> DdsNode:
        """Return a node of the user's graph."""
        return DdsNode(name, publishes=publishes, subscribes=subscribes, domain=USER_DOMAIN)

    def state(self) -> dict[str, Any]:
        """Return the robot's true state."""
        return self.control.ask("state")

    def heard(self, topics: list[str]) -> bool:
        """Whether the robot has got a command on all of these."""
        commands = self.control.ask("stats")["commands"]
        assert isinstance(commands, dict)
        return all(topic in commands for topic in topics)


@pytest.fixture
def host(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[Host]:
    """A simulated robot, a host bridge connected to it (manual §2.4), and the way to make nodes behind that."""
    monkeypatch.setenv("CYCLONEDDS_URI", loopback(f"user-{os.getpid()}-{tmp_path.name}"))
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    options = getattr(request, "param", ())
    sim = Process("sim", ["-m", "gateway.cli", "sim", "--listen", endpoint, *options], tmp_path)
    bridge: subprocess.Popen[bytes] | None = None
    control: SimControl | None = None
    try:
        control = wait_for(lambda: SimControl(endpoint), "the simulated robot")
        bridge = start_bridge(bridge_settings("", domain=USER_DOMAIN, connect=(endpoint,)), tmp_path)
        yield Host(control, endpoint)
    finally:
        if bridge is not None:
            bridge.terminate()
            with suppress(subprocess.TimeoutExpired):
                bridge.wait(5.0)
            bridge.kill()
            bridge.wait()
        if control is not None:
            control.close()
        sim.end()


@pytest.fixture
def nodes(host: Host) -> Iterator[Callable[..., DdsNode]]:
    """Give a maker of nodes on the user's graph; all of them leave it with the test."""
    made: list[DdsNode] = []

    def make(name: str, publishes: dict[str, str], subscribes: dict[str, str]) -> DdsNode:
        made.append(host.node(name, publishes, subscribes))
        return made[-1]

    yield make
    for node in made:
        node.close()


def latest(node: DdsNode, kinds: dict[str, str]) -> dict[str, IdlStruct]:
    """Take what has arrived; return the newest message of each topic."""
    found = {}
    while node.arrivals:
        arrival = node.arrivals.popleft()
        found[arrival.topic] = arrival.payload
    return {topic: DdsNode.read(kinds[topic], payload) for topic, payload in found.items()}


def play(example: drivers.Node, node: DdsNode, kinds: dict[str, str], limit_s: float) -> None:
    """Run an example of the manual until it is done: its timers, and whatever arrives meanwhile."""
    end_s = time.monotonic() + limit_s
    while not example.is_done:
        assert time.monotonic() < end_s, "the example has not come to its end"
        for topic, message in latest(node, kinds).items():
            for answer in example.take(topic, message):
                node.write(*answer)
        for topic, message in example.tick(time.monotonic_ns()):
            node.write(topic, message)
        time.sleep(0.002)
    for topic, message in example.last_words():
        node.write(topic, message)


def test_a_ros_node_reads_every_state_of_the_simulated_robot(host: Host, nodes: Callable[..., DdsNode]) -> None:
    """All topics at their rates, as messages that CycloneDDS reads; the mode as the manual has it (§4.8, §4.11)."""
    node = nodes("reader", {}, STATES)
    count: Counter[str] = Counter()

    def everything() -> bool:
        while node.arrivals:
            count[node.arrivals.popleft().topic] += 1
        return all(count[topic] >= max(2, rate // 2) for topic, (_, rate) in STATE_TOPICS.items())

    wait_for(everything, f"half a second of each topic ({count})")
    found: dict[str, IdlStruct] = {}
    wait_for(lambda: found.update(latest(node, STATES)) or found.keys() == STATES.keys(), "a message of each topic")
    mode = json.loads(found[CURRENT_MODE].data)
    assert mode == host.state()["mode"] and found[FSM_STATE].data == Fsm.PAUSE
    for side in Side:
        arm = found[arm_state_topic(side)]
        assert arm.position == pytest.approx(host.state()["arms"][side.value]["q_rad"], abs=0.01)
        assert list(arm.name) == [f"{side.value[0]}_joint{n}" for n in range(1, 8)] and arm.header.stamp.sec > 0


def test_the_robots_topics_have_type_and_qos_of_the_manual_behind_the_bridge(
    host: Host, nodes: Callable[..., DdsNode]
) -> None:
    """What the bridge makes of our tokens: ROS type names, reliable, volatile (§4.1.1), writers and readers alike."""
    nodes("reader", {}, STATES)
    participant = DomainParticipant(USER_DOMAIN)
    reader = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
    seen: dict[str, Any] = {}

    def announced() -> bool:
        for sample in reader.take(64):
            if sample.sample_info.valid_data:
                seen[sample.topic_name.removeprefix("rt")] = sample
        return seen.keys() >= STATES.keys()

    wait_for(announced, "writers of all states")
    for topic, kind in STATES.items():
        package, _, name = kind.split("/")
        assert seen[topic].type_name == f"{package}::msg::dds_::{name}_"
        qos = seen[topic].qos
        assert isinstance(qos[Policy.Reliability], Policy.Reliability.Reliable)
        assert qos[Policy.Durability] == Policy.Durability.Volatile


def test_the_initial_position_example_moves_both_arms_through_the_bridge(
    host: Host, nodes: Callable[..., DdsNode]
) -> None:
    """The messages of §6.6, unchanged: both arms arrive, and the example's last word pauses the robot."""
    topics = {arm_state_topic(side): STATES[arm_state_topic(side)] for side in Side}
    commands = {joint_cmd_topic(side): COMMAND_TOPICS[joint_cmd_topic(side)] for side in Side}
    node = nodes("initial_position_demo", {**commands, "/api/fsm/enable": "std_msgs/msg/Float32"}, topics)
    play(drivers.InitialPosition(), node, topics, 60.0)
    arms = host.state()["arms"]
    for side in Side:
        assert arms[side.value]["q_rad"] == pytest.approx(EXAMPLE_HOME_RAD[side], abs=0.05)
    wait_for(lambda: host.state()["fsm"] == Fsm.PAUSE, "the pause")


def test_the_chassis_example_drives_and_stops_through_the_bridge(host: Host, nodes: Callable[..., DdsNode]) -> None:
    """§6.5: two seconds at 0.05 m/s need no FSM; then the chassis stands, some centimetres ahead."""
    kinds = {"/api/chassis/velocity": COMMAND_TOPICS["/api/chassis/velocity"]}
    node = nodes("chassis_velocity_api_publisher", kinds, {})
    wait_for(lambda: _writes(node, kinds) or host.heard(list(kinds)), "the way to the chassis")
    begin_m = host.state()["chassis"]["travel"][0]
    play(drivers.DriveChassis(), node, {}, 20.0)
    wait_for(lambda: max(map(abs, host.state()["chassis"]["velocity"])) < 1e-6, "a chassis that stands")
    assert 0.05 < host.state()["chassis"]["travel"][0] - begin_m < 0.15
    assert host.state()["fsm"] == Fsm.PAUSE


def _writes(node: DdsNode, kinds: dict[str, str]) -> bool:
    """Send zeros, which move nothing, so that it can be seen whether the way is open."""
    node.write("/api/chassis/velocity", drivers.std_msgs.Float32MultiArray(data=[0.0, 0.0, 0.0]))
    time.sleep(50 * MS / 1e9)
    return False


@pytest.mark.parametrize("host", [("--model", "lift")], indirect=True)
def test_a_user_of_the_host_bridge_is_seen_for_what_he_is(host: Host, nodes: Callable[..., DdsNode]) -> None:
    """A look at the wire names the bridge with version, address and domain, and what a node behind it announces."""
    kinds = command_topics(has_lift=True)
    nodes("operator", kinds, {arm_state_topic(Side.LEFT): STATES[arm_state_topic(Side.LEFT)]})

    def bridge() -> Any:
        wire = look(LinkSettings(endpoint=host.endpoint, model="lift"), is_named=False, listen_s=1.5)
        return next((who for who in wire.neighbours if who.kind == "bridge" and who.publishes), None) and wire

    wire = wait_for(bridge, "the host bridge", 60.0)
    (who,) = [who for who in wire.neighbours if who.kind == "bridge"]
    assert set(who.publishes) == set(kinds) and who.listens == (arm_state_topic(Side.LEFT),)
    assert who.address.startswith("tcp/127.0.0.1:") and who.whatami == "router"
    (facts,) = [bridge for bridge in wire.bridges if bridge.zid == who.zid]
    assert (facts.is_robot, facts.domain) == (False, USER_DOMAIN) and facts.version
    assert {topic.route for topic in wire.topics} == {"active"}


def test_a_host_that_only_looks_keeps_no_gateway_from_commanding(
    host: Host, nodes: Callable[..., DdsNode], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its bridge declares publishers for every command; only a ROS node that really writes one is a foreign writer."""
    monkeypatch.setenv("TA2_STATE_DIR", str(tmp_path / "state"))
    target = str(tmp_path / "gw.sock")
    arguments = ["-m", "gateway.cli", "run", "--robot", host.endpoint, "--socket", target, "--no-guard"]
    daemon = Process("daemon", arguments, tmp_path)
    try:
        nodes("viewer", {}, STATES)
        robot = wait_for(lambda: connect(target, name="beside a host", timeout_s=1.0), "the daemon")
        with robot:
            wait_for(lambda: robot.state.link.fresh and robot.state.mode is not None, "a live robot")
            wire = wait_for(lambda: _declared(robot.routes().wire), "the host bridge as the gateway sees it")
            time.sleep(3.0)  # the router has been asked meanwhile who publishes: twice a second
            (who,) = [who for who in robot.routes().wire.neighbours if who.kind == "bridge"]
            assert who.publishes == () and len(who.listens) == len(STATES) and wire.is_up
            with robot.control() as own:
                own.enable(timeout=15.0)
            node = nodes("writer", {"/api/chassis/velocity": COMMAND_TOPICS["/api/chassis/velocity"]}, {})
            found = wait_for(
                lambda: [f for f in robot.why().findings if f.code == "FOREIGN_WRITER"], "the writer before it writes"
            )
            assert who.zid in found[0].message and "/api/chassis/velocity" in found[0].message and not node.arrivals
    finally:
        daemon.end()


def _declared(wire: Any) -> Any:
    """Return a wire on which a host bridge is seen with all that is read behind it."""
    return (
        wire is not None
        and any(len(who.listens) == len(STATES) for who in wire.neighbours if who.kind == "bridge")
        and wire
    )
