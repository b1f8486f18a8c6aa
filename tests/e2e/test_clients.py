"""Clients of a real daemon: replies that are lost, daemons that die and come back, notebooks, thousands of connections."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gateway.client import Robot, aio, connect
from gateway.errors import Aborted, Code, Disconnected, GatewayError, LeaseError, OutcomeUnknown
from tests.e2e.system import ATTEMPTS, STALLED, System, wait_for
from tests.thoroughness import IS_THOROUGH, either

pytestmark = [pytest.mark.e2e, pytest.mark.sim_only("clients and daemon are the matter")]

SHIFT = np.full(7, 0.1)


class SocketRelay:
    """A relay in front of a unix socket that can swallow what the daemon says, and cut connections.

    Args:
        path: Where it listens.
        target: Path of the socket behind it.
    """

    def __init__(self, path: Path, target: str) -> None:
        self.path = str(path)
        self._target = target
        self._is_mute = False
        self._accepts = True
        self._ends: list[socket.socket] = []
        self._past: list[socket.socket] = []
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(self.path)
        self._listener.listen()
        self._threads = [threading.Thread(target=self._accept, daemon=True)]
        self._threads[0].start()

    def mute(self) -> None:
        """Swallow every byte of the daemon from now on; what the client says still arrives."""
        self._is_mute = True

    def cut(self, *, for_good: bool = False) -> None:
        """End all connections; later ones pass everything, unless there shall be none."""
        self._accepts = not for_good
        ends, self._ends = self._ends, []
        self._past += ends
        for end in ends:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
        self._is_mute = False

    def close(self) -> None:
        """End the relay."""
        self.cut(for_good=True)
        self._listener.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join(5.0)
        for end in (*self._past, *self._ends, self._listener):
            end.close()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            if not self._accepts:
                near.close()
                continue
            far = socket.socket(socket.AF_UNIX)
            try:
                far.connect(self._target)
            except OSError:  # as a client without a relay would find it
                near.close()
                far.close()
                continue
            self._ends += [near, far]
            for ends in ((near, far, False), (far, near, True)):
                self._threads.append(threading.Thread(target=self._pump, args=ends, daemon=True))
                self._threads[-1].start()

    def _pump(self, source: socket.socket, sink: socket.socket, is_daemon: bool) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                if not (is_daemon and self._is_mute):
                    sink.sendall(data)
        for end in (source, sink):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)


@pytest.fixture
def system(tmp_path: Path, systems: Callable[..., System]) -> System:
    """A simulated robot and a daemon."""
    return systems(tmp_path, has_guard=IS_THOROUGH)


@pytest.fixture
def pool():
    """A thread in which something waits while the test goes on."""
    with ThreadPoolExecutor(1) as pool:
        yield pool


def changes_of_lease(robot: Robot) -> list[str]:
    """Return what was told about the lease so far."""
    return [notice.message for notice in robot.events(timeout=0.0) if notice.code == "LEASE_CHANGED"]


def end_of(robot: Robot, motion_id: int) -> str:
    """Return the state of a motion as another client sees it; empty while it does not."""
    return next((motion.state for motion in robot.state.motions if motion.motion_id == motion_id), "")


def gone(robot: Robot) -> bool:
    """Return whether the client says that its daemon is gone."""
    try:
        _ = robot.state
    except Disconnected:
        return True
    return False


def test_a_lost_reply_is_asked_for_again_and_the_request_runs_once(
    system: System, tmp_path: Path, pool: ThreadPoolExecutor
) -> None:
    """The reply to `acquire` is swallowed and the connection cut: the library gets it later, under the same number."""
    with system.connect("watcher") as watcher:
        relay = SocketRelay(tmp_path / "relay.sock", system.target)
        try:
            robot = connect(relay.path, name="unlucky")
            relay.mute()
            waiting = pool.submit(robot.control().acquire)
            wait_for(lambda: watcher.state.lease.name == "unlucky", "the request to run")
            assert not waiting.done()
            relay.cut()
            own = waiting.result(timeout=10.0)
            lease = watcher.state.lease
            assert own.is_open and lease.epoch == own.epoch and lease.client_id == robot.client_id
            wait_for(lambda: watcher.state.lease.lost_ns is None, "the owner to be back")
            assert sum("owns the robot" in message for message in changes_of_lease(watcher)) == 1
            own.enable()
            own.release()
            robot.close()
        finally:
            relay.close()


def test_a_reply_that_never_comes_is_an_unknown_outcome(
    system: System, tmp_path: Path, pool: ThreadPoolExecutor
) -> None:
    """The connection stays away: OUTCOME_UNKNOWN in time, although the request has run; and it ran once."""
    with system.connect("watcher") as watcher:
        relay = SocketRelay(tmp_path / "relay.sock", system.target)
        try:
            robot = connect(relay.path, name="unlucky")
            relay.mute()
            began = time.monotonic()
            waiting = pool.submit(robot.stop, "a stranger's")
            wait_for(lambda: "STOPPED_BY_OTHER" in watcher.state.latches, "the stop")
            relay.cut(for_good=True)
            with pytest.raises(OutcomeUnknown, match="may or may not have run"):
                waiting.result(timeout=10.0)
            assert time.monotonic() - began < 4.0
            watcher.recover()
            time.sleep(0.5)  # a repetition would come within this
            assert watcher.state.latches == {}
            robot.close()
        finally:
            relay.close()


def test_an_owner_whose_connection_breaks_goes_on_under_its_lease(system: System, tmp_path: Path) -> None:
    """Ten times cut while a motion is under way: braked and held, back by itself, and nothing of before is sent again."""
    with system.connect("watcher") as watcher:
        relay = SocketRelay(tmp_path / "relay.sock", system.target)
        try:
            robot = connect(relay.path, name="shaky")
            events = robot.events(timeout=None)
            own = robot.control().acquire()
            own.enable()
            threads = threading.active_count()
            for number in range(10):
                handle = own.left_arm.move_by(np.full(7, 0.02 if number % 2 else -0.02), speed=0.05)
                relay.cut()
                wait_for(lambda handle=handle: end_of(watcher, handle.motion_id) == "aborted", "the end of the motion")
                wait_for(lambda: watcher.state.lease.lost_ns is None, "the owner to be back")
                with pytest.raises(Aborted):
                    handle.result(timeout=5.0)
                wait_for(lambda: robot.state.age < 0.1, "states")
                assert own.is_open and watcher.state.state == "HOLDING"
                while next(events).code != "CONNECTED":
                    pass
            assert own.left_arm.move_by(np.full(7, 0.01)).result(timeout=20.0).sides == ("left",)
            assert sum("owns the robot" in message for message in changes_of_lease(watcher)) == 1
            wait_for(lambda: threading.active_count() <= threads + 2, "the relay's threads to end")
            own.release()
            robot.close()
        finally:
            relay.close()


def test_a_daemon_killed_before_it_answers_is_an_unknown_outcome_and_nothing_is_repeated(
    system: System, pool: ThreadPoolExecutor
) -> None:
    """Killed between request and reply: unknown within two seconds. The next daemon is read, and asked nothing again."""
    robot = system.connect("owner")
    own = robot.control().acquire()
    own.enable()
    before = robot.state.left_arm.q
    events = robot.events(timeout=None, backlog=False)
    states = robot.states(timeout=20.0)
    next(states)
    system.daemon.send(signal.SIGSTOP)
    waiting = pool.submit(own.left_arm.move_by, SHIFT)
    time.sleep(0.02)
    system.daemon.send(signal.SIGKILL)
    killed = time.monotonic()
    with pytest.raises(OutcomeUnknown):
        waiting.result(timeout=10.0)
    assert time.monotonic() - killed < 2.0
    system.daemon.wait()
    wait_for(lambda: not robot.health().daemon, "the loss of the daemon")
    wait_for(lambda: gone(robot), "the end of the daemon")
    with pytest.raises(Disconnected):
        own.hold()

    system.daemon = system.start_daemon()
    wait_for(lambda: next(states).link.fresh, "states of the next daemon")
    for command in (own.enable, own.hold, lambda: own.left_arm.move_by(SHIFT)):
        with pytest.raises(LeaseError) as caught:
            command()
        assert caught.value.code is Code.LEASE_LOST
    told: list[str] = []
    while "CONNECTED" not in told:
        told.append(next(events).code)
    assert "DISCONNECTED" in told
    assert robot.state.motions == () and np.allclose(robot.state.left_arm.q, before, atol=0.05)
    with robot.control() as again:  # by hand, and under a new epoch
        assert again.epoch > 1
    robot.close()


def test_a_program_ends_although_its_daemon_is_frozen(system: System) -> None:
    """Nothing at the end of an interpreter waits for a daemon that does not answer, closed or not."""
    system.connect("watcher").close()
    programs = [
        system.client("forgetful", "own = robot.control().acquire()\nprint('up')\ntime.sleep(1.0)\n"),
        system.client("tidy", "print('up')\ntime.sleep(1.0)\nrobot.close()\n"),
        system.client(
            "waiting", "print('up')\nfor state in robot.states(timeout=30.0):\n    if state.age > 0.9: break\n"
        ),
    ]
    for program in programs[:2]:
        wait_for(lambda program=program: "up" in program.text(), "the program")
    programs[2].send(signal.SIGINT)
    system.daemon.send(signal.SIGSTOP)
    try:
        began = time.monotonic()
        for program in programs:
            program.wait(15.0)
        assert time.monotonic() - began < 12.0
    finally:
        with contextlib.suppress(ProcessLookupError):
            system.daemon.send(signal.SIGCONT)


# ------------------------------------------------------------------------------------------------------ notebooks


CONNECT_CELL = "robot = connect(target, name='notebook')\nleft = robot.state.left_arm.q\n"
OWN_CELL = "own = robot.control().acquire()\nown.enable()\nown.left_arm.move_by([0.02] * 7).result(timeout=10)\n"
END_CELL = "own.release()\n"


def test_a_notebook_runs_its_cells_again_and_again(system: System) -> None:
    """Cells run in one namespace, inside a running event loop, as a kernel runs them: nothing is left of earlier runs."""
    with system.connect("watcher"):
        gc.collect()
        before = threading.active_count()
        names = {"connect": connect, "target": system.target}

        async def kernel() -> None:
            for _ in range(5):
                for cell in (CONNECT_CELL, CONNECT_CELL, OWN_CELL, END_CELL):
                    for attempt in range(ATTEMPTS):
                        try:
                            exec(compile(cell, "cell", "exec"), names)
                            break
                        except GatewayError as error:  # a person runs the cell again, too
                            if error.code not in STALLED or attempt == ATTEMPTS - 1:
                                raise
                    await asyncio.sleep(0)

        asyncio.run(kernel())
        gc.collect()
        wait_for(lambda: threading.active_count() <= before + 1, "the threads of earlier connections to end")
        names["robot"].close()


def test_a_paced_stream_learns_from_the_daemon_how_early_its_targets_come(system: System) -> None:
    """Every target is taken, at the rate that was asked for on average, and the daemon tells what it is paced by."""
    with system.connect("pacer") as robot, robot.control() as own:
        own.enable(timeout=12.0)
        for paced in (True, False):
            with own.left_arm.stream(rate_hz=40, paced=paced) as out:
                begun = time.monotonic()
                for _ in range(80):
                    out.set(out.q)
                    out.tick()
                passed = time.monotonic() - begun
                assert (80 + out.skipped - 2) / 40 < passed
                wait_for(lambda out=out: out.accepted == 80, "the last target")
                (view,) = [view for view in robot.state.view.targets if view.open]
                assert view.lead_ns is not None and view.lead_ns <= 10_000_000


def test_both_clients_live_in_one_running_loop(system: System) -> None:
    """A program of asyncio may use the blocking client beside its twin; streams, states and events go on in one loop."""

    async def kernel() -> int:
        async with aio.connect(system.target, name="async") as robot:
            watcher = connect(system.target, name="blocking")  # blocks the loop for a moment, and works
            seen = {}

            async def look() -> None:
                async for state in robot.states(max_rate=20.0):
                    seen[state.seq] = state

            looking = asyncio.create_task(look())
            async with robot.control() as own:
                await own.enable()
                async with own.left_arm.stream(rate_hz=50) as out:
                    for _ in range(20):
                        out.set(out.q)
                        await out.tick()
                assert watcher.state.lease.name == "async"
            assert [notice.code async for notice in robot.events(timeout=0.2)]
            watcher.close()
            looking.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await looking
            return len(seen)

    system.connect("watcher").close()
    assert asyncio.run(kernel()) > 10


CTRL_C = """
import asyncio
from gateway.client import aio

async def main():
    async with aio.connect(TARGET, name="async owner") as robot, robot.control() as own:
        await own.enable()
        handle = await own.left_arm.move_by([0.3] * 7, speed=0.1)
        print("moving", flush=True)
        async for state in robot.states():
            pass

try:
    asyncio.run(main())
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


def test_ctrl_c_in_an_async_program_leaves_the_robot_held(system: System) -> None:
    """SIGINT under asyncio.run: the arms brake and are held, nothing is released or paused, and the program ends."""
    with system.connect("watcher") as watcher:
        program = system.client("async", "robot.close()\n" + CTRL_C)
        wait_for(lambda: "moving" in program.text(), "the motion")
        program.send(signal.SIGINT)
        assert program.wait() == 0 and "interrupted" in program.text()
        state = wait_for(lambda: watcher.state.state == "HOLDING" and watcher.state, "the hold")
        assert state.fsm_name == "READY" and state.lease.lost_ns is not None
        assert state.motions[-1].state in ("aborted", "cancelled")


# --------------------------------------------------------------------------------------------------------- memory


def rss_kib(pid: int) -> int:
    """Return the resident memory of a process [KiB]."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1024


MANY = """
import gc, sys
from gateway.client import connect
for count in range(int(sys.argv[2])):
    with connect(sys.argv[1], name="one of many") as robot, robot.control():
        robot.state.left_arm.q
    if count % (int(sys.argv[2]) // 4) == int(sys.argv[2]) // 4 - 1:
        gc.collect()
        print(int(open("/proc/self/statm").read().split()[1]) * 4, flush=True)
"""


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.sim_only("a matter of clients and daemon, a minute long")
def test_memory_is_flat_over_thousands_of_connections(tmp_path: Path, systems: Callable[..., System]) -> None:
    """Two thousand clients before a release (fewer otherwise), each with a lease: neither side keeps anything of them.

    Without the black box, which grows by intent in its first minutes.
    """
    system = systems(tmp_path, has_guard=IS_THOROUGH, config="[local]\nblack_box = false\n")
    count = either(600, 2000)
    with system.connect("watcher") as watcher:
        daemon: list[int] = []
        client = []
        arguments = [sys.executable, "-c", MANY, system.target, str(count)]
        with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            for line in process.stdout:
                client.append(int(line))
                daemon.append(rss_kib(system.daemon.pid))
        print(f"resident memory every quarter [KiB]: client {client}, daemon {daemon}")
        assert process.returncode == 0 and len(client) == 4
        assert client[-1] - client[0] < 1500, f"client [KiB]: {client}"
        # What is kept of each is kept in each quarter; what grows once, or on a busy host for a while, is not in all of them.
        growth_kib = 4 / count * min(later - earlier for earlier, later in pairwise(daemon))
        assert growth_kib < 5.0, f"{growth_kib:.1f} KiB a connection; daemon [KiB]: {daemon}"
        assert watcher.state.lease.epoch >= count
