"""Random commands through the whole gateway and a real bridge, judged where they arrive: by a node on the robot's own DDS."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from tests.interop.bridge_process import demand

demand(module=True)

from cdr_types.messages import geometry_msgs, sensor_msgs, std_msgs
from gateway.sim.robot.manual import (
    CHASSIS_CMD,
    FSM_ENABLE,
    LIFT_CMD,
    LOWER_RAD,
    UPPER_RAD,
    Side,
    command_topics,
    gripper_cmd_topic,
    joint_cmd_topic,
    joint_names,
)
from tests.e2e.system import Process, System, wait_for
from tests.interop.dds_node import BadPayload, DdsNode, loopback
from tests.thoroughness import either

pytestmark = [pytest.mark.e2e, pytest.mark.interop, pytest.mark.slow, pytest.mark.timeout(900)]

COMMANDS = either(4_000, 100_000)
CONFIG = '[robot]\nmodel = "lift"\n[guard]\nenabled = false\n'
"""On a machine that stood still for 80 ms the guard would rightly end the daemon, and the test with it."""

TOPICS = command_topics(has_lift=True)
JOINTS = {joint_cmd_topic(side): side for side in Side}
GRIPPERS = {gripper_cmd_topic(side) for side in Side}
CHASSIS_LIMITS = (0.5, 0.5, 1.0)
"""The hard bounds of the gateway [m/s, m/s, rad/s]."""


def within(values: Sequence[float], low: Sequence[float], high: Sequence[float]) -> bool:
    """Return whether all values are finite and inside their bounds; those of float32 may be rounded."""
    return len(values) == len(low) and all(
        math.isfinite(value) and a - 1e-6 <= value <= b + 1e-6 for value, a, b in zip(values, low, high, strict=True)
    )


def fault_of(topic: str, message: object) -> str:
    """Return what is wrong with a command that reached the robot; empty when nothing is."""
    if topic in JOINTS:
        assert isinstance(message, sensor_msgs.JointState)
        side = JOINTS[topic]
        if not within(message.position, LOWER_RAD[side], UPPER_RAD[side]):
            return f"positions {message.position}"
        others = [*message.velocity, *message.effort]
        return "" if tuple(message.name) == joint_names(side) and all(map(math.isfinite, others)) else repr(message)
    if isinstance(message, std_msgs.Float32):
        if topic == FSM_ENABLE:
            return "" if message.data in (0.0, 1.0) else f"heartbeat {message.data}"
        return "" if topic in GRIPPERS and within([message.data], [0.0], [1.0]) else f"force {message.data}"
    if isinstance(message, std_msgs.Float32MultiArray) and topic == CHASSIS_CMD:
        bad = not within(message.data, [-limit for limit in CHASSIS_LIMITS], CHASSIS_LIMITS)
        return f"velocity {message.data}" if bad else ""
    if isinstance(message, std_msgs.Float32MultiArray) and topic == LIFT_CMD:
        good = within(message.data, (-1.0, 0.0), (1.0, 1.0)) and message.data[1] in (0.0, 1.0)
        return "" if good else f"lift {message.data}"
    assert isinstance(message, geometry_msgs.Pose)
    return "a pose for an arm in joint mode"


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[System]:
    """A lift robot on DDS behind a real bridge, and a daemon."""
    monkeypatch.setattr(System, "kind", "dds")
    made = System(tmp_path, sim_options=("--model", "lift"), config=CONFIG)
    yield made
    made.close()


def test_whatever_is_commanded_what_arrives_on_dds_is_decodable_finite_and_inside_the_limits(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hundred thousand commands before a release: every sample of every command topic is judged as it arrives."""
    system.connect("first").close()
    monkeypatch.setenv("CYCLONEDDS_URI", loopback(system.graph))
    listener = DdsNode("listener", publishes={}, subscribes=TOPICS)
    arrived: Counter[str] = Counter()
    faults: list[str] = []

    def judge() -> None:
        while listener.arrivals:
            arrival = listener.arrivals.popleft()
            arrived[arrival.topic] += 1
            assert arrival.payload is not None
            try:
                fault = fault_of(arrival.topic, DdsNode.read(TOPICS[arrival.topic], arrival.payload))
            except BadPayload as error:
                fault = f"{error}: {arrival.payload.hex()}"
            if fault:
                faults.append(f"{arrival.topic}: {fault}")

    words = ["-u", "-m", "tests.interop.commander", system.target, "11", str(COMMANDS)]
    commander = Process("commander", words, system.folder)
    system.clients.append(commander)
    try:

        def is_over() -> bool:
            judge()
            return not commander.is_running

        wait_for(is_over, "the end of the commands", 800.0)
        judge()
    finally:
        listener.close()
    assert commander.wait() == 0, commander.text()[-3000:]
    done = json.loads(commander.text().rsplit("DONE ", 1)[1])
    print(f"\ndone {dict(sorted(done.items()))}\narrived {dict(arrived)}")
    print(f"arms {system.stats()['arms']}\ncounts {system.stats()['counts']}")
    assert not faults, faults[:10]
    assert sum(done.values()) >= COMMANDS and "no reply" not in done and "never answered" not in done, done
    assert min(done.get(kind, 0) for kind in ("move", "open_stream", "target", "set_gripper", "drive_chassis")) > 0, (
        done
    )
    quiet = {topic for topic in TOPICS if "target_pose" not in topic} - arrived.keys()
    assert not quiet, f"nothing ever arrived on {quiet}: {done}"
    counts = system.stats()["counts"]
    assert not counts.keys() & {"INVALID_CDR", "NOT_A_COMMAND", "CLIPPED", "ENABLE_VALUE", "WRONG_MODE"}, counts
    assert system.daemon.is_running and "Traceback" not in system.daemon.text()
