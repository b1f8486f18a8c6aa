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
from typing import Any, ClassVar

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


STALLED = ("STATE_STALE", "PART_STALE", "PART_LOST", "TICK_LATE", "CLIENT_LOST")
"""How a motion rightly ends on a machine that stood still for a tenth of a second: whoever judges no time begins again."""

ATTEMPTS = 3
"""So often at most: other tests run beside it."""


def free_port() -> int:
    """Return a TCP port of loopback that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for(
    is_so: Callable[[], Any], what: str, seconds: float = DEADLINE_S, tell: Callable[[], str] = lambda: ""
) -> Any:
    """Poll until something is so and return it; fail when it never is, with what `tell` says then."""
    deadline = time.monotonic() + seconds
    while True:
        with contextlib.suppress(Disconnected, SimUnreachable):
            value = is_so()
            if value:
                return value
        if time.monotonic() > deadline:
            pytest.fail(f"{what}: not within {seconds} s{tell()}")
        time.sleep(0.005)


def run_apart(pid: int) -> None:
    """Let a simulated robot run whatever else does: the real one is a computer of its own.

    Not before it is there: a process that starts would hold up those of other tests for half a second.
    """
    with contextlib.suppress(OSError, AttributeError):  # not permitted or not there, here
        for task in os.listdir(f"/proc/{pid}/task"):
            os.sched_setscheduler(int(task), os.SCHED_FIFO, os.sched_param(10))


class Process:
    """A child process whose output goes to a file.

    Args:
        name: For messages and the log's name.
        arguments: Of the interpreter.
        folder: Where the log goes.
        environment: Added to this process's own.
        is_group: Whether it has processes of its own, and signals are for all of them.
        before: Put before the interpreter: a program that becomes the one it is given, such as `ip netns exec`.
    """

    def __init__(
        self,
        name: str,
        arguments: list[str],
        folder: Path,
        environment: dict[str, str] | None = None,
        *,
        is_group: bool = False,
        before: tuple[str, ...] = (),
    ) -> None:
        self.name = name
        self._is_group = is_group
        self.log = folder / f"{name}.log"
        with self.log.open("a") as stream:
            self._popen = subprocess.Popen(
                [*before, sys.executable, *arguments],
                cwd=ROOT,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                env={**os.environ, **(environment or {})},
                start_new_session=is_group,
            )
        self.pid = self._popen.pid

    def text(self) -> str:
        """Return what it has written."""
        return self.log.read_text()

    def send(self, number: int) -> None:
        """Send it a signal."""
        if self._is_group:
            os.killpg(self.pid, number)
        else:
            self._popen.send_signal(number)

    @property
    def pids(self) -> list[int]:
        """Its process id and those of its group, if it has one."""
        if not self._is_group:
            return [self.pid]
        return [int(found.name) for found in Path("/proc").glob("[0-9]*") if _group(found) == self.pid]

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
                self.send(signal.SIGCONT)
                self.send(signal.SIGTERM)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._popen.wait(6.0)
        if self.is_running and not self._is_group:
            self._tell_where_it_hangs()
        if self.is_running or self._is_group:
            with contextlib.suppress(ProcessLookupError):
                self.send(signal.SIGKILL)
            self._popen.wait()

    def _tell_where_it_hangs(self) -> None:
        """Add to its log what the kernel knows of its threads; a daemon or a guard adds their stacks when it is aborted."""
        with self.log.open("a") as stream, contextlib.suppress(OSError):
            stream.write(
                f"{self.name} does not end: thread, state, ticks of its own and of the kernel, priority, core\n"
            )
            for task in sorted(Path(f"/proc/{self.pid}/task").iterdir()):
                name, _, rest = (task / "stat").read_text().partition("(")[2].rpartition(")")
                fields = rest.split()
                stream.write(f"  {name} {' '.join(fields[at] for at in (0, 11, 12, 15, 36))}\n")
        self.send(signal.SIGABRT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._popen.wait(2.0)


def _group(process: Path) -> int | None:
    """Return the process group of an entry of /proc; None when the process has ended."""
    try:
        return os.getpgid(int(process.name))
    except ProcessLookupError:
        return None


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
            except OSError:
                continue
            try:
                far = socket.create_connection(("127.0.0.1", self._target))
            except OSError:  # the robot does not listen yet
                near.close()
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

    The robot's wire is the simulated bridge or, with the kind `dds`, a DDS graph with a real bridge before it: another
    program and another port for the tests' questions, nothing else. With the kind `forces` it is the first, whose body moves
    with forces.

    Args:
        folder: For sockets, state and logs.
        has_relay: Whether the daemon reaches the robot through a relay.
        config: Text of a configuration file for the daemon.
        sim_options: Added to the command line of the simulated robot, e.g. `--mode pose`.
        has_guard: Whether the daemon has its guard. Tests that are not about it do without outside CI: there others run
            beside them, and on a machine that stands still for 80 ms a guard rightly ends the daemon.
    """

    kind: ClassVar[str] = "sim"
    """`sim`, `forces` or `dds`; chosen for each test by the fixture `robot_kind`."""
    robot_place: tuple[str, ...] = ()
    daemon_place: tuple[str, ...] = ()
    """Put before the robot's and the daemon's interpreter, where they do not run beside the test."""

    def __init__(
        self,
        folder: Path,
        *,
        has_relay: bool = False,
        config: str = "",
        sim_options: tuple[str, ...] = (),
        has_guard: bool = True,
    ) -> None:
        self.folder = folder
        if self.kind == "forces":
            sim_options = (*sim_options, "--physics", "mujoco")
        self.sim_options = sim_options
        self.sim_port = free_port()
        self.endpoint, self.control_endpoint = self.endpoints()
        self.target = str(folder / "gw.sock")
        self.config = folder / "config.toml"
        self.config.write_text(config if has_guard else f"[guard]\nenabled = false\n{config}")
        self.relay = Relay(self.sim_port) if has_relay else None
        self.robot_endpoint = f"tcp/127.0.0.1:{self.relay.port}" if self.relay else self.endpoint
        self.sim = self.start_sim()
        self.daemon = self.start_daemon()
        self.clients: list[Process] = []
        self._control: SimControl | None = None

    def endpoints(self) -> tuple[str, str]:
        """Return where the robot listens, and where it is asked by the tests."""
        endpoint = f"tcp/127.0.0.1:{self.sim_port}"
        return endpoint, endpoint if self.kind != "dds" else f"tcp/127.0.0.1:{free_port()}"

    def start_sim(self) -> Process:
        """Start the simulated robot."""
        if self.kind != "dds":
            arguments = ["-m", "gateway.cli", "sim", "--listen", self.endpoint, *self.sim_options]
            return Process("sim", arguments, self.folder, before=self.robot_place)
        from tests.interop.dds_node import loopback  # CycloneDDS is not everywhere

        places = ["--listen", self.endpoint, "--control", self.control_endpoint, "--folder", str(self.folder)]
        arguments = ["-m", "tests.interop.dds_robot", *places, *self.sim_options]
        graph = {"CYCLONEDDS_URI": loopback(self.graph)}
        robot = Process("sim", arguments, self.folder, graph, is_group=True, before=self.robot_place)
        with contextlib.suppress(OSError):  # not permitted here
            # Node and bridge are a computer of their own; what they start inherits it.
            os.sched_setscheduler(robot.pid, os.SCHED_FIFO, os.sched_param(10))
        return robot

    @property
    def graph(self) -> str:
        """The tag of the robot's DDS graph: who has it too, and nobody else, is a node beside the robot's own."""
        return f"{os.getpid()}-{self.sim_port}"

    def start_daemon(self) -> Process:
        """Start the daemon."""
        arguments = ["-m", "gateway.cli", "run", "--robot", self.robot_endpoint, "--socket", self.target]
        state = {"TA2_STATE_DIR": str(self.folder / "state")}
        arguments += ["--config", str(self.config)]
        return Process("daemon", arguments, self.folder, state, before=self.daemon_place)

    def connect(self, name: str = "test") -> Robot:
        """Connect a client of this process, as soon as the daemon sees a live robot."""
        robot = wait_for(lambda: connect(self.target, name=name, timeout_s=1.0), "a daemon", tell=self.logs)
        wait_for(lambda: robot.state.link.fresh and robot.state.mode is not None, "a live robot", tell=self.logs)
        if self.kind != "dds":
            run_apart(self.sim.pid)
        assert isinstance(robot, Robot)
        return robot

    def logs(self) -> str:
        """Return the ends of all logs of robot and daemon."""
        found = [self.folder / f"{name}.log" for name in ("daemon", "sim", "bridge")]
        return "".join(f"\n--- {log.name}\n{log.read_text()[-1500:]}" for log in found if log.exists())

    def client(self, name: str, program: str) -> Process:
        """Start a client program; it finds `TARGET` and `robot` (connected) in its names."""
        text = (
            "import sys, time\nimport numpy as np\n"
            "from gateway.client import connect\nfrom gateway.robot.limits import HOME_Q_RAD\n"
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
            self._control = wait_for(lambda: SimControl(self.control_endpoint), "the simulated robot")
            wait_for(lambda: self._control and self._control.ask("ping"), "its first answer")
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

    def is_still(self) -> bool:
        """Return whether the robot's arms stand still."""
        return all(abs(v) < 0.01 for arm in self.robot_state()["arms"].values() for v in arm["v_radps"])

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
