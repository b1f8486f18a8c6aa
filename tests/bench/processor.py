"""Processor time of processes, to the microsecond: the daemon with everything that it started, beside a plain peer."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from tests.bench.table import Row
from tests.e2e.system import Process

__all__ = ["bare_of", "cpu_row", "cpu_s", "family", "favour", "peer_of"]

PEER_SUBSCRIBER = """
import json, sys, time, zenoh
from gateway.robot.topics import STATE_TOPICS
config = {"mode": "client", "connect": {"endpoints": [sys.argv[1]]}, "scouting": {"multicast": {"enabled": False}}}
session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
held = [session.declare_subscriber(topic[1:], lambda sample: None) for topic in STATE_TOPICS]
print("ready", flush=True)
while True:
    time.sleep(1.0)
"""
"""A process that only subscribes to every state topic, with empty callbacks."""

BARE = """
import json, sys, time, zenoh
from gateway.link.codec import FRAME_BYTES
from gateway.link.hearing import DECIDING
from gateway.link.session_config import session_config
from gateway.robot.topics import COMMAND_TOPICS, STATE_TOPICS, TOPICS
from gateway.settings.settings import LinkSettings
from gateway.process.zenoh_threads import share_reactor
endpoint, role = sys.argv[1:]
share_reactor()
config = json.loads(session_config(LinkSettings(endpoint=endpoint)))
config["access_control"]["enabled"] = False
session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
hears = [] if role == "takes" else DECIDING if role == "hears" else STATE_TOPICS
rings = [session.declare_subscriber(topic[1:], zenoh.handlers.RingChannel(256)) for topic in hears]
if role == "takes":
    rings = [session.declare_subscriber("bench/**", zenoh.handlers.RingChannel(256))]
streams = []
if role == "sends":
    for n, topic in enumerate(t for t in COMMAND_TOPICS if "target_pose" not in t):
        publisher = session.declare_publisher(f"bench/{n}", congestion_control=zenoh.CongestionControl.DROP,
            express=True, priority=zenoh.Priority.INTERACTIVE_HIGH, allowed_destination=zenoh.Locality.REMOTE)
        streams.append((publisher, bytes(FRAME_BYTES[topic]), round(100 / TOPICS[topic].rate_hz)))
print("ready", flush=True)
period_ns = 10_000_000 if role == "sends" else 40_000_000
tick = time.monotonic_ns() // period_ns
while True:
    tick += 1
    rest_ns = tick * period_ns - time.monotonic_ns()
    if rest_ns > 0:
        time.sleep(rest_ns / 1e9)
    for ring in rings:
        while ring.try_recv() is not None:
            pass
    for publisher, payload, every in streams:
        if tick % every == 0:
            publisher.put(payload)
"""
"""The traffic of a gateway without a gateway. Role `sends`: hears all state and sends as many frames of the same sizes, on
keys of nobody; `hears`: hears what a guard hears; `takes`: takes the frames, so that they are not dropped at the sender."""


def peer_of(endpoint: str) -> list[str]:
    """Return the arguments of an interpreter that runs the plain subscriber of a robot."""
    return ["-u", "-c", PEER_SUBSCRIBER, endpoint]


def bare_of(endpoint: str, role: str) -> list[str]:
    """Return the arguments of an interpreter that only receives and sends, in a role of `BARE`."""
    return ["-u", "-c", BARE, endpoint, role]


def cpu_s(pid: int) -> float:
    """Return the processor time that a process has used, its ended threads included [s]."""
    return time.clock_gettime_ns((~pid << 3) | 2) / 1e9  # clock_getcpuclockid(3) of Linux, CPUCLOCK_SCHED


def family(pid: int) -> list[int]:
    """Return a process and all that it started, directly or not: the daemon and its guard."""
    children: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        with suppress(OSError, ValueError):
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
            children.setdefault(int(fields[1]), []).append(int(entry.name))
    found = [pid]
    for member in found:
        found += children.get(member, [])
    return found


def cpu_row(
    name: str,
    whole: list[int],
    peer: int | dict[str, int],
    pause: Callable[[float], None],
    seconds: float,
    goal: float | None,
    rest: str = "guard",
) -> Row:
    """Measure processes beside the plain subscriber, in the same seconds.

    Args:
        name: What is measured.
        whole: The daemon, and what else belongs to it.
        peer: The subscriber, or the processes of another peer by what they are called.
        pause: Lets time pass [s].
        seconds: How long.
        goal: At most so many times the peer's; None when it is only told.
        rest: What all but the first of the processes are called.
    """
    peers = {"empty callbacks": peer} if isinstance(peer, int) else peer
    pids = [*whole, *peers.values()]
    before = {each: cpu_s(each) for each in pids}
    begun = time.monotonic()
    pause(seconds)
    elapsed = time.monotonic() - begun
    share = {each: (cpu_s(each) - before[each]) / elapsed * 100 for each in pids}
    parts = {called: share.pop(pid) for called, pid in peers.items()}
    plain = sum(parts.values())
    told = ", ".join(f"{called} {part:.1f}" for called, part in parts.items()) if len(parts) > 1 else next(iter(parts))
    ours = sum(share.values())
    others = f" ({rest} {ours - share[whole[0]]:.1f})" if len(share) > 1 else ""
    return Row(
        name=name,
        ours=f"{ours:.1f} %{others}",
        peer=f"{plain:.1f} % ({told})",
        ratio=f"{ours / plain:.2f}x",
        goal="" if goal is None else f"<= {goal:g}x",
        good=None if goal is None else ours / plain <= goal,
    )


def favour(process: Process) -> None:
    """Let a simulated robot receive in real time where that is permitted: the senders are measured, not the receiver."""
    for task in Path(f"/proc/{process.pid}/task").iterdir():
        with suppress(PermissionError, ProcessLookupError):
            os.sched_setscheduler(int(task.name), os.SCHED_FIFO, os.sched_param(30))
