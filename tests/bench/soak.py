"""A gateway for hours, with all that a lab has around it: whether anything grows, and whether its setpoints stay in time.

bin/bench soak --minutes 120        an owner, 18 who look on, a page, a recorder; only when asked for

The peer of each figure is the same in the first tenth, once everything had run for a minute.
"""

from __future__ import annotations

import json
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gateway.robot.topics import FSM_ENABLE
from tests.bench.processor import cpu_s, family, favour
from tests.bench.table import Row
from tests.e2e.system import Process, System, free_port, joint_topics, wait_for

__all__ = ["PAGES", "driven", "soak_rows"]

WARM_S = 60.0
LOOK_S = 10.0
WATCHERS, SESSIONS = 3, 6
"""Programs that look on, and the sessions of each."""
HEARTBEAT_GOAL_MS, GAP_GOAL_MS = 200.0, 100.0
INTERVAL_GOAL = 1.1
GROWTH_GOAL_MIB, HANDLES_GOAL = 16.0, 8

OWNER = """
import math
from contextlib import ExitStack
from itertools import count
from gateway.errors import GatewayError
starts = None
with robot.control() as own:
    while True:
        try:
            with ExitStack() as streams:
                own.enable(timeout=12.0)
                own.left_gripper.grip(0.5)
                own.right_gripper.grip(0.5)
                outs = [streams.enter_context(arm.stream(rate_hz=50)) for arm in (own.left_arm, own.right_arm)]
                starts = starts or [out.q.copy() for out in outs]
                print("driving", flush=True)
                begun = time.monotonic()
                for n in count():
                    passed_s = time.monotonic() - begun
                    for out, start in zip(outs, starts):
                        target = start.copy()
                        target[6] += 0.15 * (1 - math.cos(1.5 * passed_s))
                        out.set(target)
                    if n % 5 == 0:
                        own.chassis.set_velocity(0.05 * math.cos(passed_s), 0.0, 0.0)
                    outs[0].tick()
        except GatewayError as error:
            print("interrupted", error, flush=True)
            time.sleep(1.0)
"""
"""Commands everything until it is ended, and goes on after it was interrupted, as a lab's program does."""

BARE_LOOP = """
import time
print("ready", flush=True)
while True:
    at = time.monotonic()
    time.sleep(0.01)
    late_ms = 1e3 * (time.monotonic() - at - 0.01)
    if late_ms > 30.0:
        print(f"late {late_ms:.0f}", flush=True)
"""
"""Says when this machine lets nobody run, real time or not: three late turns of it are what old state is."""

WATCHER = """
sessions = [robot, *(connect(TARGET, name=f"watcher{n}", timeout_s=10.0) for n in range(SESSIONS - 1))]
print("looking", flush=True)
while True:
    for session in sessions:
        session.state.left_arm.q
    time.sleep(0.1)
"""


PAGES = """
import asyncio, sys
from websockets.asyncio.client import connect
token, port, many = sys.argv[1:]
known = {"Authorization": f"Bearer {token}"}
heard = set()
async def look(number):
    async with connect(f"ws://127.0.0.1:{port}/api/live", additional_headers=known, max_size=None) as socket:
        while True:
            await asyncio.wait_for(socket.recv(), 10.0)
            heard.add(number)
            if len(heard) == int(many):
                print("open", flush=True)
                heard.add(None)
async def main():
    await asyncio.gather(*map(look, range(int(many))))
asyncio.run(main())
"""
"""So many pages, each of which takes all that it is told."""


@dataclass(frozen=True)
class _Look:
    """What was seen in some seconds.

    Attributes:
        heartbeat_ms: Longest gap of the heartbeat at the robot.
        gap_ms: Longest gap of an arm's setpoints there.
        p99_ms: Of their intervals, the worse of both arms.
        rss_mib: Resident memory of each process, by what it is called.
        handles: Its open files and threads.
    """

    heartbeat_ms: float
    gap_ms: float
    p99_ms: float
    rss_mib: dict[str, float]
    handles: dict[str, int]


def _look(system: System, watched: dict[str, int]) -> _Look:
    system.control.ask("reset_stats")
    time.sleep(LOOK_S)
    commands: dict[str, Any] = system.stats()["commands"]
    arms = [commands[topic] for topic in joint_topics()]
    proc = {name: Path(f"/proc/{pid}") for name, pid in watched.items()}
    rss = {n: int((p / "status").read_text().split("VmRSS:")[1].split()[0]) / 1024 for n, p in proc.items()}
    handles = {n: len(list((p / "fd").iterdir())) + len(list((p / "task").iterdir())) for n, p in proc.items()}
    return _Look(
        heartbeat_ms=float(commands[FSM_ENABLE]["worst_gap_alive_ms"]),
        gap_ms=max(float(arm["worst_gap_alive_ms"]) for arm in arms),
        p99_ms=max(float(arm["p99_ms"]) for arm in arms),
        rss_mib=rss,
        handles=handles,
    )


def driven(folder: Path, ending: ExitStack) -> tuple[System, Process]:
    """Return a system with an owner that drives everything; both end with `ending`."""
    system = System(folder)
    ending.callback(system.close)
    system.connect("first").close()
    owner = system.client("owner", OWNER)
    wait_for(lambda: "driving" in owner.text(), "an owner", 30.0, tell=owner.text)
    return system, owner


def soak_rows(folder: Path, minutes: float) -> list[Row]:
    """Run all of it for so long.

    Args:
        folder: For sockets, logs and the recording.
        minutes: From the moment on when everything runs [min].
    """
    looks: list[_Look] = []
    with ExitStack() as ending:
        system, owner = driven(folder, ending)
        text = WATCHER.replace("SESSIONS", str(SESSIONS))
        others = [system.client(f"watchers{n}", text) for n in range(WATCHERS)]
        port = str(free_port())

        def started(name: str, *words: str) -> Process:
            others.append(Process(name, list(words), folder))
            ending.callback(others[-1].end)
            return others[-1]

        at = ("--socket", system.target)
        record = started("record", "-m", "gateway.cli", "record", *at, "--out", str(folder / "bag"))
        web = started("web", "-m", "gateway.cli", "web", *at, "--port", port, "--json")
        said = wait_for(lambda: web.text().splitlines(), "the page's address", 30.0, tell=web.text)
        page = started("page", "-u", "-c", PAGES, json.loads(said[0])["token"], port, "1")
        bare = started("bare", "-u", "-c", BARE_LOOP)
        for other, word in (
            (page, "open"),
            (record, "messages"),
            (bare, "ready"),
            *((w, "looking") for w in others[:WATCHERS]),
        ):
            wait_for(lambda other=other, word=word: word in other.text(), "everybody", 60.0, tell=other.text)
        for process in (owner, bare, system.sim):  # the robot is another computer, and the loop's peer runs as it does
            favour(process)
        daemon, guard = family(system.daemon.pid)[:2]
        watched = {"daemon": daemon, "guard": guard, "record": record.pid, "web": web.pid, "robot": system.sim.pid}
        time.sleep(WARM_S)
        begun_s, used_s = time.monotonic(), {name: cpu_s(pid) for name, pid in watched.items()}
        with suppress(FileNotFoundError, KeyError, KeyboardInterrupt):  # somebody is gone: what there is says so
            while time.monotonic() < begun_s + 60.0 * minutes:
                looks.append(_look(system, watched))
            for name, pid in watched.items():
                used_s[name] = (cpu_s(pid) - used_s[name]) / (time.monotonic() - begun_s)
        lost = [other.name for other in (owner, *others, system.daemon) if not other.is_running]
        told = system.daemon.text()
        stops = [line for line in owner.text().splitlines() if line.startswith("interrupted")]
        late_ms = [int(line.split()[1]) for line in bare.text().splitlines() if line.startswith("late")]
        if lost or stops:
            print(owner.text()[-600:], told[-2000:], sep="\n")
    lost += [code for code in ("TAKEN_OVER", "GUARD_LOST", "Traceback") if code in told]
    rows = _rows(looks, lost, used_s, minutes)
    interrupted = Row(
        name="times that the owner was interrupted",
        ours=f"{len(stops)}",
        peer=f"bare loop late {len(late_ms)} times, {max(late_ms, default=0)} ms",
        goal="no more than the peer",
        good=len(stops) <= len(late_ms),
    )
    return [rows[0], interrupted, *rows[1:]]


def _rows(looks: list[_Look], lost: list[str], used_s: dict[str, float], minutes: float) -> list[Row]:
    tenth = max(1, len(looks) // 10)
    first, last = looks[:tenth], looks[-tenth:]
    length = f"{len(looks) * LOOK_S / 60.0:.0f} of {minutes:g} min"
    is_whole = len(looks) * LOOK_S > 0.9 * 60.0 * minutes  # a look takes a little longer
    rows = [Row(name=f"lost in {length}", ours=", ".join(lost) or "nobody", goal="nobody", good=is_whole and not lost)]
    if not looks:
        return rows
    for called, name, goal in (
        ("longest gap of the heartbeat", "heartbeat_ms", HEARTBEAT_GOAL_MS),
        ("longest gap of an arm's setpoints", "gap_ms", GAP_GOAL_MS),
    ):
        worst, before = (max(getattr(look, name) for look in some) for some in (looks, first))
        rows.append(
            Row(name=called, ours=f"{worst:.0f} ms", peer=f"{before:.0f} ms", goal=f"< {goal:g} ms", good=worst < goal)
        )
    p99, before = (float(np.median([look.p99_ms for look in some])) for some in (last, first))
    rows.append(
        Row(
            name="p99 of the setpoints' interval, median of the last tenth",
            ours=f"{p99:.1f} ms, worst {max(look.p99_ms for look in looks):.1f}",
            peer=f"{before:.1f} ms",
            ratio=f"{p99 / before:.2f}x",
            goal=f"<= {INTERVAL_GOAL:g}x",
            good=p99 <= INTERVAL_GOAL * before,
        )
    )
    for name in looks[0].rss_mib:
        mib, mib_before = (float(np.median([look.rss_mib[name] for look in some])) for some in (last, first))
        count, count_before = (float(np.median([look.handles[name] for look in some])) for some in (last, first))
        rows.append(
            Row(
                name=f"{name}: memory; files, threads; of a core",
                ours=f"{mib:.0f} MiB; {count:.0f}; {100 * used_s[name]:.1f} %",
                peer=f"{mib_before:.0f} MiB; {count_before:.0f}",
                ratio=f"{mib - mib_before:+.1f} MiB; {count - count_before:+.0f}",
                goal=f"<= {GROWTH_GOAL_MIB:+g} MiB; {HANDLES_GOAL:+d}",
                good=mib - mib_before <= GROWTH_GOAL_MIB and count - count_before <= HANDLES_GOAL,
            )
        )
    return rows
