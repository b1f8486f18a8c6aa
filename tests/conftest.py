"""Rules for every test: how many examples property tests try, which tests come last or together, how long one may take.

Knows nothing of the packages under test; fixtures live beside the tests that use them.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, settings

from tests.interop.bridge_process import is_required, lacking
from tests.thoroughness import PROFILE

# As the daemon does: numpy's idle threads would spin on the core that the next test wants. Before numpy is there.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# No deadline for one example: it would measure the machine, not the code.
_COMMON = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])

# A failure is told as it was found: making it small would take minutes of traces, and is what a run by hand is for.
_FIXED = settings(
    _COMMON,
    derandomize=True,
    database=None,
    print_blob=True,
    phases=(Phase.explicit, Phase.generate),
    report_multiple_bugs=False,
)

# By hand: other examples each time, the smallest one when one fails.
settings.register_profile("dev", parent=_COMMON, max_examples=50)
# The same examples in every run: a red run can be repeated, and a green one stays green.
settings.register_profile("ci", parent=_FIXED, max_examples=50)
# For all interpreters but the first of `bin/test --all-pythons`: what differs between them shows in few examples.
settings.register_profile("brief", parent=_FIXED, max_examples=30)
# By hand, before a release.
settings.register_profile("long", parent=_COMMON, max_examples=20_000, print_blob=True)
# For coverage by mirror: few and fixed, since coverage must not hang on luck.
settings.register_profile("mirror", parent=_FIXED, max_examples=10)

settings.load_profile(PROFILE)

# In the background of a script it is ignored, by every program that a test starts as well: those must hear it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

E2E_TIMEOUT_S = 300
SLOW_TIMEOUT_S = 600
LOG_END_CHARS = 4000
"""So many characters of each process's log are told where an end-to-end test fails."""


def pytest_report_header() -> str:
    """Name the profile, so that a report tells how much was tried."""
    return f"hypothesis profile of this run: {PROFILE} ({settings().max_examples} examples)"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Tell with a failed end-to-end test what its processes had written: why one of them ended stands nowhere else."""
    report = yield
    folder = getattr(item, "funcargs", {}).get("tmp_path")
    if report.failed and isinstance(folder, Path) and item.get_closest_marker("e2e") is not None:
        for log in sorted(folder.rglob("*.log")):
            report.sections.append(
                (f"end of {log.relative_to(folder)}", log.read_text(errors="replace")[-LOG_END_CHARS:])
            )
    return report


_status: list[int] = []


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Keep the status of a session with end-to-end tests for the end."""
    if any(item.get_closest_marker("e2e") for item in getattr(session, "items", ())):
        _status.append(int(exitstatus))


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """End this process after end-to-end tests: their reports are written by now.

    Threads of zenoh and DDS may still be on their way into Python then: the interpreter's own end once aborted such a run,
    all tests of which had passed ("exception not rethrown").
    """
    if _status and not hasattr(config, "workerinput"):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(_status[-1])


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say in one line why tests with a real bridge are left out, where they are."""
    if (what := lacking()) and not is_required():
        terminalreporter.write_line(f"tests with a real bridge are left out: {what}")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Read the tests without the garbage collector: they are many, and there is no garbage in them."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> object | None:
    """With `--dist loadscope`, keep tests of one file in one process, one after the other: they may name fixed ports.

    Those of tests/e2e take ports, sockets and folders of their own and go wherever there is room, but for robots on DDS: such
    a robot comes before everybody else on a core, and two of them would leave nothing of two cores.
    """
    if config.getoption("dist") != "loadscope":
        return None
    from xdist.scheduler import LoadScopeScheduling  # there when its hook is called

    class Scheduling(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            if nodeid.startswith("tests/interop/") or "[dds" in nodeid:
                return "robots on DDS"
            return nodeid if nodeid.startswith("tests/e2e/") else nodeid.partition("::")[0]

    return Scheduling(config, log)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Put end-to-end tests last and slow ones before them, side by side with others first; give both the time they need.

    Of a test with many sets of parameters the first and the last are run where few examples are tried.
    """
    if PROFILE == "brief":
        sets: dict[str, list[pytest.Item]] = {}
        for item in items:
            sets.setdefault(item.nodeid.partition("[")[0], []).append(item)
        kept = {id(item) for found in sets.values() for item in (found[0], found[-1])}
        config.hook.pytest_deselected(items=[item for item in items if id(item) not in kept])
        items[:] = [item for item in items if id(item) in kept]
    # Stable: the order inside each group stays. Side by side the longest begin first, or all would wait for the last of them.
    items.sort(key=_cost, reverse=hasattr(config, "workerinput"))
    for item in items:
        if PROFILE == "long":
            item.add_marker(pytest.mark.timeout(0))
        elif item.get_closest_marker("timeout") is None and _cost(item):
            item.add_marker(pytest.mark.timeout(E2E_TIMEOUT_S if _cost(item) == 2 else SLOW_TIMEOUT_S))


def _cost(item: pytest.Item) -> int:
    if item.get_closest_marker("e2e") is not None:
        return 2
    return 1 if item.get_closest_marker("slow") is not None else 0
