"""`ta2 check` on a real simulated robot: nothing but a look, with consent, and with something wrong."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from gateway.cli.check.rows import MOVING, POINTS
from gateway.sim.remote import SimControl
from tests.e2e.system import ROOT, Process, free_port, run_apart, wait_for

pytestmark = [pytest.mark.e2e, pytest.mark.sim_only("a check starts what it needs itself")]

Robots = Callable[..., str]
ATTEMPTS = 4
"""Rates and reactions are the robot's and this machine's: one that is busy with something else is looked at again."""


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[tuple[str, SimControl]]:
    """A simulated robot: where it listens, and its own channel."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    sim = Process("sim", ["-m", "gateway.sim", "--listen", endpoint], tmp_path)
    control = None
    try:
        control = wait_for(lambda: SimControl(endpoint), "the simulated robot")
        wait_for(lambda: control.ask("ping"), "its first answer")
        run_apart(sim.pid)
        yield endpoint, control
    finally:
        if control is not None:
            control.close()
        sim.end()


def check(endpoint: str, *words: str) -> tuple[int, dict[str, Any]]:
    """Return exit status and report of `ta2 check`."""
    command = [sys.executable, "-m", "gateway.cli", "check", "--robot", endpoint, "--json", *words]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=300)
    assert done.stdout, done.stderr
    return done.returncode, json.loads(done.stdout)


def of(report: dict[str, Any], verdict: str) -> dict[str, str]:
    """Return the rows of a verdict, and what was found."""
    return {row["name"]: row["found"] for row in report["rows"] if row["verdict"] == verdict}


def passed(endpoint: str, *words: str) -> dict[str, Any]:
    """Return the report of a check in which nothing failed."""
    wrong = []
    for _ in range(ATTEMPTS):
        status, report = check(endpoint, *words)
        assert (status == 0) == report["ok"]
        if report["ok"]:
            return report
        wrong.append(of(report, "fail"))
    pytest.fail(f"never well: {wrong}")


def test_a_healthy_robot_passes_and_nothing_was_sent(robot: tuple[str, SimControl], tmp_path: Path) -> None:
    """Every row but those that move; the robot has seen no command. The page is written beside."""
    endpoint, control = robot
    report = passed(endpoint, "--html", str(tmp_path / "report.html"))
    looked = [name for name in POINTS if name not in {*MOVING, "video"}]
    assert set(of(report, "pass")) == set(looked) and set(of(report, "skipped")) == {"video", *MOVING}
    assert not any(topic["count"] for topic in control.ask("stats")["commands"].values())
    assert "ta2 check" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_with_consent_the_robot_moves_stops_by_itself_and_is_left_paused(robot: tuple[str, SimControl]) -> None:
    """All that a standard robot has; two gateways were killed on the way, none is left."""
    endpoint, control = robot
    report = passed(endpoint, "--consent", "move")
    moved = [name for name in MOVING if name not in ("lift_stop", "home")]
    assert set(of(report, "pass")) >= set(moved) and not of(report, "unknown")
    assert wait_for(lambda: control.ask("state")["fsm"] in ("PAUSE", 0) or None, "PAUSE")
    assert not any(control.ask("state")["chassis"]["velocity"])


def test_a_robot_in_vr_mode_fails_there_and_is_not_moved(robot: tuple[str, SimControl]) -> None:
    """Whoever agreed."""
    endpoint, control = robot
    control.ask("fault", fault="vr_mode")
    status, report = check(endpoint, "--consent", "move")
    assert status == 1 and "mode" in of(report, "fail") and set(of(report, "skipped")) >= set(MOVING)
    assert not any(topic["count"] for topic in control.ask("stats")["commands"].values())
