"""Rules of `core_probe`: a core answers when it runs, and a process when its turn has come as well."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest

from gateway.guard.core_probe import CoreProbe
from gateway.guard.starvation import Starvation
from gateway.process.cores import LinuxAffinity

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="cores can be chosen on Linux only")

CHILD = "import time; time.sleep(60)"
SPINNER = """
import os, sys, time
os.sched_setaffinity(0, {int(sys.argv[1])})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(sys.argv[2])))
print("ready", flush=True)
end = time.monotonic() + float(sys.argv[3])
while time.monotonic() < end:
    pass
print(time.monotonic_ns(), flush=True)
"""


URGENT, MORE_URGENT = 1, 3
"""Priorities under SCHED_FIFO of what is bound to a core, and of what takes the core from it and from its probe: far below
those of daemons, which end-to-end tests may run beside this file."""


@pytest.fixture
def child() -> Iterator[subprocess.Popen[bytes]]:
    """A process that waits."""
    process = subprocess.Popen([sys.executable, "-S", "-c", CHILD])
    yield process
    process.kill()
    process.wait()


@pytest.fixture
def probe(child: subprocess.Popen[bytes]) -> Iterator[CoreProbe]:
    """A probe of its core."""
    made = CoreProbe(child.pid, LinuxAffinity(), URGENT)
    yield made
    made.close()


def soon(is_so: Callable[[], object], seconds: float = 5.0) -> bool:
    """Return whether something is so before its time is over."""
    deadline = time.monotonic() + seconds
    while not is_so():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.0005)
    return True


def test_a_core_that_runs_answers_at_once(child: subprocess.Popen[bytes], probe: CoreProbe) -> None:
    """The answer is not older than the question, each time."""
    os.sched_setaffinity(child.pid, {min(os.sched_getaffinity(0))})
    assert probe.ran_ns() == 0
    for _ in range(3):
        asked_ns = time.monotonic_ns()
        probe.ask()
        assert soon(lambda asked_ns=asked_ns: (probe.ran_ns() or 0) >= asked_ns)


def test_a_process_on_several_cores_is_asked_for_on_the_one_it_ran_on(
    child: subprocess.Popen[bytes], probe: CoreProbe
) -> None:
    """It may run wherever there is room; one that has ended runs nowhere, and nobody is asked."""
    asked_ns = time.monotonic_ns()
    probe.ask()
    assert soon(lambda: (probe.ran_ns() or 0) >= asked_ns)
    child.kill()
    child.wait()
    assert probe.ran_ns() is None
    probe.ask()
    assert probe.ran_ns() is None


class Patient(Starvation):
    """A process whose turn comes when the test says so."""

    def __init__(self) -> None:
        super().__init__(os.getpid())
        self.has_had_its_turn = False

    def ask(self) -> int:
        """It wants to run."""
        return 1

    def is_over(self) -> bool:
        """Return what the test says."""
        return self.has_had_its_turn


def test_a_process_that_waits_for_its_turn_on_a_core_that_runs_has_not_answered(child: subprocess.Popen[bytes]) -> None:
    """The answer is as old as the last look at which it still waited; the account tells both."""
    os.sched_setaffinity(child.pid, {min(os.sched_getaffinity(0))})
    starvation = Patient()
    probe = CoreProbe(child.pid, LinuxAffinity(), URGENT, starvation)
    try:
        assert probe.account(time.monotonic_ns()) == "its core was not asked"
        asked_ns = time.monotonic_ns()
        probe.ask()
        assert soon(lambda: "its core ran" in probe.account(time.monotonic_ns()))
        assert probe.ran_ns() == 0
        waited_ns = time.monotonic_ns()
        assert probe.ran_ns() == 0 and "it could run" not in probe.account(waited_ns)
        starvation.has_had_its_turn = True
        assert asked_ns < waited_ns <= (probe.ran_ns() or 0)
        assert "it could run" in probe.account(time.monotonic_ns())
    finally:
        probe.close()


@pytest.fixture
def contended() -> Iterator[int]:
    """A core from which this test keeps away: it would stand still there with the rest, and ask when all is over."""
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) < 2:
        pytest.skip("one core only: the test would stand still with it")
    os.sched_setaffinity(0, set(cores[:-1]))
    yield cores[-1]
    os.sched_setaffinity(0, set(cores))


def test_a_core_that_stands_still_answers_when_it_runs_again(
    child: subprocess.Popen[bytes], probe: CoreProbe, contended: int
) -> None:
    """A program keeps the core above the probe, for a third of a second: what is bound to it waits until the end."""
    os.sched_setaffinity(child.pid, {contended})
    for _ in range(3):  # the host may hold up this test for as long as the program spins: then it asks too late
        spinner = subprocess.Popen(
            [sys.executable, "-S", "-c", SPINNER, str(contended), str(MORE_URGENT), "0.3"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        assert spinner.stdout is not None and spinner.stderr is not None
        try:
            if spinner.stdout.readline() != b"ready\n":
                pytest.skip("no permission to run in real time")
            asked_ns = time.monotonic_ns()
            probe.ask()
            assert soon(lambda asked_ns=asked_ns: (probe.ran_ns() or 0) >= asked_ns)
            ended_ns = int(spinner.stdout.readline())
            assert (probe.ran_ns() or 0) >= ended_ns
        finally:
            spinner.kill()
            spinner.wait()
            spinner.stdout.close()
            spinner.stderr.close()
        if asked_ns < ended_ns - 100_000_000:
            return
    pytest.fail("asked too late, three times: nothing is proved")


class Refusing(LinuxAffinity):
    """A kernel that moves no thread."""

    def keep(self, thread_id: int, cores: object) -> None:
        """Refuse."""
        raise OSError("no such core")


def test_a_core_that_cannot_be_asked_counts_as_running(child: subprocess.Popen[bytes]) -> None:
    """Nothing speaks for a core that stands still: the ticks decide."""
    probe = CoreProbe(child.pid, Refusing(), 60)
    try:
        os.sched_setaffinity(child.pid, {min(os.sched_getaffinity(0))})
        asked_ns = time.monotonic_ns()
        probe.ask()
        assert soon(lambda: (probe.ran_ns() or 0) >= asked_ns)  # it has just been moved, and must run there first
    finally:
        probe.close()
