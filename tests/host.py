"""Whether this host stood still: an independent witness for tests that run in real time.

On a virtual machine a core is given to somebody else at times, for a tenth of a second and more; whatever runs there then
stands still, as if somebody had stopped it. A test of real processes that fails in such a moment has told nothing about
them. So each core has a witness, a process that does nothing but look at the clock, above everything that tests start:
load of ours does not hold it up, only the host does.

A failed end-to-end test is run again when a witness stood still while it ran, twice at most; otherwise, and then, the
failure counts. One exception in a whole run: of a failure that nothing explains it is asked whether it comes back, because
not all that a host does is seen by witnesses (its network and its disk are not). It counts unless the test passes twice in
a row; a second one in the same run counts at once. The report says which tests were run again and why, and shows in full
how the unexplained one failed: it is to be looked into, not forgotten. Where real time is not permitted there is no
witness, and all failures are unexplained.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from _pytest.reports import TestReport
from _pytest.runner import runtestprotocol

__all__ = ["ATTEMPTS", "PROOFS", "STANDSTILL_MS", "UNEXPLAINED", "Attempts", "Witnesses"]

STANDSTILL_MS = 50
"""A witness that was later than this has stood still [ms]: half of the shortest time after which the gateway acts."""
ATTEMPTS = 3
"""Most runs of a test in which the host stood still."""
UNEXPLAINED = 1
"""Failures in a run of pytest that nothing explains and that may prove not to come back."""
PROOFS = 2
"""So often, one after the other, a test has to pass after one of those."""

WITNESS = """
import os, sys, time
core, parent, file = int(sys.argv[1]), int(sys.argv[2]), open(sys.argv[3], "a", buffering=1)
os.sched_setaffinity(0, {core})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(99))
file.write("there\\n")
last = time.monotonic_ns()
while os.getppid() == parent:
    time.sleep(0.01)
    now = time.monotonic_ns()
    if now - last > int(sys.argv[4]) * 1_000_000:
        file.write(f"{last} {now}\\n")
    last = now
"""


class Witnesses:
    """One for each core of this process.

    Args:
        standstill_ms: Later than this is a standstill [ms].
    """

    def __init__(self, standstill_ms: int = STANDSTILL_MS) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="ta2-host-")
        self._files: list[Path] = []
        self._processes: list[subprocess.Popen[bytes]] = []
        if not hasattr(os, "sched_getaffinity"):
            return
        for core in sorted(os.sched_getaffinity(0))[:16]:
            file = Path(self._folder.name, str(core))
            words = [sys.executable, "-S", "-E", "-c", WITNESS, str(core), str(os.getpid()), str(file)]
            process = subprocess.Popen([*words, str(standstill_ms)], stderr=subprocess.DEVNULL)
            self._processes.append(process)
            self._files.append(file)
            while process.poll() is None and not (file.exists() and file.read_text()):
                time.sleep(0.002)

    def standstill_ms(self, since_ns: int) -> float:
        """Return the longest standstill of a core that ended after an instant [ms]; 0 when there was none.

        Args:
            since_ns: Monotonic time [ns].
        """
        worst_ns = 0
        for file in self._files:
            with contextlib.suppress(OSError):
                for line in file.read_text().splitlines()[1:]:
                    begin_ns, end_ns = map(int, line.split())
                    if end_ns > since_ns:
                        worst_ns = max(worst_ns, end_ns - begin_ns)
        return worst_ns / 1e6

    def close(self) -> None:
        """End them."""
        for process in self._processes:
            process.kill()
            process.wait()
        self._folder.cleanup()


class Attempts:
    """Runs end-to-end tests, some of them again.

    Args:
        witnesses: Of this host.
    """

    def __init__(self, witnesses: Witnesses) -> None:
        self._witnesses = witnesses
        self._unexplained = UNEXPLAINED

    def run(self, item: pytest.Item, nextitem: pytest.Item | None) -> bool:
        """Run a test, again when it fails and that is permitted; report the attempt that counts.

        Args:
            item: The test.
            nextitem: The one after it, None for the last.
        """
        item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        reports = self._unless_the_host_stood_still(item, nextitem)
        failures = [report for report in reports if report.failed]
        if failures and self._unexplained:
            self._unexplained -= 1
            told = "\n".join(_told(report) for report in failures)
            for proof in range(1, PROOFS + 1):
                again = self._unless_the_host_stood_still(item, nextitem)
                if any(report.failed for report in again):
                    break
                if proof == PROOFS:
                    reports = again
                    for report in reports:
                        report.user_properties.append(("unexplained", told))
        for report in reports:
            item.ihook.pytest_runtest_logreport(report=report)
        item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        return True

    def _unless_the_host_stood_still(self, item: pytest.Item, nextitem: pytest.Item | None) -> list[TestReport]:
        """Run a test until it passes, or fails by itself; return the reports of the last attempt."""
        for attempt in range(1, ATTEMPTS + 1):
            begun_ns = time.monotonic_ns()
            reports = runtestprotocol(item, nextitem=nextitem, log=False)
            stood_ms = 0.0
            if attempt < ATTEMPTS and any(report.failed for report in reports):
                stood_ms = self._witnesses.standstill_ms(begun_ns)
            if stood_ms == 0.0:
                break
            item.user_properties.append(("stood still", f"{stood_ms:.0f} ms in attempt {attempt}"))
        return reports


def _told(report: TestReport) -> str:
    """Return how a test failed, with what was kept beside it."""
    return "\n".join([report.longreprtext, *(f"--- {title}\n{text}" for title, text in report.sections)])
