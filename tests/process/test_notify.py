"""What a service manager is told, in virtual time: in what words, how often, and that nothing ever waits for it."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gateway.process.notify import AGAIN_NS, LOOK_NS, Notifier, notifier_of

MS = 1_000_000
S = 1_000_000_000


class Manager:
    """A service manager's socket."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def listen(self) -> Manager:
        self._socket.bind(f"\0{self.address[1:]}" if self.address.startswith("@") else self.address)
        return self

    def heard(self) -> list[list[str]]:
        """Return the lines of each datagram that came since the last look."""
        came: list[list[str]] = []
        while True:
            try:
                came.append(self._socket.recv(4096).decode().splitlines())
            except BlockingIOError:
                return came

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[Manager]:
    """One that does not listen yet."""
    made = Manager(str(tmp_path / "n"))
    yield made
    made.close()


@pytest.fixture
def notifiers() -> Iterator[Callable[..., Notifier]]:
    """Give a maker of notifiers that are closed with the test."""
    made: list[Notifier] = []

    def make(address: str, watchdog_ns: int = 0) -> Notifier:
        made.append(Notifier(address, watchdog_ns))
        return made[-1]

    yield make
    for notifier in made:
        notifier.close()


def test_ready_and_stopping_come_with_the_line_for_people(manager: Manager, notifiers: Callable[..., Notifier]) -> None:
    """At once, whatever was said just before; the line is one line, and comes only when it changed."""
    notifier = notifiers(manager.listen().address)
    says = ["one\ntwo"]
    notifier.ready(0, lambda: says[0])
    assert manager.heard() == [["READY=1", "STATUS=one two"]]
    notifier.stopping(1)
    assert manager.heard() == [["STOPPING=1"]]
    notifier.beat(1 + LOOK_NS)
    assert manager.heard() == []
    says[0] = "three"
    notifier.beat(2 * LOOK_NS)
    assert manager.heard() == []
    notifier.beat(1 + 2 * LOOK_NS)
    assert manager.heard() == [["STATUS=three"]]


@pytest.mark.parametrize("tick_ns", [1 * MS, 10 * MS, 50 * MS])
def test_the_watchdog_is_fed_at_half_its_interval(
    manager: Manager, notifiers: Callable[..., Notifier], tick_ns: int
) -> None:
    """Whatever the loop's period: every half second for a watchdog of one, also when nothing else is to be said."""
    notifier = notifiers(manager.listen().address, 1 * S)
    notifier.ready(0, lambda: "IDLE")
    assert manager.heard() == [["READY=1", "WATCHDOG=1", "STATUS=IDLE"]]
    fed: list[int] = []
    for now_ns in range(tick_ns, 10 * S + 1, tick_ns):
        notifier.beat(now_ns)
        fed += [now_ns for words in manager.heard() if words == ["WATCHDOG=1"]]
    assert fed == [n * S // 2 for n in range(1, 21)]


def test_a_loop_that_stands_still_feeds_nothing(manager: Manager, notifiers: Callable[..., Notifier]) -> None:
    """No thread does it in its place; after a stall there is one beat, and not all that were missed."""
    notifier = notifiers(manager.listen().address, 1 * S)
    notifier.ready(0, lambda: "")
    manager.heard()
    time.sleep(0.05)  # real time in which another thread could
    assert manager.heard() == []
    notifier.beat(60 * S)
    notifier.beat(60 * S + 10 * MS)
    assert manager.heard() == [["WATCHDOG=1"]]


def test_what_must_arrive_is_sent_anew_until_it_does(manager: Manager, notifiers: Callable[..., Notifier]) -> None:
    """Nobody listens at first: READY comes with the first beat that is taken, and what was not taken is counted."""
    notifier = notifiers(manager.address, 1 * S)
    notifier.ready(0, lambda: "IDLE")
    notifier.beat(AGAIN_NS - 1)
    assert notifier.undelivered == 1
    notifier.beat(AGAIN_NS)
    assert notifier.undelivered == 2
    manager.listen()
    notifier.beat(2 * AGAIN_NS)
    assert manager.heard() == [["READY=1", "WATCHDOG=1", "STATUS=IDLE"]]
    notifier.beat(2 * AGAIN_NS + S // 2)
    assert manager.heard() == [["WATCHDOG=1"]] and notifier.undelivered == 2


def test_a_manager_that_reads_nothing_keeps_nobody_waiting(
    manager: Manager, notifiers: Callable[..., Notifier]
) -> None:
    """Its queue is full: the loop goes on, and what was lost is counted."""
    notifier = notifiers(manager.listen().address, 1 * S)
    sent = 0
    while notifier.undelivered < 3:
        notifier.beat(sent * S)
        sent += 1
        assert sent < 100_000
    assert manager.heard()[0] == ["WATCHDOG=1", "STATUS="]


def test_an_abstract_socket_is_one_too(notifiers: Callable[..., Notifier]) -> None:
    """`@name`, as systemd gives it to containers."""
    manager = Manager(f"@ta2-test-{os.getpid()}").listen()
    try:
        notifiers(manager.address).ready(0, lambda: "IDLE")
        assert manager.heard() == [["READY=1", "STATUS=IDLE"]]
    finally:
        manager.close()


def test_an_address_that_is_too_long_is_no_error(notifiers: Callable[..., Notifier]) -> None:
    """Whatever stands in the environment: nothing is raised in the loop."""
    notifier = notifiers("/" + "x" * 200)
    notifier.ready(0, lambda: "IDLE")
    assert notifier.undelivered == 1


def test_variables_are_taken_out_of_the_environment(manager: Manager) -> None:
    """The guard, or a program of the user's, must not speak in the daemon's place."""
    environ = {"NOTIFY_SOCKET": manager.listen().address, "WATCHDOG_USEC": "400000", "WATCHDOG_PID": "7", "HOME": "/"}
    notifier = notifier_of(environ, 7)
    assert notifier is not None and environ == {"HOME": "/"}
    notifier.ready(0, lambda: "")
    notifier.beat(199 * MS)
    notifier.beat(200 * MS)
    assert manager.heard() == [["READY=1", "WATCHDOG=1", "STATUS="], ["WATCHDOG=1"]]
    notifier.close()


@pytest.mark.parametrize(
    "watchdog",
    [{}, {"WATCHDOG_USEC": "400000", "WATCHDOG_PID": "8"}, {"WATCHDOG_USEC": "0"}, {"WATCHDOG_USEC": "-1 s"}],
)
def test_a_watchdog_that_is_not_asked_for_is_not_fed(manager: Manager, watchdog: dict[str, str]) -> None:
    """None, one of another process, none by number, and nonsense."""
    notifier = notifier_of({"NOTIFY_SOCKET": manager.listen().address, **watchdog}, 7)
    assert notifier is not None
    notifier.ready(0, lambda: "IDLE")
    notifier.beat(10 * S)
    assert manager.heard() == [["READY=1", "STATUS=IDLE"]]
    notifier.close()


@pytest.mark.parametrize("address", [None, "", "vsock:2:1234", "relative"])
def test_without_a_manager_there_is_no_notifier(address: str | None) -> None:
    """Nor with one that is not reached by a socket of this host."""
    environ = {"WATCHDOG_USEC": "400000"} | ({} if address is None else {"NOTIFY_SOCKET": address})
    assert notifier_of(environ, 7) is None and environ == {}
