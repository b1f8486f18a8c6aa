"""`python -m tests.bench.host_node DOMAIN TOPIC ...`: a bare node that reads every state and publishes commands, and no more.

What a user writes who takes the robot's own way (§2.4): CycloneDDS for Python behind a host bridge. It has one loop of
100 Hz, which takes what has come as messages and publishes what is due: nothing is smoothed, checked or shown. It says
`ready` when every state has come.
"""

from __future__ import annotations

import sys
import time

from cdr_types import encode
from gateway.link.codec import to_message
from gateway.robot.limits import GRIPPER_RELAXED, HOME_Q_RAD
from gateway.robot.topics import FSM_ENABLE, TOPICS, gripper_command, joint_command
from gateway.sim.robot.manual import COMMAND_TOPICS, STATE_TOPICS
from gateway.values import Side, Vector
from tests.interop.dds_messages import DDS_TYPES
from tests.interop.dds_node import DdsNode

__all__ = ["HostNode", "main"]

LOOP_HZ = 100
VALUES: dict[str, Vector] = {
    FSM_ENABLE: (1.0,),
    **{joint_command(side): HOME_Q_RAD[side] for side in Side},
}
"""What it publishes; of all other topics zeros, but for the grippers, which are relaxed."""


class HostNode(DdsNode):
    """The node.

    Args:
        domain: DDS domain, beside a host bridge.
        topics: Commands that it publishes.
    """

    def __init__(self, domain: int, topics: list[str]) -> None:
        states = {topic: kind for topic, (kind, _) in STATE_TOPICS.items()}
        super().__init__("host", publishes={t: COMMAND_TOPICS[t] for t in topics}, subscribes=states, domain=domain)
        self._streams = []
        for topic in topics:
            row = TOPICS[topic]
            rest = GRIPPER_RELAXED if topic in map(gripper_command, Side) else 0.0
            values = VALUES.get(topic, (rest,) * row.width)
            message = DDS_TYPES[COMMAND_TOPICS[topic]].deserialize(encode(to_message(topic, values, time.time_ns())))
            self._streams.append((self._writers[topic], message, round(LOOP_HZ / row.rate_hz)))
        self._joints = [message for _, message, _ in self._streams if hasattr(message, "header")]

    def take(self) -> set[str]:
        """Take what has come, as messages; return the topics."""
        return {topic for topic, reader in self._readers.items() if reader.take(64)}

    def publish(self, tick: int) -> None:
        """Publish what is due in a tick, with the time."""
        sec, nanosec = divmod(time.time_ns(), 10**9)
        for message in self._joints:
            message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
        for writer, message, every in self._streams:
            if tick % every == 0:
                writer.write(message)

    def _take_all(self) -> None:
        """Leave it to `take`: a thread that wakes for each sample costs more."""


def main(arguments: list[str]) -> None:
    """Run until ended."""
    node = HostNode(int(arguments[0]), arguments[1:])
    missing = set(STATE_TOPICS)
    tick = time.monotonic_ns() * LOOP_HZ // 10**9
    while True:
        tick += 1
        rest_ns = tick * 10**9 // LOOP_HZ - time.monotonic_ns()
        if rest_ns > 0:
            time.sleep(rest_ns / 1e9)
        taken = node.take()
        if missing:
            missing -= taken
            if not missing:
                print("ready", flush=True)
        node.publish(tick)


if __name__ == "__main__":
    main(sys.argv[1:])
