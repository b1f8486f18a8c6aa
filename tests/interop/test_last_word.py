"""A robot's node dies under our 1.0 and starts anew behind the same bridge: what it is handed, and what it does then.

A bridge keeps the newest sample of each command for readers that it has not missed yet. What a node that comes back gets
of it must not start the robot; `docs/stopping.md` says what cannot be prevented.
"""

from __future__ import annotations

import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.interop.bridge_process import bridge_settings, demand, start_bridge

demand(module=True)

from tests.e2e.system import Process, System, free_port, run_apart, wait_for
from tests.interop.dds_node import ROBOT_DOMAIN, loopback

pytestmark = [pytest.mark.e2e, pytest.mark.interop]

SHORT_S = 1.0
"""So long after its last state a robot may be back in a short stall, or before ten samples of 0.0 were sent [s]."""
WATCHED_S = 3.2
"""A node that comes back is watched so long [s]: discovery takes a tenth of a second, at times three seconds."""

OWNER = """
from gateway.errors import GatewayError
with robot.control(on_loss='hold') as own:
    while True:
        try:
            own.enable(timeout=15.0)
            break
        except GatewayError as error:  # the machine is busy
            print(error, flush=True)
            time.sleep(0.2)
    print("enabled", flush=True)
    time.sleep(60.0)
"""


class Renewed(System):
    """A robot whose bridge outlives its nodes."""

    kind = "dds"

    def start_sim(self) -> Process:
        """Start the bridge, the node, and the one that will follow it."""
        graph = loopback(self.graph)
        settings = bridge_settings(self.endpoint, domain=ROBOT_DOMAIN)
        self.bridge: subprocess.Popen[bytes] = start_bridge(settings, self.folder, loopback=graph)
        self.next_control = f"tcp/127.0.0.1:{free_port()}"
        first = self._node("sim", self.control_endpoint, graph)
        self.next = self._node("next", self.next_control, graph)
        self.let("sim")
        return first

    def _node(self, name: str, control: str, graph: str) -> Process:
        places = ["--listen", self.endpoint, "--control", control, "--folder", str(self.folder)]
        arguments = ["-m", "tests.interop.watched_robot", *places, "--go", str(self.folder / f"{name}.go")]
        return Process(name, arguments, self.folder, {"CYCLONEDDS_URI": graph})

    def let(self, name: str) -> None:
        """Let a node join."""
        (self.folder / f"{name}.go").touch()

    def close(self) -> None:
        """End everything."""
        super().close()
        self.next.end()
        self.bridge.kill()
        self.bridge.wait()


@pytest.fixture
def renewed(tmp_path: Path) -> Iterator[Renewed]:
    """A robot that an owner holds enabled, with a node that waits to follow the one of now."""
    system = Renewed(tmp_path, has_guard=False)
    try:
        wait_for(
            lambda: "joined" in system.sim.text() and "waiting" in system.next.text(), "both nodes", tell=system.logs
        )
        for pid in (system.bridge.pid, system.sim.pid, system.next.pid):
            run_apart(pid)
        with system.connect() as robot:
            owner = system.client("owner", OWNER)
            wait_for(lambda: "enabled" in owner.text(), "an enabled robot", tell=system.logs)
            held = {"ACTIVE", "HOLDING"}
            wait_for(lambda: robot.state.state in held and "fsm 2" in system.sim.text(), "READY", tell=system.logs)
        yield system
    finally:
        system.close()


@pytest.mark.parametrize("away_s", [0.3, 1.0, 2.0, 5.0])
def test_a_robots_node_that_starts_anew_is_not_started_by_what_its_bridge_kept(renewed: Renewed, away_s: float) -> None:
    """No 1.0 and no FSM but PAUSE; back within the time of a short stall it may be handed one, and pauses again by itself."""
    renewed.sim.send(signal.SIGKILL)
    died = time.monotonic()
    wait_for(lambda: time.monotonic() - died >= away_s, "its absence")
    renewed.let("next")
    wait_for(lambda: "joined" in renewed.next.text(), "the next node")
    told = [line.split(maxsplit=2) for line in renewed.next.text().splitlines() if line[:1].isdigit()]
    joined = next(float(value) for _, what, value in told if what == "joined")
    wait_for(lambda: time.monotonic() - joined >= WATCHED_S, "what it is handed")
    lines = [line.split(maxsplit=2) for line in renewed.next.text().splitlines() if line[:1].isdigit()]
    said = [(float(at_s), what, "".join(value)) for at_s, what, *value in lines]
    beats = [float(value) for _, what, value in said if what == "heartbeat"]
    fsm = [int(value) for _, what, value in said if what == "fsm"]
    print(
        f"\naway {joined - died:.2f} s:", *[f"{at_s:.2f} {what} {value}" for at_s, what, value in said][:12], sep="\n  "
    )
    assert fsm, "it never lived"
    assert fsm[-1] == 0
    if joined - died > SHORT_S:
        assert 1.0 not in beats and set(fsm) == {0}, said
