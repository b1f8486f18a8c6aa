"""Many robots on one router: the setpoints' interval of each beside one robot's alone, and what one robot says there.

Each robot is simulated, with its gateway and its member in processes of their own; owners and viewers come from the fleet.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import zenoh

from gateway.api import protocol
from gateway.client.connection.over_zenoh import Credentials, client_configuration
from tests.bench.processor import favour
from tests.bench.table import Row
from tests.e2e.system import ROOT, Process, System, free_port, joint_topics, wait_for

__all__ = ["fleet_rows"]

GOAL_MS = 10.5
DRIVEN = 8
"""Of more robots none is owned, and all are looked at once a second: more do not fit on two cores."""
START_S = 120.0
STOPS = 20_000

ROUTER = """
import sys, time
from tests.fleet.fleets import router
with router(sys.argv[1]):
    print("ready", flush=True)
    time.sleep(3600)
"""
OWNERS = """
import sys, time
from contextlib import ExitStack
from gateway.client import connect
with ExitStack() as all:
    robots = [all.enter_context(connect(name, timeout_s=20.0)) for name in sys.argv[1:]]
    for robot in robots:
        all.enter_context(robot.control()).enable(timeout=60.0)
    print("driving", flush=True)
    while True:
        time.sleep(0.02)
        for robot in robots:
            robot.state
"""
"""Owns robots, holds their arms, and looks at each one's full state at 50 Hz."""


def fleet_rows(folder: Path, robots: int, seconds: float) -> list[Row]:
    """Measure one robot in its fleet, then many; minutes.

    Args:
        folder: For sockets, state and logs.
        robots: How many.
        seconds: Length of each measurement [s].
    """
    alone = _measured(folder / "alone", 1, seconds, tells=True)
    together = _measured(folder / "together", robots, seconds, tells=False)
    worst, single = max(together["p99_ms"], default=0.0), max(alone["p99_ms"])
    rows = [*alone["rows"]]
    if together["p99_ms"]:
        name = f"{robots} robots with full state: worst p99 of an arm's setpoint interval"
        row = Row(
            name=name,
            ours=f"{worst:.2f} ms",
            peer=f"one robot: {single:.2f} ms",
            ratio=f"{worst / single:.2f}x",
            goal=f"<= {GOAL_MS} ms",
            good=worst <= GOAL_MS,
        )
        rows.append(row)
    status, took_s = together["stop"]
    name = f"`ta2 fleet stop --all` with {robots} robots: until all have answered, the command's own start with it"
    rows.append(Row(name=name, ours=f"{took_s:.2f} s", ratio=f"status {status}", goal="status 0", good=status == 0))
    return rows


def _measured(folder: Path, robots: int, seconds: float, *, tells: bool) -> dict[str, Any]:
    locator = f"tcp/127.0.0.1:{free_port()}"
    names = [f"robot-{number}" for number in range(1, robots + 1)]
    folder.mkdir()
    with ExitStack() as ending:
        served = Process("router", ["-u", "-c", ROUTER, locator], folder)
        ending.callback(served.end)
        systems, members = [], []
        for name in names:
            (folder / name).mkdir()
            systems.append(System(folder / name))
            ending.callback(systems[-1].close)
            words = ["fleet", "join", name, "--socket", systems[-1].target, "--open-to-every-user-of-this-host"]
            members.append(Process("member", ["-m", "gateway.cli", *words, "--fleet", locator], folder / name))
            ending.callback(members[-1].end)
        session = zenoh.open(client_configuration(protocol.fleet_address(locator), Credentials(), 20.0))
        ending.callback(session.close)
        asked = f"{protocol.FLEET_ROOT}/*/{protocol.SNAPSHOT_KEY}"

        def answers() -> list[bytes]:
            found = session.get(asked, target=zenoh.QueryTarget.ALL, encoding=protocol.JSON, timeout=5.0)
            return [reply.ok.payload.to_bytes() for reply in found if reply.ok is not None]

        wait_for(
            lambda: sum(map(_is_ready, answers())) == robots,
            "all robots in the fleet",
            START_S,
            tell=systems[0].logs,
        )
        p99_ms: list[float] = []
        rows: list[Row] = []
        if robots <= DRIVEN:
            owners = Process("owners", ["-u", "-c", OWNERS, *names], folder, {"TA2_FLEET": locator})
            ending.callback(owners.end)
            wait_for(lambda: "driving" in owners.text() or not owners.is_running, "the owners", START_S)
            assert owners.is_running, owners.text()
            for system in systems:
                favour(system.sim)
                system.control.ask("reset_stats")
            before_s, counted = _cpu_s(members[0].pid), []
            if tells:
                session.declare_subscriber(
                    f"{protocol.FLEET_ROOT}/{names[0]}/{protocol.SNAPSHOT_KEY}",
                    zenoh.handlers.Callback(lambda sample: counted.append(len(sample.payload)), indirect=False),
                )
            time.sleep(seconds)
            for system in systems:
                commands: Any = system.stats()["commands"]
                p99_ms += [float(commands[topic]["p99_ms"]) for topic in joint_topics()]
            if tells:
                used_s = _cpu_s(members[0].pid) - before_s
                each = f"{used_s / max(len(counted), 1) * 1e6:.0f} us each"
                size = f"{sum(counted) / max(len(counted), 1):.0f} bytes"
                rows = [
                    Row(
                        name="one robot: snapshots a second to the fleet",
                        ours=f"{len(counted) / seconds:.1f}",
                        ratio=size,
                    ),
                    Row(
                        name="its member's processor time, beside its owner's keepalives",
                        ours=f"{used_s / seconds:.3f} cores",
                        ratio=each,
                    ),
                ]
        else:
            until_s = time.monotonic() + seconds
            while time.monotonic() < until_s:
                assert len(answers()) == robots
                time.sleep(1.0)
        if tells:
            rows.append(_router_row(locator))
        began_s = time.monotonic()
        command = [sys.executable, "-m", "gateway.cli", "fleet", "stop", "--all", "--fleet", locator]
        status = subprocess.run(command, cwd=ROOT, capture_output=True, check=False).returncode
        return {"p99_ms": p99_ms, "rows": rows, "stop": (status, time.monotonic() - began_s)}


def _router_row(locator: str) -> Row:
    """Send stops of nobody through the router, from one process to another's worth of session in this one: a lower bound."""
    came: list[float] = []
    address = protocol.fleet_address(locator)
    with (
        zenoh.open(client_configuration(address, Credentials(), 20.0)) as near,
        zenoh.open(client_configuration(address, Credentials(), 20.0)) as far,
    ):
        key = f"{protocol.FLEET_ROOT}/nobody/{protocol.STOP_KEY}"
        far.declare_subscriber(key, zenoh.handlers.Callback(lambda _: came.append(time.monotonic()), indirect=False))
        publisher = near.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
        wait_for(lambda: publisher.matching_status.matching, "the subscriber", START_S)
        began_s = time.monotonic()
        for _ in range(STOPS):
            publisher.put(b"x" * 58)
        wait_for(lambda: len(came) == STOPS, "all of them", START_S)
    return Row(name="messages of 58 bytes through the router", ours=f"{STOPS / (came[-1] - began_s):.0f}/s")


def _is_ready(answer: bytes) -> bool:
    """Whether a gateway sees a robot that can be enabled; one that has just begun says that it has seen nothing yet."""
    try:
        view = protocol.decode_snapshot(answer, protocol.JSON)
    except protocol.Malformed:
        return False
    return view.link.fresh and view.mode is not None


def _cpu_s(pid: int) -> float:
    """Return the processor time of a process so far [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
