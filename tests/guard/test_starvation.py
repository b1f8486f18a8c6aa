"""Rules of `gateway.guard.starvation`: who could run and does not waits; who sleeps, is stopped or hinders itself does not."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.guard.starvation import Starvation

PID = 7


class Proc:
    """What the kernel would say of a process.

    Args:
        folder: In place of /proc.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def says(self, thread: int, state: str, ran_ns: int) -> None:
        """Say it of a thread."""
        task = self.folder / str(PID) / "task" / str(thread)
        task.mkdir(parents=True, exist_ok=True)
        (task / "stat").write_text(f"{thread} (a) R (b) {state} 1 1 1 0 -1 4194304")
        (task / "schedstat").write_text(f"{ran_ns} 5 6\n")

    def ends(self, thread: int) -> None:
        """A thread is no more."""
        task = self.folder / str(PID) / "task" / str(thread)
        for file in task.iterdir():
            file.unlink()
        task.rmdir()


@pytest.fixture
def proc(tmp_path: Path) -> Proc:
    """A process of one sleeping thread."""
    made = Proc(tmp_path)
    made.says(7, "S", 100)
    return made


def asked(proc: Proc, runnable: int) -> Starvation:
    """A process that has just been asked about."""
    starvation = Starvation(PID, proc.folder)
    assert starvation.ask() == runnable
    return starvation


@pytest.mark.parametrize("state", ["S", "D", "T", "t", "Z", "X", "I"])
def test_who_does_not_want_to_run_waits_for_no_core(proc: Proc, state: str) -> None:
    """Asleep, stopped, in the kernel, ended: a daemon that hangs there hangs."""
    proc.says(7, state, 100)
    assert asked(proc, 0).is_over()


def test_who_could_run_and_has_not_run_since_waits(proc: Proc) -> None:
    """Also when another thread of it runs a little meanwhile; until it has run itself."""
    proc.says(7, "R", 100)
    proc.says(8, "R", 900)
    starvation = asked(proc, 2)
    assert not starvation.is_over()
    proc.says(8, "R", 901)
    assert not starvation.is_over()
    proc.says(7, "R", 101)
    assert starvation.is_over()


@pytest.mark.parametrize("how", ["sleeps", "ends", "says nothing"])
def test_who_sleeps_again_or_has_ended_had_its_turn(proc: Proc, how: str) -> None:
    """Even a thread that lives too short to be looked at twice."""
    proc.says(8, "R", 100)
    starvation = asked(proc, 1)
    assert not starvation.is_over()
    if how == "sleeps":
        proc.says(8, "S", 100)
    elif how == "ends":
        proc.ends(8)
    else:
        (proc.folder / str(PID) / "task" / "8" / "schedstat").write_text("")
    assert starvation.is_over()


def test_a_thread_behind_one_that_spins_waits_for_no_turn_of_the_process(proc: Proc) -> None:
    """Such a loop has all the time that there is, and hangs."""
    proc.says(7, "R", 100)
    proc.says(8, "R", 100)
    starvation = asked(proc, 2)
    proc.says(7, "R", 60_000_000_000)
    assert starvation.is_over()


def test_where_the_kernel_says_nothing_nobody_waits(tmp_path: Path) -> None:
    """No such process, no /proc, or a kernel that does not count."""
    starvation = Starvation(PID, tmp_path)
    assert starvation.is_over() and starvation.ask() == 0 and starvation.is_over()
    task = tmp_path / str(PID) / "task" / "7"
    task.mkdir(parents=True)
    (task / "stat").write_text("7 (x) R 1")
    assert starvation.ask() == 0 and starvation.is_over()


CHILD = "while True: pass"


@pytest.fixture
def spinning() -> Iterator[subprocess.Popen[bytes]]:
    """A process that spins, on one core."""
    process = subprocess.Popen([sys.executable, "-S", "-c", CHILD])
    os.sched_setaffinity(process.pid, {min(os.sched_getaffinity(0))})
    yield process
    process.kill()
    process.wait()


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="this kernel does not say how long a thread ran")
def test_this_kernel_says_who_spins_and_who_is_stopped(spinning: subprocess.Popen[bytes]) -> None:
    """A spinning process gets its turn, sooner or later; a stopped one wants none."""
    starvation, deadline = Starvation(spinning.pid), time.monotonic() + 10.0
    while starvation.ask() != 1:  # it starts
        assert time.monotonic() < deadline
    while not starvation.is_over():
        assert time.monotonic() < deadline
    os.kill(spinning.pid, signal.SIGSTOP)
    while starvation.ask() != 0:
        assert time.monotonic() < deadline
    assert starvation.is_over()
