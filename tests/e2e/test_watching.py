"""Stop endpoints as processes: killed, stopped, leaving in order, and a person's terminal."""

from __future__ import annotations

import contextlib
import os
import pty
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from gateway.client import Control, MotionHandle, Robot
from gateway.errors import Aborted, Code, NotReady
from tests.e2e.system import ROOT, System, wait_for

pytestmark = [pytest.mark.e2e, pytest.mark.sim_only("who watches is the matter")]

WATCHING = """
endpoint = robot.stop_endpoint(0.4).register()
print("watching", flush=True)
while not Path("leave").exists():
    endpoint.check_in()
    time.sleep(0.05)
endpoint.leave()
print("left", flush=True)
"""
BOUND_NS = 1_000_000_000
"""The period of 0.4 s, and what a busy machine takes to look [ns]."""


@pytest.fixture
def system(systems, tmp_path: Path) -> System:
    """A robot and its gateway."""
    made: System = systems(tmp_path, has_guard=False)
    made.connect("first").close()  # it answers
    return made


def watching(system: System) -> tuple[object, Path]:
    """Start a watcher, and return it with the file that lets it leave."""
    leave = system.folder / "leave"
    program = "from pathlib import Path\n" + WATCHING.replace('"leave"', repr(str(leave)))
    watcher = system.client("watcher", program)
    wait_for(lambda: "watching" in watcher.text(), "the watcher", tell=watcher.text)
    return watcher, leave


@contextlib.contextmanager
def moving(system: System) -> Iterator[tuple[Robot, Control, MotionHandle]]:
    """Somebody else's slow motion."""
    with system.connect("owner") as robot, robot.control(on_exit="hold") as own:
        own.enable()
        motion = own.left_arm.move_by(np.full(7, 0.2), speed=0.05)
        wait_for(lambda: robot.state.state == "ACTIVE", "motion")
        yield robot, own, motion


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_an_endpoint_that_dies_or_stops_holds_somebody_elses_motion(system: System, number: signal.Signals) -> None:
    """Killed: at once, by the end of its connection. Stopped: by its period. The owner is told and keeps the robot."""
    watcher, _ = watching(system)
    with moving(system) as (robot, own, motion):
        before_ns = robot.fresh_state().view.at_ns
        watcher.send(number)  # type: ignore[attr-defined]  # a Process
        with pytest.raises(Aborted) as caught:
            motion.result(timeout=10.0)
        assert caught.value.code is Code.ENDPOINT_SILENT
        view = wait_for(lambda: robot.state.view if robot.state.state == "HOLDING" else None, "the hold")
        told = next(notice for notice in robot.events() if notice.code == "ENDPOINT_SILENT")
        assert "'watcher'" in told.message and told.at_ns - before_ns < BOUND_NS
        assert view.endpoints[0].is_silent and view.lease.owned
        with pytest.raises(NotReady, match="was not heard"):
            own.left_arm.move_by(np.full(7, 0.05))
        if number is signal.SIGSTOP:
            watcher.send(signal.SIGCONT)  # type: ignore[attr-defined]
            wait_for(lambda: not robot.state.endpoints[0].is_silent, "the watcher to be heard")
        else:
            robot.recover("the watcher was killed")
        assert robot.state.state == "HOLDING"  # nothing resumes by itself
        own.left_arm.move_by(np.full(7, 0.01)).result(timeout=20.0)


def test_an_endpoint_that_leaves_in_order_stops_nothing(system: System) -> None:
    """The motion of somebody else arrives."""
    watcher, leave = watching(system)
    with moving(system) as (robot, _, motion):
        leave.touch()
        wait_for(lambda: "left" in watcher.text(), "the watcher to leave")  # type: ignore[attr-defined]
        wait_for(lambda: not robot.state.endpoints, "its end in the state")
        assert robot.fresh_state().state == "ACTIVE"
        motion.cancel()


class Terminal:
    """`ta2 stop-endpoint` in a terminal of its own."""

    def __init__(self, system: System) -> None:
        self.ours, theirs = pty.openpty()
        arguments = [sys.executable, "-m", "gateway.cli", "stop-endpoint", "--within", "0.5", "--at", system.target]
        self.process = subprocess.Popen(
            arguments, cwd=ROOT, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True
        )
        os.close(theirs)
        os.set_blocking(self.ours, False)
        self.text = ""

    def says(self, words: str) -> bool:
        """Return whether it has said so by now."""
        with contextlib.suppress(BlockingIOError, OSError):
            while chunk := os.read(self.ours, 4096):
                self.text += chunk.decode()
        return words in self.text

    def ends(self) -> bool:
        """Return whether it has ended; its terminal is read on meanwhile."""
        self.says("")
        return self.process.poll() is not None


def test_a_terminal_that_watches(system: System) -> None:
    """Enter stops, q leaves in order; a terminal that goes away holds the robot, and so does Ctrl-C."""
    with system.connect("owner") as robot:
        first = Terminal(system)
        wait_for(lambda: first.says("owner: nobody"), "its line", tell=lambda: first.text)
        assert robot.fresh_state().endpoints[0].name == "ta2 stop-endpoint"
        os.write(first.ours, b"\n")
        wait_for(lambda: robot.state.latches, "the stop", tell=lambda: first.text)
        os.write(first.ours, b"q")
        wait_for(first.ends, "its end", tell=lambda: first.text)
        assert first.process.returncode == 0 and first.says("left in order")
        wait_for(lambda: not robot.state.endpoints, "nobody to watch")
        robot.recover()
        for ends in (lambda shell: os.close(shell.ours), lambda shell: shell.process.send_signal(signal.SIGINT)):
            shell = Terminal(system)
            wait_for(lambda shell=shell: shell.says("owner: nobody"), "its line", tell=lambda shell=shell: shell.text)
            ends(shell)
            wait_for(lambda: robot.state.endpoints[0].is_silent, "silence")
            assert shell.process.wait(10.0) != 0
            robot.recover("its terminal is gone")
            wait_for(lambda: not robot.state.endpoints, "nobody to watch")
        os.close(first.ours)
