"""The simulated robot behind a real bridge: its pure model as a node of ROS 2 shape on a DDS graph of its own.

`python -m tests.interop.dds_robot --listen ENDPOINT --control ENDPOINT --folder FOLDER` is to a gateway what a robot
is: a bridge listens on the endpoint, and behind it lives a node with the manual's topics, types, rates and QoS, whose
messages CycloneDDS writes and reads. The channel over which tests ask and disturb it lies beside the wire, at the
second endpoint. Robot and bridge form one process group: a signal to the group hits the robot's computer.

What the simulated bridge has and this one cannot have is refused: the fault `route_dead` is a switch inside it.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections import deque
from collections.abc import Container
from pathlib import Path
from typing import Final

import zenoh
from pycdr2 import IdlStruct

from gateway.cli.command_line.arguments import parse
from gateway.sim.bridge import CONTROL_KEY, bridge_config
from gateway.sim.node import SimNode, main_sim
from gateway.sim.robot.faults import Fault, FaultError
from gateway.sim.robot.manual import STATE_TOPICS
from gateway.sim.robot.settings import SimSettings, settings_of
from gateway.sim.wire import Arrival
from tests.interop.bridge_process import bridge_settings, start_bridge
from tests.interop.dds_node import ROBOT_DOMAIN, DdsNode

__all__ = ["DdsRobot", "main"]

NODE_NAME: Final = "ta2"


class DdsWire:
    """The robot's node on DDS and a life of the bridge before it.

    Args:
        robot: Whose node and control channel these are.
        bridge: The bridge; None when it is somebody else's.
    """

    def __init__(self, robot: DdsRobot, bridge: subprocess.Popen[bytes] | None) -> None:
        self._robot, self._bridge = robot, bridge
        self.queries = robot.queries

    @property
    def arrivals(self) -> deque[Arrival]:
        """Samples on command topics, oldest first."""
        node = self._robot.node
        return deque() if node is None else node.arrivals

    def wanted(self) -> Container[str]:
        """Return all state topics: a node publishes whether or not somebody listens."""
        return () if self._robot.node is None else STATE_TOPICS

    def publish(self, topic: str, message: IdlStruct) -> None:
        """Write a message of a state topic to DDS."""
        if self._robot.node is not None:
            self._robot.node.write(topic, message)

    def read(self, topic: str, payload: bytes) -> IdlStruct:
        """Return the message of a command sample, as CycloneDDS reads it."""
        return self._robot.read(topic, payload)

    def answer(self, query: zenoh.Query) -> None:
        """Nothing but the control channel is asked here: the bridge answers for itself."""

    def set_dead(self, topic: str, *, is_dead: bool) -> None:
        """A real bridge has no such switch; `DdsRobot.begin` has refused it."""

    def retire(self) -> None:
        """The node leaves the graph in good order."""
        self._robot.leave()

    def announce(self) -> None:
        """The node comes back."""
        self._robot.join()

    def companions(self) -> tuple[int, ...]:
        """Return the bridge's process."""
        return () if self._bridge is None else (self._bridge.pid,)

    def close(self) -> None:
        """End the bridge; the node stays on its graph."""
        if self._bridge is not None and self._bridge.poll() is None:
            self._bridge.terminate()
            try:
                self._bridge.wait(5.0)
            except subprocess.TimeoutExpired:
                self._bridge.kill()
                self._bridge.wait()


class DdsRobot(SimNode):
    """A robot whose wire is DDS and a real bridge.

    Attributes:
        node: Its node; None while a fault keeps it away.
        queries: Questions on the control channel.
    """

    def __init__(
        self, settings: SimSettings, listen: str, *, control: str, folder: Path, has_bridge: bool = True
    ) -> None:
        """Join the graph and start the bridge.

        Args:
            settings: What to simulate.
            listen: Endpoint of the bridge.
            control: Endpoint of the control channel.
            folder: For configuration and log of the bridge.
            has_bridge: Whether to start the bridge; it may have been started by somebody else, and outlive the node.
        """
        self._folder, self._has_bridge = folder, has_bridge
        self.node: DdsNode | None = None
        self.queries: deque[zenoh.Query] = deque()
        self._session = zenoh.open(bridge_config(control))
        take = zenoh.handlers.Callback(self.queries.append, indirect=False)
        self._queryable = self._session.declare_queryable(CONTROL_KEY, take, complete=True)
        super().__init__(settings, listen)

    def _open(self) -> DdsWire:
        self.join()
        if not self._has_bridge:
            return DdsWire(self, None)
        settings = bridge_settings(self._listen, domain=ROBOT_DOMAIN, namespace=f"/{self._namespace.strip('/')}")
        return DdsWire(self, start_bridge(settings, self._folder))

    def join(self) -> None:
        """Let the node join the graph, if it is away."""
        if self.node is None:
            self.node = DdsNode(
                NODE_NAME, publishes=self.robot.states, subscribes=self.robot.commands, clock=self._clock
            )

    def leave(self) -> None:
        """Let the node leave the graph."""
        if self.node is not None:
            self.node.close()
            self.node = None

    def read(self, topic: str, payload: bytes) -> IdlStruct:
        """Return the message of a command sample, as CycloneDDS reads it.

        Raises:
            ValueError: If it cannot.
        """
        return DdsNode.read(self.robot.commands[topic], payload)

    def begin(self, fault: Fault, now_ns: int) -> None:
        """Let a node fault act; a real bridge has no switch that kills its readers.

        Raises:
            FaultError: If the fault needs one.
        """
        if fault.name == "route_dead":
            raise FaultError("fault route_dead: a real bridge has no such switch")
        super().begin(fault, now_ns)

    def close(self) -> None:
        """End bridge, node and control channel; safe to call twice."""
        super().close()
        self.leave()
        if not self._session.is_closed():
            self._session.close()


def main(arguments: list[str] | None = None) -> int:
    """Run the robot until SIGTERM; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.interop.dds_robot", description="All else as for `ta2 sim`.", allow_abbrev=False
    )
    parser.add_argument("--control", required=True, help="endpoint of the control channel")
    parser.add_argument("--folder", required=True, type=Path, help="for configuration and log of the bridge")
    parser.add_argument("--no-bridge", action="store_true", help="there is one already")
    options, words = parser.parse_known_args(arguments)
    sim = parse(["sim", *words])

    def make(settings: SimSettings, listen: str) -> SimNode:
        return DdsRobot(
            settings, listen, control=options.control, folder=options.folder, has_bridge=not options.no_bridge
        )

    return main_sim(sim.listen, settings_of(sim), make=make)


if __name__ == "__main__":
    sys.exit(main())
