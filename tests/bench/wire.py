"""Over the wire: setpoint intervals at the robot, CPU under full state, and latency from a client to the robot.

Every figure of ours stands beside a plain peer in the same seconds on the same machine: a zenoh-python publisher with an
absolute sleep and a simulated robot of its own, and a process that only subscribes with empty callbacks.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gateway.sim.remote import SimControl
from tests.bench.dds import dds_rows
from tests.bench.latency import latency_rows
from tests.bench.processor import cpu_row, family, favour, peer_of
from tests.bench.streams import full_load_rows
from tests.bench.table import Row
from tests.e2e.system import Process, System, free_port, joint_topics, wait_for

__all__ = ["wire_rows"]

WINDOW_S = 8.0

PEER_PUBLISHER = """
import json, sys, time, zenoh
from cdr_types import encode
from cdr_types.messages import sensor_msgs
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import ARM_JOINTS
from gateway.values import Side
config = {"mode": "client", "connect": {"endpoints": [sys.argv[1]]}, "scouting": {"multicast": {"enabled": False}}}
session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
messages = [(session.declare_publisher(f"api/{s}_arm/joint_cmd"), encode(sensor_msgs.JointState(name=list(ARM_JOINTS[s]),
    position=list(HOME_Q_RAD[s]), velocity=[0.0] * 7, effort=[0.0] * 7))) for s in Side]
due = time.monotonic_ns()
print("ready", flush=True)
while True:
    due += 10_000_000
    rest = due - time.monotonic_ns()
    if rest > 0:
        time.sleep(rest / 1e9)
    for publisher, payload in messages:
        publisher.put(payload)
"""
"""A plain publisher of both arms' setpoints: absolute sleep, default settings of zenoh."""

HOG = "while True: pass"


@contextmanager
def _hogs(count: int) -> Iterator[None]:
    processes = [subprocess.Popen([sys.executable, "-S", "-c", HOG]) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _pass(seconds: float) -> None:
    end = time.monotonic() + seconds
    wait_for(lambda: time.monotonic() >= end, "the window to pass", seconds + 5.0)


def _intervals(control: SimControl) -> dict[str, float]:
    commands: Any = control.ask("stats")["commands"]
    streams = [commands[topic] for topic in joint_topics()]
    return {key: max(float(s[key]) for s in streams) for key in ("p50_ms", "p99_ms", "max_ms")} | {
        "rate_hz": min(float(s["rate_hz"]) for s in streams)
    }


def _interval_rows(title: str, system: System, peer: SimControl, hogs: int) -> list[Row]:
    with _hogs(hogs):
        _pass(0.5)
        for control in (system.control, peer):
            control.ask("reset_stats")
        _pass(WINDOW_S)
        ours, plain = _intervals(system.control), _intervals(peer)
    rows = [
        Row(
            name=f"setpoint rate at the robot, {title}",
            ours=f"{ours['rate_hz']:.2f} Hz",
            peer=f"{plain['rate_hz']:.2f} Hz",
            goal="100 Hz +- 0.5",
            good=abs(ours["rate_hz"] - 100.0) < 0.5,
        )
    ]
    for key, name in (("p50_ms", "p50"), ("p99_ms", "p99"), ("max_ms", "max")):
        rows.append(
            Row(
                name=f"interval at the robot {name}, {title}",
                ours=f"{ours[key]:.2f} ms",
                peer=f"{plain[key]:.2f} ms",
                ratio=f"{ours[key] / plain[key]:.2f}x",
            )
        )
    return rows


def _cpu_row(title: str, system: System, subscriber: Process, goal: float | None = None) -> Row:
    """The daemon alone where there is a goal for it alone, else with its guard."""
    name, whole = f"CPU of daemon and guard, full state, {title}", family(system.daemon.pid)
    if goal is not None:
        name, whole = f"CPU of the daemon, full state, {title}", whole[:1]
    return cpu_row(name, whole, subscriber.pid, _pass, WINDOW_S, goal)


def wire_rows(folder: Path) -> list[Row]:
    """Measure everything that needs processes; about four minutes."""
    rows: list[Row] = []
    peer_endpoint = f"tcp/127.0.0.1:{free_port()}"
    peer_sim = Process("peer-sim", ["-m", "gateway.cli", "sim", "--listen", peer_endpoint], folder)
    system = System(folder)
    helpers: list[Process] = []
    try:
        system.connect("bench").close()  # it sees a live robot now
        helpers.append(Process("subscriber", peer_of(system.endpoint), folder))
        wait_for(lambda: "ready" in helpers[-1].text(), "the plain subscriber")
        rows.append(_cpu_row("nobody watches", system, helpers[-1], 1.6))
        with system.connect("bench") as robot, wait_for(lambda: SimControl(peer_endpoint), "the peer's robot") as peer:
            rows.append(_cpu_row("a client watches at 50 Hz", system, helpers[-1]))
            for process in (system.sim, peer_sim):
                favour(process)
            helpers.append(Process("publisher", ["-u", "-c", PEER_PUBLISHER, peer_endpoint], folder))
            wait_for(lambda: "ready" in helpers[-1].text(), "the plain publisher")
            with robot.control() as own:
                own.enable(timeout=12.0)
                rows.append(_cpu_row("both arms held, a client watches", system, helpers[0]))
                helpers.pop(0).end()
                rows += _interval_rows("quiet", system, peer, 0)
                rows += _interval_rows("4 CPU hogs", system, peer, 4)
                rows += latency_rows(system.endpoint, own)
    finally:
        for process in (*helpers, peer_sim):
            process.end()
        system.close()
    return [*rows, *full_load_rows(folder, _pass, WINDOW_S), *dds_rows(folder, _pass)]
