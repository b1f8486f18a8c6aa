"""Full load: every command stream that there is at once, its rate at the robot, and what that costs the daemon and its guard.

That stands beside an empty subscriber, and beside what a user would run instead (`host_bridge`). A driver in a process of
its own owns the robot: it streams targets to the arms in joint mode at 50 Hz, closes the grippers of all arms that are
streamed and drives the chassis. A second robot has its right arm in end-effector mode.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from gateway.robot.topics import COMMAND_TOPICS, TOPICS
from gateway.values import Side
from tests.bench.host_bridge import host_peer, lacking_row
from tests.bench.processor import bare_of, cpu_row, family, favour, peer_of
from tests.bench.table import Row
from tests.e2e.system import Process, System, joint_topics, wait_for

__all__ = ["full_load_rows"]

HOST_GOAL = 1.0
"""Processor time of daemon and guard, beside a host bridge with a bare DDS node."""

DRIVER = """
import math
MODES = robot.state.mode.joint_mode
with robot.control() as own:
    own.enable(timeout=12.0)
    for side in ("left", "right"):
        if robot.state.arm(side).is_streaming:
            getattr(own, f"{side}_gripper").grip(0.5)
    arms = [getattr(own, f"{side}_arm") for side in ("left", "right") if MODES[side]]
    outs = [arm.stream(rate_hz=50).__enter__() for arm in arms]
    starts = [out.q.copy() for out in outs]
    print("driving", flush=True)
    begun = time.monotonic()
    n = 0
    while True:
        swing = 0.15 * (1 - math.cos(1.5 * (time.monotonic() - begun)))
        for out, start in zip(outs, starts):
            target = start.copy()
            target[6] += swing
            out.set(target)
        if n % 5 == 0:
            own.chassis.set_velocity(0.05 * math.cos(time.monotonic() - begun), 0.0, 0.0)
        n += 1
        outs[0].tick()
"""
"""Commands everything until it is ended."""


def _rate_rows(commands: Mapping[str, Any], topics: list[str], title: str) -> list[Row]:
    """Rates and intervals of the streams that ran, as the robot saw them."""
    rows = []
    for topic in topics:
        seen = commands.get(topic)
        if seen is None or not seen["count"]:
            continue
        nominal_hz = TOPICS[topic].rate_hz
        rate_hz = float(seen["rate_hz"])
        rows.append(
            Row(
                name=f"{topic}, {title}",
                ours=f"{rate_hz:.2f} Hz",
                ratio=f"p50 {seen['p50_ms']:.2f}, p99 {seen['p99_ms']:.2f}, max {seen['max_ms']:.2f} ms",
                goal=f"{nominal_hz:g} Hz +- 0.5 %",
                good=abs(rate_hz / nominal_hz - 1.0) < 0.005,
            )
        )
    return rows


def _takeover_rows(system: System, pause: Callable[[float], None]) -> list[Row]:
    """Kill the daemon while everything is driven: how long the arms get nothing at the robot."""
    _, *guards = family(system.daemon.pid)
    if not guards:
        return []
    system.control.ask("reset_stats")
    pause(0.5)
    system.daemon.send(signal.SIGKILL)
    pause(1.5)
    commands: Any = system.stats()["commands"]
    gap_ms = max(float(commands[topic]["max_ms"]) for topic in joint_topics())
    for guard in guards:
        with suppress(ProcessLookupError):
            os.kill(guard, signal.SIGTERM)  # it would hold for ten seconds
    return [
        Row(
            name="the daemon is killed: longest arm gap at the robot",
            ours=f"{gap_ms:.0f} ms",
            peer="the robot stops an arm at 150 ms",
            goal="< 100 ms",
            good=gap_ms < 100.0,
        )
    ]


def _bare_row(system: System, subscriber: Process, pause: Callable[[float], None], seconds: float) -> Row:
    """Measure what the same traffic costs two processes that do nothing but receive and send: no gateway can cost less."""
    with ExitStack() as ending:
        bare = {}
        for role in ("takes", "sends", "hears"):
            bare[role] = Process(f"bare-{role}", bare_of(system.endpoint, role), system.folder)
            ending.callback(bare[role].end)
        for role, process in bare.items():
            wait_for(lambda process=process: "ready" in process.text(), f"the process that {role}")
            favour(process)
        pause(0.5)
        name = "CPU of bare receives and sends, no client and no control"
        pids = [bare["sends"].pid, bare["hears"].pid]
        return cpu_row(name, pids, subscriber.pid, pause, seconds, None, rest="as a guard hears")


def _host_row(system: System, topics: list[str], pause: Callable[[float], None], seconds: float) -> Row:
    """Measure beside what a user would run instead: a host bridge and a bare DDS node, with the same traffic."""
    name = "CPU of daemon and guard, all streams, beside a host bridge and a bare DDS node"
    missing = lacking_row(name)
    if missing is not None:
        return missing
    with host_peer(system.folder, topics, pause) as peer:
        return cpu_row(name, family(system.daemon.pid), peer, pause, seconds, HOST_GOAL)


def _driven_rows(
    system: System, title: str, pause: Callable[[float], None], seconds: float, *, dies: bool
) -> list[Row]:
    """Drive everything that a system has, and measure; at the end the daemon may be killed."""
    with ExitStack() as ending:
        favour(system.sim)
        subscriber = Process(f"subscriber-{title}", peer_of(system.endpoint), system.folder)
        ending.callback(subscriber.end)
        driver = system.client(f"driver-{title}", DRIVER)
        ending.callback(driver.end)
        wait_for(lambda: "ready" in subscriber.text(), "the plain subscriber")
        wait_for(lambda: "driving" in driver.text() or not driver.is_running, "the driver")
        assert driver.is_running, driver.text()
        pause(1.0)
        system.control.ask("reset_stats")
        cpu = cpu_row(
            f"CPU of daemon and guard, {title}", family(system.daemon.pid), subscriber.pid, pause, seconds, None
        )
        assert driver.is_running, driver.text()
        commands: Any = system.stats()["commands"]
        topics = [topic for topic in COMMAND_TOPICS if commands.get(topic, {"count": 0})["count"]]
        rows = [cpu, *_rate_rows(commands, topics, title)]
        if dies:
            rows.append(_host_row(system, topics, pause, seconds))
            rows.append(_bare_row(system, subscriber, pause, seconds))
        return rows + (_takeover_rows(system, pause) if dies else [])


def full_load_rows(folder: Path, pause: Callable[[float], None], seconds: float) -> list[Row]:
    """Measure full load; about a minute.

    Args:
        folder: For sockets, state and logs.
        pause: Lets time pass [s].
        seconds: Length of each window [s].
    """
    rows: list[Row] = []
    for name, mode in (("joint", None), ("mixed", "pose")):
        place = folder / name
        place.mkdir()
        system = System(place)
        try:
            if mode is not None:
                control = system.control
                wait_for(
                    lambda control=control, mode=mode: (
                        control.fault("control_mode", side=Side.RIGHT.value, mode=mode) is None
                    ),
                    "the simulated robot",
                )
            with system.connect("bench") as viewer:
                wait_for(
                    lambda viewer=viewer, mode=mode: viewer.state.mode.joint_mode["right"] is (mode is None),
                    "the robot's control mode",
                )
            title = "all streams" if mode is None else "all streams, right arm by poses"
            rows += _driven_rows(system, title, pause, seconds, dies=mode is None)
        finally:
            system.close()
    return rows
