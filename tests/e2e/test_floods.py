"""Clients that flood, crowd, stall and fall silent in mid-word, while an owner streams to the robot: they harm themselves only.

How long anything takes under each flood is measured by `bin/bench stop`; here it is who is lost, and who gets through.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import pytest

from gateway.api.keys import STOP_KEY
from gateway.api.stop_pipe import drop_stop
from gateway.client import connect
from tests.e2e.system import Process, System, joint_topics, steady, wait_for, worst_gap_ms
from tests.fuzz.attacker import connect as raw

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.alone,
    pytest.mark.sim_only("floods are a matter of clients and daemon"),
]

Systems = Callable[..., System]

FLOODS = (
    ("keepalives", 4), ("wildcards", 1), ("own_keys", 1), ("large_puts", 4), ("questions", 1), ("large_questions", 4),
    ("chunks", 1), ("pings", 4), ("half_open", 1), ("deaf", 1), ("sessions", 1),
)  # fmt: skip
"""Kinds of `tests/e2e/flooder.py`, and how many processes. Not `tokens`: they keep the robot from being heard for a moment."""
FRAMES = 80
"""Setpoints that each flood lasts at least."""
GROWTH_KIB = 96 * 1024
"""What zenoh keeps of some hundred sessions that came and went, and does not give back."""

OWNER = """
with robot.control() as own:
    own.enable(timeout=12.0)
    outs = [arm.stream(rate_hz=50).__enter__() for arm in (own.left_arm, own.right_arm)]
    starts = [out.q.copy() for out in outs]
    print("driving", flush=True)
    for n in range(10**6):
        for out, start in zip(outs, starts):
            target = start.copy()
            target[6] += 0.1 * (1 - np.cos(0.04 * n))
            out.set(target)
        outs[0].tick()
"""
NUMBERS = count(1)


@contextmanager
def flooded(system: System, kind: str, processes: int) -> Iterator[None]:
    """Flood the daemon while the block runs."""
    floods = []
    try:
        for _ in range(processes):
            arguments = ["-u", "-m", "tests.e2e.flooder", kind, system.target, "30"]
            floods.append(Process(f"{kind}{next(NUMBERS)}", arguments, system.folder))
        for flood in floods:
            wait_for(lambda flood=flood: "ready" in flood.text(), f"a flood of {kind}", tell=flood.text)
        yield
    finally:
        for flood in floods:
            flood.send(signal.SIGKILL)
            flood.end()


def rss_kib(process: Process) -> int:
    """Return the resident memory of a process [KiB]."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0])


def streaming(system: System) -> Process:
    """Return an owner that streams targets to both arms, from now on."""
    owner = system.client("owner", OWNER)
    wait_for(lambda: "driving" in owner.text(), "an owner", tell=owner.text)
    return owner


@pytest.mark.thorough
def test_floods_harm_nobody_but_their_senders(tmp_path: Path, systems: Systems) -> None:
    """Whatever others send, as fast as they can: the owner keeps the robot, and his arms their setpoints; memory stays."""

    def attempt(folder: Path) -> list[str]:
        system = systems(folder, has_guard=False)
        system.connect("first").close()
        owner = streaming(system)
        before_kib, broken = rss_kib(system.daemon), []
        for kind, processes in FLOODS:
            system.control.ask("reset_stats")
            with flooded(system, kind, processes):
                wait_for(
                    lambda: not owner.is_running or min(map(system.count, joint_topics())) > FRAMES,
                    f"an owner's setpoints under {kind}",
                    tell=system.logs,
                )
            gap_ms = worst_gap_ms(system.stats())
            if not owner.is_running:
                broken.append(f"{kind}: the owner is lost: {owner.text()[-300:]}")
                break
            if gap_ms >= 100.0:
                broken.append(f"{kind}: arm gap of {gap_ms} ms at the robot")
        grown_kib = rss_kib(system.daemon) - before_kib
        assert grown_kib < GROWTH_KIB, f"the daemon grew by {grown_kib} KiB"
        assert "Traceback" not in system.daemon.text()
        system.close()
        return broken

    steady(attempt, tmp_path)


@pytest.mark.parametrize("kind", ["large_questions", "half_open", "sessions", "tokens"])
def test_a_stop_gets_through_every_flood(kind: str, tmp_path: Path, systems: Systems) -> None:
    """Anybody's stop stops while others flood, from a connection that was there, without any, and from one that is made now."""
    system = systems(tmp_path, has_guard=False)
    with system.connect("watcher") as watcher, raw(f"unixsock-stream/{system.target}") as session:
        with flooded(system, kind, 1):
            session.put("ta2/stop", b"flooded")
            wait_for(lambda: "STOPPED_BY_OTHER" in watcher.state.latches, "a stop", 10.0, tell=system.logs)
            watcher.recover()
            wait_for(lambda: not watcher.state.latches, "a recovery", 10.0)
            assert drop_stop(Path(system.target), STOP_KEY, b"of somebody without a connection")
            wait_for(lambda: "STOPPED_BY_OTHER" in watcher.state.latches, "a dropped stop", 10.0, tell=system.logs)
            watcher.recover()
            with wait_for(lambda: connect(system.target, name="late", timeout_s=2.0), "a connection") as late:
                late.estop("flooded")
            wait_for(lambda: "ESTOP" in watcher.state.latches, "an e-stop", 10.0, tell=system.logs)
