"""What `bin/test` does without pytest arguments: every test, those end to end before, the quick ones behind them.

End-to-end tests mostly wait, and those that measure time want the machine for themselves: they run in front, one run of
pytest after the other. The quick tests of all interpreters run behind them, one run after the other too, on what the front
leaves idle. What failed is run again at the end by itself, since what ran beside it may have been the cause, or a host that
gave the core to somebody else for a moment: that counts, and the sum names it.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from tests.thoroughness import IS_THOROUGH

ROOT = Path(__file__).resolve().parents[2]

CHANCES = 2
"""So often what failed is run again by itself; a test that fails each time has failed."""

SOME_FAILED, NO_TESTS = 1, 5
"""Exit statuses of pytest: any other but 0 says that the run broke off."""

HEART = "tests/e2e/test_heart.py"
"""What other interpreters prove end to end: machine, zenoh, DDS and forces are the same for all."""

THE_SAME = (
    *("behaviour", "core/motion", "core/separation", "test_kept_apart.py", "test_slowed.py", "test_trajectories.py"),
    *("core/requests/test_cartesian.py", "cli/body", "cli/motion", "cli/policy", "cli/teleop"),
    *("gym", "kinematics", "sim/physics"),
    *("bench", "dataset", "fuzz", "interop", "tooling", "video"),
)
"""Tests that tell nothing of an interpreter: rules of the core, geometry, plots, and files, tools, other people's programs."""

IDLE = """
import os, sys
if hasattr(os, "SCHED_IDLE"):
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
else:
    os.nice(10)
os.execv(sys.argv[1], sys.argv[1:])
"""
"""Runs a command on what others leave idle: who wakes beside it gets a core at once; a low priority alone does not do that."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One run of pytest.

    Attributes:
        name: Of its report.
        python: The interpreter.
        arguments: For pytest.
        parallel: More of them, left out when what failed is run again.
        brief: Whether few examples are tried.
    """

    name: str
    python: str
    arguments: tuple[str, ...]
    parallel: tuple[str, ...] = ()
    brief: bool = False


@dataclass(slots=True, kw_only=True)
class Plan:
    """What runs in front, and behind it."""

    front: list[Run] = field(default_factory=list)
    behind: list[Run] = field(default_factory=list)


def plan(versions: dict[str, str], *, cores: int, beside: int, is_thorough: bool, has_bridge: bool) -> Plan:
    """Return what is to be run.

    Args:
        versions: Interpreters by their version, e.g. `3.11`; the default one, which tries most, first.
        cores: So many quick tests run side by side.
        beside: So many end-to-end tests do.
        is_thorough: Whether tests run that take long to prove a little more.
        has_bridge: Whether those run that need a real bridge.
    """
    made = Plan()
    default, *others = versions
    left_out = ("" if is_thorough else " and not thorough") + ("" if has_bridge else " and not interop")
    files = tuple(sorted(_that_name("e2e")))
    slow_ones = ("-n", str(beside), "--dist", "loadscope")
    quick = ("-n", str(min(cores, 8)), "--dist", "worksteal")
    made.front = [
        Run(
            name=f"{default}-e2e",
            python=versions[default],
            arguments=("-m", f"e2e and not alone{left_out}", *files),
            parallel=slow_ones,
        ),
        Run(name=f"{default}-alone", python=versions[default], arguments=("-m", f"alone{left_out}", *files)),
    ]
    slow = "" if is_thorough else " and not thorough"
    made.behind = [
        Run(name=f"{default}-quick", python=versions[default], arguments=("-m", f"not e2e{slow}"), parallel=quick)
    ]
    ignored = tuple(f"--ignore=tests/{name}" for name in THE_SAME)
    for version in others:
        arguments = ("-m", "e2e and not thorough and not interop and not forces", HEART)
        made.front.append(Run(name=f"{version}-e2e", python=versions[version], arguments=arguments, brief=True))
        arguments = ("-m", "not e2e and not slow and not thorough", *ignored)
        made.behind.append(
            Run(name=f"{version}-quick", python=versions[version], arguments=arguments, parallel=quick, brief=True)
        )
    return made


def _that_name(marker: str) -> Iterator[str]:
    """Only these files are read for its tests: collecting all would take as long as some of them."""
    for path in (ROOT / "tests").rglob("test_*.py"):
        if re.search(rf"\b{marker}\b", path.read_text(encoding="utf-8")):
            yield str(path.relative_to(ROOT))


class Runner:
    """Runs a plan; what it found lies in reports.

    Args:
        folder: For reports, logs and what pytest remembers of failures.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._statuses: dict[str, int] = {}
        self._running: subprocess.Popen[bytes] | None = None
        self._is_ended = threading.Event()

    def run(self, plan: Plan) -> bool:
        """Run all of it, and again what failed; return whether all is well now."""
        behind = threading.Thread(target=self._run_behind, args=(plan.behind,), daemon=True)
        behind.start()
        for run in plan.front:
            print(f"\n== {run.name}", flush=True)
            self._statuses[run.name] = self._status(run, self._command(run, run.parallel))
        behind.join()
        for run in plan.behind:
            print(f"\n== {run.name}\n{self._log(run).read_text(encoding='utf-8', errors='replace')}", flush=True)
        runs = plan.front + plan.behind
        for chance in range(1, CHANCES + 1):
            for run in runs:
                if self._statuses[run.name] == SOME_FAILED:
                    print(f"\n== {run.name}: what failed, once more by itself", flush=True)
                    again = ("--last-failed", "--last-failed-no-failures", "none")
                    self._statuses[run.name] = self._status(run, self._command(run, again, f"-again-{chance}"))
        return not any(self._statuses.values())

    def close(self) -> None:
        """End what runs behind."""
        self._is_ended.set()
        if self._running is not None and self._running.poll() is None:
            os.killpg(self._running.pid, signal.SIGTERM)
            self._running.wait()

    def _run_behind(self, runs: Sequence[Run]) -> None:
        for run in runs:
            if self._is_ended.is_set():
                return
            command = [sys.executable, "-I", "-c", IDLE, *self._command(run, run.parallel)]
            with self._log(run).open("wb") as log:
                self._statuses[run.name] = self._status(run, command, log)

    def _log(self, run: Run) -> Path:
        return self._folder / f"{run.name}.log"

    def _command(self, run: Run, more: Sequence[str], report: str = "") -> list[str]:
        path = self._folder / f"{run.name}{report}.xml"
        kept = ["-o", f"cache_dir={self._folder / run.name}", "-o", "junit_family=xunit2", f"--junitxml={path}"]
        # The limit on hanging is longer than usual, since others may come first.
        return [run.python, "-m", "pytest", *kept, "-o", "timeout=300", *more, *run.arguments]

    def _status(self, run: Run, command: list[str], log: IO[bytes] | None = None) -> int:
        """Run a command; a run without tests is well, one that broke off leaves a report that says so."""
        environment = dict(os.environ)
        if run.brief:
            environment |= {"TA2_HYPOTHESIS_PROFILE": "brief", "TA2_TRACES": ""}
        is_behind = log is not None
        process = subprocess.Popen(
            command,
            cwd=ROOT,
            env=environment,
            stdin=subprocess.DEVNULL if is_behind else None,
            stdout=log,
            stderr=subprocess.STDOUT if is_behind else None,
            start_new_session=is_behind,
        )
        if is_behind:
            self._running = process
        status = process.wait()
        if status == NO_TESTS:
            return 0
        if status not in (0, SOME_FAILED):
            (self._folder / f"{run.name}-broken.xml").write_text(
                "<testsuite><testcase name='broke off'><error/></testcase></testsuite>"
            )
        return status


def closing_line(folder: Path, seconds: int) -> str:
    """Return the sum of all reports in a folder, in the form of pytest's own closing line, after what failed at first."""
    verdicts: dict[tuple[str, ...], list[str]] = {}
    for path in sorted(folder.glob("*.xml"), key=lambda path: ("-again-" in path.stem, path.stem)):
        name = path.stem.partition("-again-")[0]
        found: dict[tuple[str, ...], str] = {}
        for case in ElementTree.parse(path).iter("testcase"):
            key = name, case.get("classname", ""), case.get("name", "")
            is_failed = case.find("failure") is not None or case.find("error") is not None
            verdict = "failed" if is_failed else "skipped" if case.find("skipped") is not None else "passed"
            found[key] = min(
                verdict, found.get(key, verdict)
            )  # failed before passed, should one test stand there twice
        for key, verdict in found.items():
            verdicts.setdefault(key, []).append(verdict)
    lines = [
        f"failed at first, {all_of_it[-1]} by itself: {' '.join(key)}"
        for key, all_of_it in verdicts.items()
        if all_of_it[0] == "failed" and len(all_of_it) > 1
    ]
    last = [all_of_it[-1] for all_of_it in verdicts.values()]
    said = ", ".join(
        f"{last.count(what)} {what}" for what in ("failed", "passed", "skipped") if what in last or what == "passed"
    )
    span = f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
    return "\n".join([*lines, f" {said} in {seconds}.00s ({span}) ".center(80, "=")])


def main() -> int:
    """Run every test; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("interpreters", nargs="+", metavar="VERSION=PYTHON", help="the default one first")
    versions = dict(word.split("=", 1) for word in parser.parse_args().interpreters)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    chosen = plan(
        versions,
        cores=cores,
        beside=int(os.environ.get("TA2_BESIDE") or min(cores, 6)),
        is_thorough=IS_THOROUGH,
        has_bridge=len(versions) > 1 or os.environ.get("TA2_INTEROP") == "required",
    )
    started = time.monotonic()
    folder = Path(tempfile.mkdtemp(prefix="ta2-tests-"))
    runner = Runner(folder)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        is_well = runner.run(chosen)
        for path in sorted(Path(os.environ.get("TA2_ARTEFACTS") or folder / "none").rglob("*")):
            if path.is_file():
                print(f"left to be looked at: {path}, {path.stat().st_size // 1024} KiB")
        print(closing_line(folder, int(time.monotonic() - started)), flush=True)
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    finally:
        runner.close()
        shutil.rmtree(folder, ignore_errors=True)
    return 0 if is_well else 1


if __name__ == "__main__":
    sys.exit(main())
