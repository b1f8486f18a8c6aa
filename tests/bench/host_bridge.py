"""The peer that a user would pick: zenoh-bridge-ros2dds on his computer (§2.4) and a bare Python DDS node behind it.

It has a simulated robot of its own, whose states it reads and to which it sends what the gateway sends to its robot, in the
same seconds. Nothing of it smooths or checks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from gateway.sim.remote import SimControl
from tests.bench.processor import favour
from tests.bench.table import Row
from tests.e2e.system import Process, free_port, wait_for
from tests.interop.bridge_process import bridge_settings, lacking, start_bridge

__all__ = ["host_peer", "lacking_row"]

DOMAIN = 42
"""Of the user's graph: any but the robot's."""


def lacking_row(name: str) -> Row | None:
    """Return what to say instead of a figure where there is no bridge, or no CycloneDDS; None where all is there."""
    what = lacking()
    return Row(name=name, ours="", peer=f"not here: {what}") if what else None


@contextmanager
def host_peer(folder: Path, topics: list[str], pause: Callable[[float], None]) -> Iterator[dict[str, int]]:
    """Run robot, host bridge and node; gives the processes of the latter two by what they are called.

    Args:
        folder: For configuration and logs.
        topics: Commands that the node publishes, each at its nominal rate.
        pause: Lets time pass [s].
    """
    from tests.interop.dds_node import loopback  # CycloneDDS is not everywhere

    endpoint = f"tcp/127.0.0.1:{free_port()}"
    graph = loopback(f"bench-{endpoint.rpartition(':')[2]}")
    with ExitStack() as ending:
        sim = Process("host-sim", ["-m", "gateway.cli", "sim", "--listen", endpoint], folder)
        ending.callback(sim.end)
        control = wait_for(lambda: SimControl(endpoint), "the host's robot")
        ending.callback(control.close)
        favour(sim)
        bridge = start_bridge(
            bridge_settings("", domain=DOMAIN, connect=(endpoint,)), folder, name="host-bridge", loopback=graph
        )
        ending.callback(bridge.wait)
        ending.callback(bridge.kill)
        arguments = ["-u", "-m", "tests.bench.host_node", str(DOMAIN), *topics]
        node = Process("host-node", arguments, folder, {"CYCLONEDDS_URI": graph})
        ending.callback(node.end)
        wait_for(lambda: "ready" in node.text() or not node.is_running, "every state at the node", 60.0)
        assert node.is_running, node.text()
        wait_for(
            lambda: set(topics) <= set(control.ask("stats")["commands"]), "every command at the host's robot", 60.0
        )
        pause(1.0)
        control.ask("reset_stats")
        yield {"bridge": bridge.pid, "node": node.pid}
        heard = control.ask("stats")["commands"]
        assert all(heard[topic]["count"] for topic in topics), heard
