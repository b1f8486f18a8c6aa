"""The guard: how long a takeover takes, as the robot sees it, and whether it takes a living daemon for a dead one under load.

bin/bench guard                     ten takeovers, and one minute under 4 CPU hogs
bin/bench guard --minutes 10        the same with the long run
bin/bench guard --daemons 3 --core 1 --minutes 60   only: daemons, robots and hogs together on one core, for so long
"""

from __future__ import annotations

import math
import os
import re
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

from tests.bench.table import Row
from tests.e2e.system import Process, System, reference_loop, wait_for, worst_gap_ms

__all__ = ["crowd_rows", "guard_rows"]

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


STUBBORN = f"""
while True:
    try:
        {MOVER.strip().replace(chr(10), chr(10) + 8 * " ")}
    except Exception as error:
        print(error, flush=True)
        time.sleep(0.5)
        robot.recover('bench')
"""
"""Goes on after each stall, of which there are many where all is crowded."""


class Pinned(System):
    """A system that shares one core with others: robot and daemon, not the guard, which looks for a core by itself."""

    core: ClassVar[int] = 0

    def start_sim(self) -> Process:
        """Start the robot, there."""
        return self._pin(super().start_sim())

    def start_daemon(self) -> Process:
        """Start the daemon, there."""
        return self._pin(super().start_daemon())

    def _pin(self, process: Process) -> Process:
        os.sched_setaffinity(process.pid, {self.core})
        return process


def crowd_rows(folder: Path, minutes: float, daemons: int, core: int) -> list[Row]:
    """Let several daemons move their robots on one core, with hogs; count those that a guard ended.

    Args:
        folder: For sockets and logs.
        minutes: For so long [min].
        daemons: How many.
        core: Which core.
    """
    Pinned.core = core
    systems: list[System] = []
    hogs: list[Process] = []
    try:
        for n in range(daemons):
            (folder / f"crowd{n}").mkdir()
            systems.append(_moving(folder / f"crowd{n}", Pinned, STUBBORN))
            os.sched_setaffinity(systems[-1].clients[0].pid, {core})
        hogs = [Process(f"hog{n}", ["-c", HOG], folder) for n in range(HOGS)]
        for hog in hogs:
            os.sched_setaffinity(hog.pid, {core})
        until = time.monotonic() + 60.0 * minutes
        while time.monotonic() < until and all(system.daemon.is_running for system in systems):
            time.sleep(0.5)
        texts = [system.daemon.text() for system in systems]
    finally:
        for process in hogs:
            os.kill(process.pid, signal.SIGKILL)
            process.end()
        for system in systems:
            system.close()
    for line in "\n".join(texts).splitlines():
        if "its last tick" in line:
            print(line)
    ended = sum(text.count("it is ended") for text in texts)
    late_ms = [float(ms) for text in texts for ms in re.findall(r"a tick came (\d+) ms late", text)]
    return [
        Row(
            name=f"of {daemons} daemons on one core with {HOGS} CPU hogs, ended in {minutes:g} min",
            ours=f"{ended}, {len(late_ms)} ticks > 50 ms late, worst {max(late_ms, default=0.0):.0f} ms",
            peer="none",
            goal="0",
            good=ended == 0,
        )
    ]


def _moving(folder: Path, kind: type[System] = System, program: str = MOVER) -> System:
    """Return a system with a linked guard whose arms move for ever."""
    system = kind(folder)
    with system.connect("bench") as robot:
        wait_for(lambda: robot.state.view.guard.linked, "a linked guard")
        system.client("mover", program)
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
