"""Stops and an owner's streams while others flood the daemon's socket, each beside its peer in the same seconds.

bin/bench stop                      150 stops under each flood
bin/bench stop --stops 1000         enough for the 99.9th percentile

A stop is a put on `ta2/stop`, a line in the pipe beside the socket, or, without a flood, a POST to `ta2 web` by a connection of
its own, in turn, and has arrived when the chassis' stop frame reaches a subscriber at the robot's router: two wires and the
control loop between them. Its peer is a put to a process that only subscribes, over a socket that nobody floods. Stops are
sent between the instants at which stop frames leave anyway.

An owner streams targets to both arms under the same floods; his peer is himself before the flood.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from tests.bench.processor import favour
from tests.bench.table import Row
from tests.e2e.system import Process, System, free_port, joint_topics, wait_for, worst_gap_ms
from tests.e2e.test_floods import OWNER

__all__ = ["stop_rows"]

STREAM_S = 3.0
P50_GOAL_MS, WORST_GOAL_MS = 3.0, 20.0
WEB_GOALS_MS = 50.0, 100.0
GAP_GOAL_MS = 100.0
INTERVAL_GOAL = 1.1
RSS_GOAL_MIB = 64
FLOODS = {
    "keepalives": 4, "targets": 4, "wildcards": 4, "own_keys": 4, "large_puts": 4, "questions": 4, "large_questions": 4,
    "chunks": 4, "snapshots": 4, "pings": 4, "sessions": 1, "tokens": 2, "half_open": 4,
    "deaf": 1, "spin": 4,
}  # fmt: skip
"""Kind of flood (see `tests/e2e/flooder.py`) -> processes."""

SUBSCRIBER = """
import json, sys, time, zenoh
config = {"mode": "router", "listen": {"endpoints": [sys.argv[1]]}, "scouting": {"multicast": {"enabled": False}}}
delays = []
def take(sample):
    delays.append(time.monotonic_ns() - int(sample.payload.to_bytes()))
def tell(query):
    with query:
        query.reply("bench/delays", json.dumps(delays))
session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
held = [session.declare_subscriber("bench/stop", take), session.declare_queryable("bench/delays", tell)]
print("ready", flush=True)
time.sleep(3600)
"""

PROBER = """
import http.client, json, os, random, sys, threading, time
from pathlib import Path
from gateway.api.stop_pipe import drop_stop
from tests.fuzz.attacker import connect
daemon, peer, robot = (connect(endpoint) for endpoint in sys.argv[1:4])
came, frames = threading.Event(), []
def hear(sample):
    frames.append(time.monotonic_ns())
    came.set()
robot.declare_subscriber("api/chassis/velocity", hear)
PERIOD_NS = 50_000_000
ways = {
    "put": lambda: daemon.put("ta2/stop", b"bench", express=True),
    "dropped": lambda: drop_stop(Path(sys.argv[1].partition("/")[2]), "ta2/stop", b"bench"),
}
def post():
    page = http.client.HTTPConnection("127.0.0.1", int(sys.argv[6]), timeout=10.0)
    page.request("POST", "/api/stop", "{}")
    page.getresponse().read()
    page.close()
if len(sys.argv) > 6:
    ways["web"] = post
waits = {way: [] for way in ways}
def pause(seconds):
    threading.Event().wait(seconds)
pause(0.2)
print("ready", flush=True)
while not os.path.exists(sys.argv[5]):
    pause(0.05)
for way, stop in [*ways.items()] * int(sys.argv[4]):
    now_ns = time.monotonic_ns()
    at_ns = (now_ns // PERIOD_NS + 1) * PERIOD_NS + random.randrange(15_000_000, 30_000_000)
    pause((at_ns - now_ns) / 1e9)
    frames.clear()
    came.clear()
    sent_ns = time.monotonic_ns()
    stop()
    while not frames and time.monotonic_ns() - sent_ns < 2_000_000_000:
        came.wait(0.5)
    waits[way].append(((frames or [2_000_000_000 + sent_ns])[0] - sent_ns) / 1e6)
    peer.put("bench/stop", str(time.monotonic_ns()).encode(), express=True)
pause(0.3)
bare = [json.loads(reply.ok.payload.to_bytes()) for reply in peer.get("bench/delays")][0]
print("WAITS " + json.dumps([waits, [delay / 1e6 for delay in bare]]), flush=True)
os._exit(0)  # its sessions need no farewell
"""


@contextmanager
def _flooded(system: System, kind: str, seconds: float) -> Iterator[None]:
    """Flood the daemon while the block runs."""
    arguments = ["-m", "tests.e2e.flooder", kind, system.target, str(seconds)]
    names = [f"{kind}{n}-{time.monotonic_ns()}" for n in range(FLOODS.get(kind, 0))]
    floods = [Process(name, arguments, system.folder) for name in names]
    try:
        for flood in floods:
            wait_for(lambda flood=flood: "ready" in flood.text(), f"a flood of {kind}", tell=flood.text)
        yield
    finally:
        for flood in floods:
            flood.end()


def _rss_mib(pid: int) -> float:
    return int(Path(f"/proc/{pid}/status").read_text().split("VmRSS:")[1].split()[0]) / 1024


def _told(waits_ms: list[float]) -> str:
    p50, p99 = np.percentile(waits_ms, (50, 99))
    return f"p50 {p50:.2f}, p99 {p99:.1f}, worst {max(waits_ms):.1f} ms"


def _stop_rows(system: System, peer: str, kind: str, stops: int, *web: str) -> list[Row]:
    begin = system.folder / f"begin-{kind}"
    places = [f"unixsock-stream/{system.target}", peer, system.endpoint, str(stops), str(begin), *web]
    prober = Process(f"prober-{time.monotonic_ns()}", ["-c", PROBER, *places], system.folder)
    wait_for(lambda: "ready" in prober.text(), "the prober", tell=prober.text)  # somebody who was connected before
    favour(prober)
    with _flooded(system, kind, 30.0 + stops / 5):
        begin.touch()
        wait_for(lambda: not prober.is_running, "its stops", 30.0 + stops / 2.5, tell=prober.text)
    waits, bare = json.loads(prober.text().rsplit("WAITS ", 1)[1])
    bare = bare[-len(waits) * stops :]
    rows = []
    for way, ours in waits.items():
        p50, p999 = np.percentile(ours, (50, 99.9))
        p50_ms, worst_ms = WEB_GOALS_MS if way == "web" else (P50_GOAL_MS, WORST_GOAL_MS)
        rows.append(
            Row(
                name=f"stop ({way}) -> frame at the robot, {kind}",
                ours=_told(ours),
                peer=_told(bare),
                ratio=f"p50 {p50 / np.percentile(bare, 50):.1f}x",
                goal=f"p50 < {p50_ms:g}, p99.9 < {worst_ms:g} ms",
                good=bool(p50 < p50_ms and p999 < worst_ms),
            )
        )
    return rows


def _streams(system: System, kind: str) -> dict[str, float]:
    with _flooded(system, kind, 30.0):
        system.control.ask("reset_stats")
        time.sleep(STREAM_S)
        stats = system.stats()
    commands: dict[str, Any] = stats["commands"]
    seen = [commands[topic] for topic in joint_topics() if topic in commands]
    return {
        "p99_ms": max((float(each["p99_ms"]) for each in seen), default=float("inf")),
        "gap_ms": worst_gap_ms(stats) if len(seen) == len(joint_topics()) else float("inf"),
        "rss_mib": _rss_mib(system.daemon.pid),
    }


def _stream_row(system: System, owner: Process, kind: str) -> Row:
    before, under = _streams(system, "quiet"), _streams(system, kind)
    is_lost = not owner.is_running
    grown_mib = under["rss_mib"] - before["rss_mib"]
    ratio = under["p99_ms"] / before["p99_ms"]
    return Row(
        name=f"an owner's stream, {kind}",
        ours=f"p99 {under['p99_ms']:.1f}, worst {under['gap_ms']:.0f} ms" + (", LOST" if is_lost else ""),
        peer=f"p99 {before['p99_ms']:.1f}, worst {before['gap_ms']:.0f} ms",
        ratio=f"p99 {ratio:.2f}x, {grown_mib:+.0f} MiB",
        goal=f"<= {INTERVAL_GOAL:g}x, < {GAP_GOAL_MS:g} ms, < {RSS_GOAL_MIB} MiB",
        good=not is_lost and ratio <= INTERVAL_GOAL and under["gap_ms"] < GAP_GOAL_MS and grown_mib < RSS_GOAL_MIB,
    )


def stop_rows(folder: Path, stops: int) -> list[Row]:
    """Measure owners and stops under floods.

    Args:
        folder: For sockets and logs.
        stops: How many under each flood.
    """
    rows: list[Row] = []
    peer = f"unixsock-stream/{folder / 'peer.sock'}"
    system = System(folder)
    subscriber = Process("subscriber", ["-u", "-c", SUBSCRIBER, peer], folder)
    try:
        system.connect("bench").close()
        owner = system.client("owner", OWNER)
        for kind in FLOODS:
            if not owner.is_running:
                owner = system.client("owner", OWNER.replace("robot.control()", "robot.control(take='again')"))
            wait_for(lambda who=owner: "driving" in who.text().rpartition("Error")[2], "an owner", tell=owner.text)
            favour(owner)
            rows.append(_stream_row(system, owner, kind))
        owner.end()
        wait_for(lambda: "ready" in subscriber.text(), "the plain subscriber")
        favour(subscriber)
        port = str(free_port())
        web = Process("web", ["-m", "gateway.cli", "web", "--at", system.target, "--port", port, "--json"], folder)
        try:
            wait_for(web.text, "the page's address")
            rows += _stop_rows(system, peer, "quiet", stops, port)
        finally:
            web.end()
        rows += [row for kind in FLOODS for row in _stop_rows(system, peer, kind, stops)]
        print(os.linesep.join(line for line in system.daemon.text().splitlines() if "TAKEN_OVER" in line))
    finally:
        subscriber.end()
        system.close()
    return rows
