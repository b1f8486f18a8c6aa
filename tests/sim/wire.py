"""What the end-to-end tests of the simulated robot share: a process, a user's session, and waiting with a deadline."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator

import zenoh
from pycdr2 import IdlStruct

from cdr_types import decode, encode
from cdr_types.keys import topic_to_key
from cdr_types.registry import message_type
from gateway.sim.robot.manual import STATE_TOPICS
from tests.sim.drivers import Node


def until(condition: Callable[[], object], timeout_s: float = 10.0, pump: Callable[[], None] = lambda: None) -> None:
    """Wait until a condition holds; fail when it does not in time."""
    end = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        pump()
        time.sleep(0.002)


def user_session(endpoint: str) -> zenoh.Session:
    """A client session that comes back quickly after the router was away."""
    config = {
        "mode": "client",
        "connect": {
            "endpoints": [endpoint],
            "timeout_ms": 5000,
            "exit_on_failure": True,
            "retry": {"period_init_ms": 50, "period_max_ms": 100, "period_increase_factor": 1.5},
        },
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {"shared_memory": {"enabled": False}},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


class User:
    """Subscribes to state topics and publishes commands, as a ROS node behind a host bridge would."""

    def __init__(self, endpoint: str, topics=tuple(STATE_TOPICS)) -> None:
        self.session = user_session(endpoint)
        self.arrived: deque[tuple[str, bytes]] = deque()
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._subscribers = {topic: self.subscribe(topic) for topic in topics}

    def subscribe(self, topic: str) -> zenoh.Subscriber:
        """Listen to a topic."""

        def take(sample: zenoh.Sample) -> None:
            self.arrived.append((topic, sample.payload.to_bytes()))

        return self.session.declare_subscriber(topic_to_key(topic), zenoh.handlers.Callback(take, indirect=False))

    def resubscribe(self, topic: str) -> None:
        """Undeclare and declare anew."""
        self._subscribers[topic].undeclare()
        self._subscribers[topic] = self.subscribe(topic)

    def messages(self) -> list[tuple[str, IdlStruct]]:
        """Take out what has arrived, decoded."""
        out = []
        while self.arrived:
            topic, payload = self.arrived.popleft()
            out.append((topic, decode(payload, message_type(STATE_TOPICS[topic][0]))))
        return out

    def put(self, topic: str, message: IdlStruct | bytes) -> None:
        """Publish a command, or any bytes."""
        if topic not in self._publishers:
            self._publishers[topic] = self.session.declare_publisher(topic_to_key(topic))
        self._publishers[topic].put(message if isinstance(message, bytes) else encode(message))

    def play(self, node: Node, limit_s: float) -> float:
        """Run an example against the robot until it is done or the time is up; return how long it took [s]."""
        begin = time.monotonic()
        while not node.is_done and time.monotonic() - begin < limit_s:
            out = [sent for topic, message in self.messages() for sent in node.take(topic, message)]
            for topic, message in out + node.tick(time.monotonic_ns()):
                self.put(topic, message)
            time.sleep(0.001)
        for topic, message in node.last_words():
            self.put(topic, message)
        return time.monotonic() - begin

    def close(self) -> None:
        """End the session."""
        self.session.close()


@contextlib.contextmanager
def sim_process(endpoint: str, *arguments: str) -> Iterator[subprocess.Popen]:
    """Run `ta2 sim` until the block ends; it must end by SIGTERM with exit code 0."""
    command = [sys.executable, "-m", "gateway.cli", "sim", "--listen", endpoint, *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == f"listening on {endpoint}\n"
            yield process
            process.terminate()
            assert process.wait(10.0) == 0
        finally:
            if process.poll() is None:
                process.kill()
