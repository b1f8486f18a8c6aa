"""The guard: how long a takeover takes, as the robot sees it, and whether it takes a living daemon for a dead one under load.

bin/bench guard                     ten takeovers, and one minute under 4 CPU hogs
bin/bench guard --minutes 10        the same with the long run
"""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

from tests.bench.table import Row
from tests.e2e.system import Process, System, reference_loop, wait_for, worst_gap_ms

__all__ = ["guard_rows"]

TRIALS = 5
GAP_GOAL_MS = 100.0
PATIENCE_S = 5.0
LEFT = "/api/left_arm/joint_cmd"
HOGS = 4
HOG = "while True: pass"

MOVER = """
with robot.control() as own:
    own.enable(timeout=12.0)
    near = {side: HOME[side] * 0.8 for side in HOME}
    while True:
        for goal in (HOME, near):
            own.move_to(goal, speed=0.5).result(timeout=60.0)
"""


def _moving(folder: Path) -> System:
    """Return a system with a linked guard whose arms move for ever."""
    system = System(folder)
    with system.connect("bench") as robot:
        wait_for(lambda: robot.state.view.guard.linked, "a linked guard")
        system.client("mover", MOVER)
        wait_for(lambda: robot.state.view.state == "ACTIVE", "ACTIVE")
        wait_for(lambda: any(abs(v) > 0.1 for v in robot.state.view.arms["left"].dq_ref_radps), "motion at speed")
    return system


def _takeover_ms(folder: Path, number: int) -> tuple[float, float]:
    """Return the worst arm gap at the robot after a daemon's end, and the worst lateness of a plain loop beside it [ms]."""
    folder.mkdir()
    system = _moving(folder)
    try:
        with reference_loop(folder) as worst_ms:
            before = system.count(LEFT)
            system.daemon.send(number)
            until = time.monotonic() + PATIENCE_S
            while system.count(LEFT) <= before + 50:
                if time.monotonic() > until:  # it did not hold: its log says why
                    print(system.daemon.text()[-600:])
                    return math.inf, worst_ms()
            return worst_gap_ms(system.stats()), worst_ms()
    finally:
        system.close()


def _takeover_row(folder: Path, name: str, number: int) -> Row:
    found = [_takeover_ms(folder / f"{name}{n}", number) for n in range(TRIALS)]
    gaps = sorted(gap_ms for gap_ms, _ in found)
    return Row(
        name=f"arm gap at the robot, daemon {name}",
        ours=f"median {gaps[TRIALS // 2]:.0f} ms, worst {gaps[-1]:.0f} ms",
        peer=f"plain loop, worst {max(late_ms for _, late_ms in found):.0f} ms late",
        goal=f"< {GAP_GOAL_MS:.0f} ms",
        good=gaps[-1] < GAP_GOAL_MS,
    )


def _patience_row(folder: Path, minutes: float, wait: Callable[[float], None]) -> Row:
    """Let both arms move under CPU hogs; the daemon that began must be the daemon that ends, and the guard must watch."""
    folder.mkdir()
    system = _moving(folder)
    hogs: list[Process] = []
    try:
        pid = system.daemon.pid
        hogs = [Process(f"hog{n}", ["-c", HOG], folder) for n in range(HOGS)]
        with reference_loop(folder) as worst_ms:
            until = time.monotonic() + 60.0 * minutes
            while time.monotonic() < until and system.daemon.is_running:
                wait(0.5)
            late_ms = worst_ms()
        text = system.daemon.text()
        takeovers, lost = text.count("TAKEN_OVER"), text.count("GUARD_LOST")
        is_alive = system.daemon.is_running and Path(f"/proc/{pid}").exists()
    finally:
        for hog in hogs:
            os.kill(hog.pid, signal.SIGKILL)
            hog.end()
        system.close()
    return Row(
        name=f"false takeovers in {minutes:g} min under {HOGS} CPU hogs",
        ours=f"{takeovers}, guards lost {lost}, daemon {'alive' if is_alive else 'dead'}",
        peer=f"plain loop, worst {late_ms:.0f} ms late",
        goal="0",
        good=is_alive and takeovers == 0 and lost == 0,
    )


def guard_rows(folder: Path, minutes: float) -> list[Row]:
    """Measure takeovers and patience.

    Args:
        folder: For sockets and logs.
        minutes: Length of the run under load [min].
    """
    return [
        _takeover_row(folder, "killed", signal.SIGKILL),
        _takeover_row(folder, "frozen", signal.SIGSTOP),
        _patience_row(folder / "patience", minutes, time.sleep),
    ]
