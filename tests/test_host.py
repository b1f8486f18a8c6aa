"""Rules of `tests/host.py`: a witness sees a standstill and nothing else, and only one of those lets a test run again."""

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
import pytest
from tests.host import run_again_after_standstills
class Fixed:
    def __init__(self):
        self.told = {told}
    def standstill_ms(self, since_ns):
        return self.told.pop(0)
fixed = Fixed()
def pytest_runtest_protocol(item, nextitem):
    return run_again_after_standstills(item, nextitem, fixed)
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
    assert number >= {good}
def test_another():
    pass
"""


@pytest.mark.parametrize(
    ("told", "good", "tries", "is_good"),
    [
        ([], 1, 1, True),
        ([0.0], 2, 1, False),
        ([80.0], 2, 2, True),
        ([80.0, 0.0], 3, 2, False),
        ([80.0, 80.0], 3, 3, True),
        ([80.0, 80.0], 4, 3, False),
    ],
    ids=["good", "its own fault", "once", "then its own fault", "twice", "never good"],
)
def test_a_failure_counts_unless_the_host_stood_still_meanwhile(
    tmp_path: Path, told: list[float], good: int, tries: int, *, is_good: bool
) -> None:
    """Each attempt has fixtures of its own; three attempts at most, and the last one counts."""
    (tmp_path / "conftest.py").write_text(CONFTEST.format(told=told))
    (tmp_path / "test_it.py").write_text(TEST.format(good=good))
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", str(tmp_path), str(tmp_path)],
        env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert (tmp_path / "tried").read_text() == "x" * tries, done.stdout
    assert done.returncode == (0 if is_good else 1), done.stdout
    assert ("2 passed" if is_good else "1 failed, 1 passed") in done.stdout
