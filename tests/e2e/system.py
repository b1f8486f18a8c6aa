"""Real processes over loopback zenoh: the simulated robot, the daemon, clients, and a relay that can stall between them.

Nothing waits by sleeping for a time that hopes to be long enough: everything polls with a deadline. A bound on a gap is
judged only when a plain loop in a process of its own, beside the system, kept its period; see `steady`.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from gateway.client import Robot, connect
from gateway.errors import Disconnected
from gateway.sim.remote import SimControl, SimUnreachable

ROOT = Path(__file__).resolve().parents[2]
DEADLINE_S = 20.0

REFERENCE_LOOP = """
import signal, sys, time
worst, running = 0, True
def end(*_):
    global running
    running = False
signal.signal(signal.SIGTERM, end)
due = time.monotonic_ns()
print("ready", flush=True)
while running:
    due += 10_000_000
    rest = due - time.monotonic_ns()
    if rest > 0:
        time.sleep(rest / 1e9)
    late = time.monotonic_ns() - due
    worst = max(worst, late)
    due += max(late, 0) // 10_000_000 * 10_000_000
print(worst, flush=True)
"""
"""A plain loop with an absolute grid of 10 ms; says its worst lateness when it is ended."""

MACHINE_BOUND_MS = 30.0
"""A gap bound is judged only when the plain loop was never later than this [ms]."""


def free_port() -> int:
    """Return a TCP port of loopback that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for(is_so: Callable[[], Any], what: str, seconds: float = DEADLINE_S) -> Any:
    """Poll until something is so and return it; fail when it never is."""
    deadline = time.monotonic() + seconds
    while True:
        with contextlib.suppress(Disconnected, SimUnreachable):
            value = is_so()
            if value:
                return value
        if time.monotonic() > deadline:
            pytest.fail(f"{what}: not within {seconds} s")
        time.sleep(0.005)


class Process:
    """A child process whose output goes to a file.

    Args:
        name: For messages and the log's name.
        arguments: Of the interpreter.
        folder: Where the log goes.
        environment: Added to this process's own.
    """

    def __init__(
        self, name: str, arguments: list[str], folder: Path, environment: dict[str, str] | None = None
    ) -> None:
        self.name = name
        self.log = folder / f"{name}.log"
        with self.log.open("a") as stream:
            self._popen = subprocess.Popen(
                [sys.executable, *arguments],
                cwd=ROOT,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                env={**os.environ, **(environment or {})},
            )
        self.pid = self._popen.pid

    def text(self) -> str:
        """Return what it has written."""
        return self.log.read_text()

    def send(self, number: int) -> None:
        """Send it a signal."""
        self._popen.send_signal(number)

    def wait(self, seconds: float = DEADLINE_S) -> int:
        """Wait for its end and return its status."""
        return self._popen.wait(seconds)

    @property
    def is_running(self) -> bool:
        """Whether it has not ended."""
        return self._popen.poll() is None

    def end(self) -> None:
        """End it by all means."""
        if self.is_running:
            with contextlib.suppress(ProcessLookupError):
                self._popen.send_signal(signal.SIGCONT)
                self._popen.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._popen.wait(6.0)
        if self.is_running:
            self._popen.kill()
            self._popen.wait()


class Relay:
    """A TCP relay on loopback between daemon and robot that can stall and go on, or cut.

    Args:
        target: Port to relay to.
    """

    def __init__(self, target: int) -> None:
        self.port = free_port()
        self._target = target
        self._open = threading.Event()
        self._open.set()
        self._is_running = True
        self._sockets: list[socket.socket] = []
        self._listener = socket.create_server(("127.0.0.1", self.port))
        threading.Thread(target=self._accept, daemon=True).start()

    def stall(self) -> None:
        """Keep every byte from now on, both ways; connections stay open."""
        self._open.clear()

    def go_on(self) -> None:
        """Deliver what was kept, and go on."""
        self._open.set()

    def _accept(self) -> None:
        while self._is_running:
            try:
                near, _ = self._listener.accept()
                far = socket.create_connection(("127.0.0.1", self._target))
            except OSError:
                continue
            for end in (near, far):
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._sockets += [near, far]
            threading.Thread(target=self._pump, args=(near, far), daemon=True).start()
            threading.Thread(target=self._pump, args=(far, near), daemon=True).start()

    def _pump(self, source: socket.socket, sink: socket.socket) -> None:
        try:
            while data := source.recv(65536):
                self._open.wait()
                sink.sendall(data)
        except OSError:
            pass
        self._open.wait()  # an end is news too: it arrives after the stall
        for end in (source, sink):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """End the relay."""
        self._is_running = False
        self._open.set()
        self._listener.close()
        for end in self._sockets:
            end.close()


class System:
    """A simulated robot and a daemon, each a process.

    Args:
        folder: For sockets, state and logs.
        has_relay: Whether the daemon reaches the robot through a relay.
        config: Text of a configuration file for the daemon.
    """

    def __init__(self, folder: Path, *, has_relay: bool = False, config: str = "") -> None:
        self.folder = folder
        self.sim_port = free_port()
        self.endpoint = f"tcp/127.0.0.1:{self.sim_port}"
        self.target = str(folder / "gw.sock")
        self.config = folder / "config.toml"
        self.config.write_text(config)
        self.relay = Relay(self.sim_port) if has_relay else None
        self.robot_endpoint = f"tcp/127.0.0.1:{self.relay.port}" if self.relay else self.endpoint
        self.sim = self.start_sim()
        self.daemon = self.start_daemon()
        self.clients: list[Process] = []
        self._control: SimControl | None = None

    def start_sim(self) -> Process:
        """Start the simulated robot."""
        return Process("sim", ["-m", "gateway.sim", "--listen", self.endpoint], self.folder)

    def start_daemon(self) -> Process:
        """Start the daemon."""
        arguments = ["-m", "gateway.cli", "run", "--robot", self.robot_endpoint, "--socket", self.target]
        state = {"TA2_STATE_DIR": str(self.folder / "state")}
        return Process("daemon", [*arguments, "--config", str(self.config)], self.folder, state)

    def connect(self, name: str = "test") -> Robot:
        """Connect a client of this process, as soon as the daemon sees a live robot."""
        robot = wait_for(
            lambda: connect(self.target, name=name, timeout_s=1.0), f"a daemon ({self.daemon.text()[-800:]})"
        )
        wait_for(
            lambda: robot.state.link.fresh and robot.state.mode is not None,
            f"a live robot ({self.daemon.text()[-800:]})",
        )
        assert isinstance(robot, Robot)
        return robot

    def client(self, name: str, program: str) -> Process:
        """Start a client program; it finds `TARGET` and `robot` (connected) in its names."""
        text = (
            "import sys, time\nimport numpy as np\nfrom gateway.client import connect\nfrom gateway.robot import HOME_Q_RAD\n"
            "from gateway.values import Side\nHOME = {side.value: np.array(HOME_Q_RAD[side]) for side in Side}\n"
            f"TARGET = {self.target!r}\nrobot = connect(TARGET, name={name!r}, timeout_s=10.0)\n" + program
        )
        process = Process(name, ["-u", "-c", text], self.folder)
        self.clients.append(process)
        return process

    # ------------------------------------------------------------------------------------------------ the robot's view

    @property
    def control(self) -> SimControl:
        """The simulated robot's control channel; not through the relay."""
        if self._control is None:
            self._control = wait_for(lambda: SimControl(self.endpoint), "the simulated robot")
        return self._control

    def forget_control(self) -> None:
        """The robot's process ended: connect anew next time."""
        if self._control is not None:
            self._control.close()
            self._control = None

    def stats(self) -> dict[str, Any]:
        """Return what the robot saw of its users."""
        return self.control.ask("stats")

    def robot_state(self) -> dict[str, Any]:
        """Return the robot's true state."""
        return self.control.ask("state")

    def arm_q(self) -> list[float]:
        """Return the true positions of both arms [rad]."""
        arms = self.robot_state()["arms"]
        return [*arms["left"]["q_rad"], *arms["right"]["q_rad"]]

    def count(self, topic: str) -> int:
        """Return how many commands arrived on a topic."""
        return int(self.stats()["commands"].get(topic, {"count": 0})["count"])

    def close(self) -> None:
        """End everything that was started."""
        self.forget_control()
        for process in (*self.clients, self.daemon, self.sim):
            process.end()
        if self.relay is not None:
            self.relay.close()


@contextlib.contextmanager
def reference_loop(folder: Path) -> Iterator[Callable[[], float]]:
    """Run the plain loop beside the block; the function yields its worst lateness [ms] and ends it."""
    process = Process("reference", ["-u", "-c", REFERENCE_LOOP], folder)
    wait_for(lambda: "ready" in process.text(), "the reference loop")

    def worst_ms() -> float:
        process.send(signal.SIGTERM)
        process.wait()
        return int(process.text().split()[-1]) / 1e6

    try:
        yield worst_ms
    finally:
        process.end()


def steady(attempt: Callable[[Path], list[str]], folder: Path) -> None:
    """Judge gap bounds: run an attempt up to three times, until the machine was steady beside it.

    Args:
        attempt: Runs the system in a folder and returns the broken bounds, in words.
        folder: For all attempts.
    """
    history: list[str] = []
    for number in range(3):
        place = folder / f"attempt{number}"
        place.mkdir()
        with reference_loop(place) as worst_ms:
            broken = attempt(place)
            machine_ms = worst_ms()
        if not broken:
            return
        history.append(json.dumps({"broken": broken, "plain loop worst ms": machine_ms}))
        if machine_ms < MACHINE_BOUND_MS:
            pytest.fail(f"gap bounds broken although the machine was steady: {history}")
    pytest.skip(f"the machine was never steady enough to judge gaps: {history}")


def joint_topics() -> tuple[str, str]:
    """Return the joint command topics of both arms."""
    return "/api/left_arm/joint_cmd", "/api/right_arm/joint_cmd"


def worst_gap_ms(stats: dict[str, Any]) -> float:
    """Return the worst gap of both joint streams at the robot while they were alive [ms]."""
    return max(float(stats["commands"][topic]["worst_gap_alive_ms"]) for topic in joint_topics())
