"""Fifty pages open beside a control loop: the setpoints' interval with them and without, taking turns in one run."""

from __future__ import annotations

import json
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from tests.bench.processor import cpu_s, favour
from tests.bench.soak import PAGES, driven
from tests.bench.table import Row
from tests.e2e.system import Process, System, free_port, joint_topics, wait_for

__all__ = ["pages_rows"]

MANY = 50
TURNS = 3
GOAL = 1.1


def pages_rows(folder: Path, seconds: float) -> list[Row]:
    """Measure a loop that streams to both arms with no page open and with fifty, and what they cost.

    Args:
        folder: For sockets and logs.
        seconds: Length of each turn [s].
    """
    with ExitStack() as ending:
        system, owner = driven(folder, ending)
        port = str(free_port())
        web = Process("web", ["-m", "gateway.cli", "web", "--at", system.target, "--port", port, "--json"], folder)
        ending.callback(web.end)
        said = wait_for(lambda: web.text().splitlines(), "the page's address", 30.0, tell=web.text)
        token = json.loads(said[0])["token"]
        for process in (owner, system.sim):  # the robot is another computer
            favour(process)
        watched = [system.daemon.pid, web.pid]
        p99_ms: dict[bool, list[float]] = {False: [], True: []}
        used: dict[bool, list[list[float]]] = {False: [], True: []}
        for turn in range(2 * TURNS):
            is_looked_at = turn % 2 == 1
            with ExitStack() as closing:
                if is_looked_at:
                    pages = Process(f"pages{turn}", ["-u", "-c", PAGES, token, port, str(MANY)], folder)
                    closing.callback(pages.end)
                    wait_for(lambda pages=pages: "open" in pages.text(), "the pages", 30.0, tell=pages.text)
                _streams(system, owner)
                before = [cpu_s(pid) for pid in watched]
                time.sleep(seconds)
                commands: Any = system.stats()["commands"]
                p99_ms[is_looked_at] += [
                    float(commands[topic]["p99_ms"]) for topic in joint_topics() if topic in commands
                ]
                shares = [(cpu_s(pid) - was) / seconds for pid, was in zip(watched, before, strict=True)]
                used[is_looked_at].append(shares)
        assert owner.is_running, owner.text()
    without_ms, with_ms = (float(np.median(p99_ms[which])) for which in (False, True))
    (daemon_0, web_0), (daemon, web_s) = (np.median(used[which], axis=0) for which in (False, True))
    return [
        Row(
            name=f"{MANY} pages open: p99 of an arm's setpoint interval",
            ours=f"{with_ms:.2f} ms",
            peer=f"no page: {without_ms:.2f} ms",
            ratio=f"{with_ms / without_ms:.2f}x",
            goal=f"<= {GOAL:g}x",
            good=with_ms <= GOAL * without_ms,
        ),
        Row(name="processor time of the daemon", ours=f"{daemon:.3f} cores", peer=f"{daemon_0:.3f} cores"),
        Row(name="processor time of `ta2 web`", ours=f"{web_s:.3f} cores", peer=f"{web_0:.3f} cores"),
    ]


def _streams(system: System, owner: Process) -> None:
    """Wait until both arms are streamed to, and count from then on: a busy machine interrupts owners, who enable anew."""
    system.control.ask("reset_stats")

    def both() -> bool:
        commands: Any = system.stats()["commands"]
        return all(commands.get(topic, {"count": 0})["count"] for topic in joint_topics())

    wait_for(both, "both streams", 30.0, tell=owner.text)
    system.control.ask("reset_stats")
