"""A robot in pieces, for faults of the pieces: its bridge, its node, a host bridge with a ROS node behind it, and who hears it.

Each piece is started, killed and started again by itself; all of them end with the robot.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
import zenoh

from gateway.core.messages.events import RouteObserved, SampleArrived
from gateway.link.robot_link import RobotLink
from gateway.robot import topics
from gateway.settings.settings import LinkSettings
from gateway.sim.remote import SimControl
from gateway.sim.robot.manual import STATE_TOPICS
from tests.e2e.system import Process, free_port, wait_for
from tests.interop.bridge_process import bridge_settings, start_bridge
from tests.interop.dds_node import ROBOT_DOMAIN, DdsNode, loopback
from tests.sim.wire import user_session

__all__ = ["Apart", "Ears", "Host"]

HOST_DOMAIN: Final = 31
LEASE_S: Final = 3.0
"""DDS lease on the robot and on the host; the ten seconds of CycloneDDS would only make the tests longer [s]."""

S = 1_000_000_000


class Ears:
    """Our link to a robot, heard in a thread of its own.

    Args:
        endpoint: Of the robot's router.
        has_tokens: Whether it holds our tokens; without, it is a link that only looks.
    """

    def __init__(self, endpoint: str, *, has_tokens: bool) -> None:
        self.link = RobotLink(LinkSettings(endpoint=endpoint), is_reader=not has_tokens)
        self.routes: list[RouteObserved] = []
        self.samples = dict.fromkeys(topics.STATE_TOPICS, 0)
        self.duplicates = dict.fromkeys(topics.STATE_TOPICS, 0)
        self._newest_ns: dict[str, int] = {}
        self._worst_ns: dict[str, int] = {}
        self._is_over = threading.Event()
        self.link.open()
        self._thread = threading.Thread(target=self._hear, daemon=True)
        self._thread.start()

    def _hear(self) -> None:
        while not self._is_over.wait(0.01):
            for event in self.link.poll():
                if isinstance(event, RouteObserved):
                    self.routes.append(event)
                elif isinstance(event, SampleArrived):
                    self._note(event)

    def _note(self, event: SampleArrived) -> None:
        topic = event.topic
        self.samples[topic] += event.count
        self.duplicates[topic] += event.duplicates
        if topic in self._newest_ns:
            gap_ns = event.received_ns - self._newest_ns[topic]
            self._worst_ns[topic] = max(self._worst_ns.get(topic, 0), gap_ns)
        self._newest_ns[topic] = event.received_ns

    def mark(self) -> None:
        """Count gaps, duplicates and observations from now on."""
        self.routes = []
        self._worst_ns = {}
        self.duplicates = dict.fromkeys(self.duplicates, 0)
        self.samples = dict.fromkeys(self.samples, 0)

    def age_s(self, topic: str) -> float:
        """Return how old the newest sample is [s]; infinite before the first."""
        newest_ns = self._newest_ns.get(topic)
        return float("inf") if newest_ns is None else (time.monotonic_ns() - newest_ns) / S

    def worst_s(self, topic: str) -> float:
        """Return the longest silence since the mark, one that lasts included [s]."""
        return max(self._worst_ns.get(topic, 0) / S, self.age_s(topic))

    def codes(self, topic: str) -> list[str]:
        """Return what was observed of a topic's route: codes, empty where it is well again."""
        return ["" if seen.code is None else seen.code.value for seen in list(self.routes) if seen.topic == topic]

    def told(self, topic: str) -> list[tuple[str, str]]:
        """Return message and code of all observations that name a topic."""
        return [
            (seen.message, "" if seen.code is None else seen.code.value)
            for seen in list(self.routes)
            if topic in seen.message
        ]

    def close(self) -> None:
        """End the link."""
        self._is_over.set()
        self._thread.join()
        assert self.link.close()


class Host:
    """A ROS host as the manual has it (§2.4): a bridge that connects to the robot, and a node behind it that listens.

    Args:
        endpoint: Of the robot's router.
        folder: For the bridge's files.
        topic: What the node listens to.
    """

    def __init__(self, endpoint: str, folder: Path, topic: str) -> None:
        graph = loopback(f"host-{os.getpid()}-{free_port()}", LEASE_S)
        settings = bridge_settings("", domain=HOST_DOMAIN, connect=(endpoint,))
        self.bridge = start_bridge(settings, folder, name="host", loopback=graph)
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("CYCLONEDDS_URI", graph)
            self.node = DdsNode("echo", publishes={}, subscribes={topic: STATE_TOPICS[topic][0]}, domain=HOST_DOMAIN)

    def hears(self) -> bool:
        """Return whether something has arrived at its node."""
        return len(self.node.arrivals) > 10

    def kill(self) -> None:
        """Switch the host's bridge off."""
        self.bridge.send_signal(signal.SIGKILL)
        self.bridge.wait()

    def close(self) -> None:
        """End both."""
        self.node.close()
        if self.bridge.poll() is None:
            self.bridge.terminate()
            self.bridge.wait()


class Apart:
    """A robot whose bridge and node live and die by themselves.

    Args:
        folder: For configurations and logs.
        lease_s: DDS lease on the robot [s].
    """

    def __init__(self, folder: Path, lease_s: float = LEASE_S) -> None:
        self.folder = folder
        self._port = free_port()
        self.endpoint = f"tcp/127.0.0.1:{self._port}"
        self._graph = loopback(f"apart-{os.getpid()}-{self._port}", lease_s)
        self._bridge: subprocess.Popen[bytes] | None = None
        self._node: Process | None = None
        self._control_endpoint = ""
        self._ends = contextlib.ExitStack()
        self.start_bridge()
        self.start_node()

    def start_bridge(self) -> None:
        """Start the bridge."""
        settings = bridge_settings(self.endpoint, domain=ROBOT_DOMAIN)
        self._bridge = start_bridge(settings, self.folder, loopback=self._graph)

    def kill_bridge(self) -> None:
        """Kill the bridge."""
        assert self._bridge is not None
        self._bridge.kill()
        self._bridge.wait()

    def start_node(self) -> None:
        """Start the node."""
        self._control_endpoint = f"tcp/127.0.0.1:{free_port()}"
        places = ("--listen", self.endpoint, "--control", self._control_endpoint, "--folder", str(self.folder))
        words = ["-m", "tests.interop.dds_robot", *places, "--no-bridge"]
        self._node = Process("node", words, self.folder, {"CYCLONEDDS_URI": self._graph})

    def end_node(self, number: int = signal.SIGTERM) -> None:
        """Let the node end: in an orderly way, or killed."""
        assert self._node is not None
        self._node.send(number)
        self._node.wait()

    @contextlib.contextmanager
    def control(self) -> Iterator[SimControl]:
        """Give the control channel of the node of now."""
        control = wait_for(lambda: SimControl(self._control_endpoint), "the node")
        try:
            wait_for(lambda: control.ask("ping"), "its first answer")
            yield control
        finally:
            control.close()

    def host(self, topic: str) -> Host:
        """Start a ROS host; it ends with the robot."""
        host = Host(self.endpoint, self.folder, topic)
        self._ends.callback(host.close)
        return host

    def ears(self, *, has_tokens: bool) -> Ears:
        """Start hearing; it ends with the robot."""
        ears = Ears(self.endpoint, has_tokens=has_tokens)
        self._ends.callback(ears.close)
        return ears

    def session(self) -> zenoh.Session:
        """Return a zenoh session of somebody; it ends with the robot."""
        session = wait_for(self._opened, "the robot's router")
        self._ends.callback(session.close)
        return session

    def _opened(self) -> zenoh.Session | None:
        try:
            return user_session(self.endpoint)
        except zenoh.ZError:
            return None

    def close(self) -> None:
        """End everything."""
        self._ends.close()
        if self._node is not None:
            self._node.end()
        if self._bridge is not None and self._bridge.poll() is None:
            self._bridge.kill()
            self._bridge.wait()
