"""One core for all threads or for none; and a way out of it for those who must not share it."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Set as AbstractSet
from pathlib import Path

import pytest

from gateway.process.cores import LinuxAffinity, OneCore, spread

ROOT = Path(__file__).resolve().parents[1]
MAIN = 100


class Fake:
    """Threads with their cores, in memory, and errors where the test wants them."""

    def __init__(self, cores: AbstractSet[int] = frozenset({0, 1, 2, 3})) -> None:
        self.threads: dict[int, set[int]] = {MAIN: set(cores), 101: set(cores), 102: set(cores)}
        self.ended: set[int] = set()
        self.denied: set[int] = set()
        self.error: OSError | None = None

    def thread_ids(self) -> set[int]:
        if self.error is not None:
            raise self.error
        return {*self.threads} | self.ended

    def cores(self, thread_id: int) -> set[int]:
        return set(self.threads[thread_id or MAIN])

    def keep(self, thread_id: int, cores: AbstractSet[int]) -> None:
        if thread_id in self.ended:
            raise ProcessLookupError(errno.ESRCH, "No such process")
        if thread_id in self.denied and len(cores) == 1:
            raise PermissionError(errno.EPERM, "Operation not permitted")
        self.threads[thread_id or MAIN] = set(cores)


def test_all_threads_go_to_one_core() -> None:
    """And the line names it; a thread that has just ended is no fault."""
    affinity = Fake()
    affinity.ended = {103}
    together = OneCore(affinity, number=0)
    measure = together.apply()
    assert measure.taken and together.active
    assert affinity.threads == {MAIN: {3}, 101: {3}, 102: {3}}
    assert measure.line == "one core: all threads on core 3 of [0, 1, 2, 3]"


def test_daemons_of_several_robots_spread_over_the_cores() -> None:
    """The number, a process id, chooses."""
    chosen = set()
    for number in range(40, 44):
        affinity = Fake()
        OneCore(affinity, number).apply()
        chosen |= affinity.threads[MAIN]
    assert chosen == {0, 1, 2, 3}


def test_threads_that_were_born_since_follow() -> None:
    """A new session brings new threads; the core stays the same."""
    affinity = Fake({0, 1})
    together = OneCore(affinity, 8)
    together.apply()
    affinity.threads[104] = {0, 1}
    assert together.apply().taken
    assert affinity.threads[104] == affinity.threads[MAIN] == {1}
    together.undo()
    assert not together.active
    assert set(map(frozenset, affinity.threads.values())) == {frozenset({0, 1})}


def test_when_one_thread_cannot_be_moved_all_go_back() -> None:
    """Half of it is worse than nothing."""
    affinity = Fake()
    affinity.denied = {102}
    together = OneCore(affinity, 7)
    measure = together.apply()
    assert not measure.taken and not together.active
    assert "Operation not permitted" in measure.line and "\n" not in measure.line
    assert set(map(frozenset, affinity.threads.values())) == {frozenset({0, 1, 2, 3})}


def test_a_single_core_and_a_system_without_them_are_said_in_one_line() -> None:
    """Nothing to choose, nothing to move, nothing raised."""
    alone = OneCore(Fake({2}), 1)
    assert alone.apply().line == "one core: not taken, core 2 is the only one"
    broken = Fake()
    broken.error = OSError("not available on plan9")
    together = OneCore(broken, 1)
    measure = together.apply()
    assert not measure.taken and "not available on plan9" in measure.line
    together.undo()


def test_nothing_is_undone_that_was_not_done() -> None:
    """Before `apply` nothing is known of where the threads could run."""
    affinity = Fake({1, 2})
    OneCore(affinity, 1).undo()
    assert affinity.threads[MAIN] == {1, 2}


@pytest.mark.skipif(sys.platform != "linux", reason="affinity is Linux's")
def test_on_linux_a_process_goes_to_one_core_and_its_guard_out_of_it() -> None:
    """With real threads, in a process of its own; a child inherits the core until it spreads."""
    program = """
import os, subprocess, sys, threading
from gateway.process.cores import LinuxAffinity, OneCore, spread
if sys.argv[1:]:
    spread(LinuxAffinity())
    print(len(os.sched_getaffinity(0)))
    sys.exit()
before = len(os.sched_getaffinity(0))
gate = threading.Event()
threads = [threading.Thread(target=gate.wait) for _ in range(3)]
for thread in threads:
    thread.start()
together = OneCore(LinuxAffinity(), os.getpid())
print(before, together.apply().taken)
print({len(LinuxAffinity().cores(t.native_id)) for t in (threading.main_thread(), *threads)})
print(subprocess.run([sys.executable, "-c", open("/proc/self/cmdline").read().split(chr(0))[2], "child"],
    capture_output=True, text=True).stdout.strip())
together.undo()
print({len(LinuxAffinity().cores(t.native_id)) for t in (threading.main_thread(), *threads)})
gate.set()
"""
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, env=dict(os.environ), capture_output=True, text=True, timeout=30
    )
    assert done.returncode == 0, done.stderr
    first, together, child, after = done.stdout.splitlines()
    cores, taken = first.split()
    assert taken == str(int(cores) > 1)
    assert together == ("{1}" if taken == "True" else f"{{{cores}}}")
    assert int(child) >= int(cores)
    assert after == f"{{{cores}}}"


def test_spreading_where_nothing_can_be_set_is_harmless() -> None:
    """Whoever starts on another system inherited nothing."""

    class Nothing(Fake):
        def keep(self, thread_id: int, cores: AbstractSet[int]) -> None:
            raise OSError("not available")

    spread(Nothing())


def test_elsewhere_every_call_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line, and the daemon goes on."""
    monkeypatch.setattr(sys, "platform", "plan9")
    assert "plan9" in OneCore(LinuxAffinity(), 1).apply().line
    for call in (LinuxAffinity().thread_ids, lambda: LinuxAffinity().keep(0, {0})):
        with pytest.raises(OSError, match="plan9"):
            call()
