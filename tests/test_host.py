"""Rules of `tests/host.py`: a witness sees a standstill and nothing else; which failures count."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.host import STANDSTILL_MS, Witnesses

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def witnesses() -> Iterator[Witnesses]:
    """One for each core."""
    made = Witnesses()
    yield made
    made.close()


def stolen_ticks() -> int:
    """Return the time that the host gave to others, of all cores [hundredths of a second]."""
    return int(Path("/proc/stat").read_text().split("\n", 1)[0].split()[8])


def test_a_witness_that_stood_still_says_for_how_long(witnesses: Witnesses) -> None:
    """Stopped for a fifth of a second, as a core does that was taken away; what ended before is not told again."""
    alive = [process for process in witnesses._processes if process.poll() is None]
    if not alive:
        pytest.skip("real time is not permitted here, so there is no witness")
    begun_ns = time.monotonic_ns()
    alive[0].send_signal(signal.SIGSTOP)
    time.sleep(0.2)
    alive[0].send_signal(signal.SIGCONT)
    deadline = time.monotonic() + 5.0
    while witnesses.standstill_ms(begun_ns) < 150.0:
        assert time.monotonic() < deadline
        time.sleep(0.005)
    assert witnesses.standstill_ms(time.monotonic_ns() + 10**9) == 0.0


@pytest.mark.skipif(sys.platform != "linux", reason="Linux counts it")
def test_a_witness_is_not_held_up_by_our_own_load(witnesses: Witnesses) -> None:
    """Busy programs on all cores: whoever stands still all the same is held up by the host, whose kernel counts that."""
    command = [
        sys.executable,
        "-S",
        "-c",
        "import time; end = time.monotonic() + 0.5\nwhile time.monotonic() < end: pass",
    ]
    begun_ns, stolen = time.monotonic_ns(), stolen_ticks()
    hogs = [subprocess.Popen(command) for _ in range(2 * (os.cpu_count() or 1))]
    for hog in hogs:
        assert hog.wait(20.0) == 0
    assert witnesses.standstill_ms(begun_ns) == 0.0 or stolen_ticks() - stolen >= STANDSTILL_MS // 20


CONFTEST = """
from tests.conftest import pytest_runtest_makereport, pytest_terminal_summary
from tests.host import Attempts
class Fixed:
    told = {told}
    def standstill_ms(self, since_ns):
        return self.told.pop(0) if self.told else 0.0
attempts = Attempts(Fixed())
def pytest_runtest_protocol(item, nextitem):
    return attempts.run(item, nextitem)
"""
TEST = """
import pathlib
import pytest
tried = pathlib.Path(__file__).with_name("tried")
@pytest.fixture
def number():
    tried.write_text((tried.read_text() if tried.exists() else "") + "x")
    yield len(tried.read_text())
def test_it(number):
    assert number not in {bad}, "it was number " + str(number)
def test_another():
    pass
"""


def judged(folder: Path, told: list[float], bad: set[int], more: str = "") -> tuple[int, str, int]:
    """Run a test that fails in some of its attempts; return its status, its report, and how often it was tried."""
    (folder / "conftest.py").write_text(CONFTEST.format(told=told))
    (folder / "test_it.py").write_text(TEST.format(bad=bad) + more)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", str(folder)], cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout, len((folder / "tried").read_text())


@pytest.mark.parametrize(
    ("told", "bad", "tries", "is_good"),
    [
        ([], {0}, 1, True),
        ([80.0], {1}, 2, True),
        ([80.0, 80.0], {1, 2}, 3, True),
        ([], {1, 2}, 2, False),
        ([], {1, 3}, 3, False),
        ([], {1}, 3, True),
        ([80.0], {1, 2, 3}, 3, False),
        ([80.0, 80.0], {1, 2, 3, 4}, 4, False),
        ([0.0, 80.0], {1, 2}, 4, True),
    ],
    ids=[
        "good",
        "the host's fault",
        "twice the host's fault",
        "it comes back at once",
        "it comes back",
        "it does not come back",
        "the host's fault, then its own",
        "never good",
        "it does not come back, and the host stood still in the proof",
    ],
)
def test_a_failure_counts_unless_the_host_stood_still_or_it_does_not_come_back(
    tmp_path: Path, told: list[float], bad: set[int], tries: int, *, is_good: bool
) -> None:
    """Each attempt has fixtures of its own."""
    status, report, tried = judged(tmp_path, told, bad)
    assert (status, tried) == (0 if is_good else 1, tries), report
    assert ("2 passed" if is_good else "1 failed, 1 passed") in report


def test_an_unexplained_failure_is_shown_in_full_although_it_did_not_come_back(tmp_path: Path) -> None:
    """With the values that the assertion saw."""
    status, report, _ = judged(tmp_path, [], {1})
    assert status == 0
    assert "failed once and nothing explains it, then passed twice: test_it.py::test_it" in report
    assert "AssertionError: it was number 1" in report


def test_a_second_unexplained_failure_of_a_run_counts_at_once(tmp_path: Path) -> None:
    """One in a run may be a freak; two are not."""
    more = """
def test_that_fails_later_too():
    second = tried.with_name("second")
    had, _ = second.exists(), second.touch()
    assert had
"""
    status, report, tried = judged(tmp_path, [], {1}, more)
    assert (status, tried) == (1, 3), report
    assert "1 failed, 2 passed" in report and "test_it.py::test_that_fails_later_too" in report


def test_a_failed_end_to_end_test_tells_what_its_processes_wrote(tmp_path: Path) -> None:
    """Whether it counts or not: why a daemon ended stands in its log alone, and that is gone with the machine."""
    more = """
@pytest.mark.e2e
def test_of_processes(tmp_path, number):
    (tmp_path / "daemon.log").write_text("the first" + " line" + "." * 5000 + "the last" + " words")
    assert number > {worst}
"""
    for worst, status in ((2, 0), (9, 1)):
        folder = tmp_path / str(worst)
        folder.mkdir()
        found, report, _ = judged(folder, [], set(), more.format(worst=worst))
        assert found == status, report
        assert "end of daemon.log" in report and "the last words" in report and "the first line" not in report
