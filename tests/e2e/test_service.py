"""Gateway and recorder under a service manager that the test is: READY, a watchdog fed by the loop itself, STOPPING."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.client import connect
from tests.e2e.system import Process, System, wait_for

pytestmark = [pytest.mark.e2e, pytest.mark.sim_only("what is said to a service manager is the same for every robot")]

BEAT_S = 0.2
WATCHDOG = {"WATCHDOG_USEC": str(round(2e6 * BEAT_S))}


class Manager:
    """The service manager's socket, and what was heard there."""

    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(str(path))
        self.environment = {"NOTIFY_SOCKET": str(path), **WATCHDOG}
        self.words: list[str] = []

    def hears(self, word: str, times: int = 1) -> bool:
        """Whether a word has come so often since `forget`."""
        while True:
            try:
                self.words += self._socket.recv(4096).decode().splitlines()
            except BlockingIOError:
                return self.words.count(word) >= times

    def forget(self) -> None:
        """Forget what was heard."""
        self.hears("")
        self.words.clear()

    def close(self) -> None:
        """Hear no more."""
        self._socket.close()


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[Manager]:
    """One that listens."""
    made = Manager(tmp_path / "notify")
    yield made
    made.close()


class Service(System):
    """A robot, and a gateway that a service manager has started."""

    def __init__(self, folder: Path, manager: Manager, *, has_guard: bool) -> None:
        self.environment = manager.environment
        super().__init__(folder, has_guard=has_guard)

    def start_daemon(self) -> Process:
        """Start the daemon."""
        arguments = ["-m", "gateway.cli", "run", "--robot", self.robot_endpoint, "--socket", self.target]
        state = {"TA2_STATE_DIR": str(self.folder / "state")}
        return Process("daemon", [*arguments, "--config", str(self.config)], self.folder, {**state, **self.environment})


@pytest.fixture
def service(request: pytest.FixtureRequest, tmp_path: Path, manager: Manager) -> Iterator[Service]:
    """One with a guard or, where a test says so, without."""
    made = Service(tmp_path, manager, has_guard=getattr(request, "param", True))
    yield made
    made.close()


def test_ready_when_clients_can_connect_and_stopping_when_it_ends(service: Service, manager: Manager) -> None:
    """A client of that moment is let in; the guard inherits nothing of the manager's; the state is a line for people."""
    wait_for(lambda: manager.hears("READY=1"), "READY", tell=service.logs)
    connect(service.target, timeout_s=20.0).close()
    wait_for(lambda: manager.hears("STATUS=READ_ONLY"), "the state in words", tell=service.logs)
    (guard,) = children(service.daemon.pid)
    names = {line.partition("=")[0] for line in Path(f"/proc/{guard}/environ").read_text().split("\0")}
    assert "TA2_STATE_DIR" in names and not names & {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}
    assert "STOPPING=1" not in manager.words
    service.daemon.send(signal.SIGTERM)
    wait_for(lambda: manager.hears("STOPPING=1"), "STOPPING", tell=service.logs)
    assert service.daemon.wait() == 0
    assert manager.words.count("READY=1") == 1


def children(pid: int) -> list[int]:
    """Return the processes that one has started."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:  # it ended meanwhile
            continue
        if int(fields[1]) == pid:
            found.append(int(folder.name))
    return found


@pytest.mark.parametrize("service", [False], indirect=True)
def test_the_watchdog_is_fed_by_the_loop_and_by_nothing_else(service: Service, manager: Manager) -> None:
    """At half the interval, never faster; a process that stands still is silent, and goes on when it may run again."""
    begun_s = time.monotonic()
    wait_for(lambda: manager.hears("READY=1"), "READY", tell=service.logs)
    manager.forget()
    wait_for(lambda: manager.hears("WATCHDOG=1", times=10), "ten beats", tell=service.logs)
    assert manager.words.count("WATCHDOG=1") <= (time.monotonic() - begun_s) / BEAT_S + 1
    os.kill(service.daemon.pid, signal.SIGSTOP)
    wait_for(lambda: is_stopped(service.daemon.pid), "a daemon that stands still")
    manager.forget()
    time.sleep(5 * BEAT_S)  # the silence is what is proved; a slow machine makes it longer, never louder
    assert not manager.hears("WATCHDOG=1")
    os.kill(service.daemon.pid, signal.SIGCONT)
    wait_for(lambda: manager.hears("WATCHDOG=1", times=2), "beats again", tell=service.logs)


def is_stopped(pid: int) -> bool:
    """Whether every thread of a process is stopped."""
    stats = [(task / "stat").read_text() for task in Path(f"/proc/{pid}/task").iterdir()]
    return all(stat.rpartition(")")[2].split()[0] == "T" for stat in stats)


@pytest.mark.thorough
def test_a_recorder_is_a_service_too(tmp_path: Path, service: Service, manager: Manager) -> None:
    """It is ready when it can be told of episodes, says where it records, and is alive while it does."""
    service.connect().close()
    service.daemon.send(signal.SIGTERM)  # the manager's socket is the recorder's from now on
    service.daemon.wait()
    manager.forget()
    arguments = ["-m", "gateway.cli", "record", "--robot", service.endpoint, "--out", str(tmp_path / "bag")]
    arguments += ["--socket", service.target]
    recorder = Process("record", arguments, tmp_path, manager.environment)
    try:
        wait_for(lambda: manager.hears("READY=1"), "READY", tell=recorder.text)
        wait_for(lambda: manager.hears("WATCHDOG=1", times=3), "beats", tell=recorder.text)
        assert f"STATUS={tmp_path / 'bag'}" in manager.words
        wait_for(lambda: " messages" in recorder.text(), "messages", tell=recorder.text)
        recorder.send(signal.SIGINT)  # as the unit has it
        assert recorder.wait() == 0, recorder.text()
    finally:
        recorder.end()
