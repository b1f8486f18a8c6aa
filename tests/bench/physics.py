"""The simulated robot with forces: how much faster than real time it is, and whether its process keeps up with the clock.

Both arms are streamed at 100 Hz, both hands close, the base drives in a circle; cameras off.
"""

from __future__ import annotations

import math
import statistics
import subprocess
import sys
import time

import numpy as np

from cdr_types.messages import std_msgs
from gateway.sim.remote import SimControl, SimUnreachable
from gateway.sim.robot.manual import (
    CHASSIS_CMD,
    EXAMPLE_HOME_RAD,
    FSM_ENABLE,
    MS,
    Side,
    gripper_cmd_topic,
    joint_cmd_topic,
)
from gateway.sim.robot.model import SimRobot
from gateway.sim.robot.settings import SimSettings
from tests.bench.table import Row
from tests.e2e.system import free_port
from tests.sim.drivers import joints

__all__ = ["physics_rows"]

CYCLE_NS = 5 * MS


def physics_rows(seconds: float = 10.0) -> list[Row]:
    """Measure in virtual time, beside the kinematic robot told the same, then a process of its own.

    Args:
        seconds: Of the robot's time, for each.
    """
    taken_us = {kind: _cycles_us(kind, seconds) for kind in ("mujoco", "kinematic")}
    faster = {kind: CYCLE_NS / 1e3 / statistics.mean(taken) for kind, taken in taken_us.items()}
    ordered = sorted(taken_us["mujoco"])
    p50, p99 = ordered[len(ordered) // 2], ordered[int(0.99 * len(ordered))]
    kept = _kept(seconds)
    return [
        Row(
            name="real-time factor, virtual time, all state topics at 200 Hz",
            ours=f"{faster['mujoco']:.1f}",
            peer=f"kinematic {faster['kinematic']:.1f}",
            ratio=f"{faster['mujoco'] / faster['kinematic']:.2f}x",
            goal=">= 1.0",
            good=faster["mujoco"] >= 1.0,
        ),
        Row(
            name="a cycle of 5 ms with physics",
            ours=f"p50 {p50:.0f}, p99 {p99:.0f} us",
            goal=f"p50 <= {0.5 * CYCLE_NS / 1e3:.0f} us",
            good=p50 <= 0.5 * CYCLE_NS / 1e3,
        ),
        Row(
            name=f"time of physics per time of the clock, its process, {seconds:g} s",
            ours=f"{kept:.3f}",
            goal=">= 0.995",
            good=kept >= 0.995,
        ),
    ]


def _cycles_us(kind: str, seconds: float) -> list[float]:
    """Return what each cycle takes [us], commands included."""
    robot = SimRobot(SimSettings(physics=kind))
    home = {side: np.array(EXAMPLE_HOME_RAD[side]) for side in Side}
    begin = {side: robot.arms[side].q_rad.copy() for side in Side}
    taken = []
    for cycle in range(round(seconds * 1e9 / CYCLE_NS)):
        begun = time.perf_counter_ns()
        now_ns = robot.now_ns
        if cycle % 10 == 0:
            robot.receive(FSM_ENABLE, std_msgs.Float32(data=1.0), now_ns)
            robot.receive(CHASSIS_CMD, std_msgs.Float32MultiArray(data=[0.2, 0.0, 0.4]), now_ns)
        if cycle % 2 == 0:
            part = 0.5 - 0.5 * math.cos(2.0 * math.pi * 0.25 * now_ns / 1e9)
            for side in Side:
                robot.receive(joint_cmd_topic(side), joints(begin[side] + part * (home[side] - begin[side])), now_ns)
                robot.receive(gripper_cmd_topic(side), std_msgs.Float32(data=0.8), now_ns)
        robot.advance(now_ns + CYCLE_NS, latest_only=True)
        taken.append((time.perf_counter_ns() - begun) / 1e3)
    return taken


def _kept(seconds: float) -> float:
    """Return how much time of physics passes in a second of the clock, in a process that publishes to nobody."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    words = ["-m", "gateway.cli", "sim", "--physics", "mujoco", "--listen", endpoint]
    process = subprocess.Popen([sys.executable, *words], stdout=subprocess.DEVNULL)
    try:
        with _reach(endpoint) as control:
            before = _times(control)
            time.sleep(seconds)
            after = _times(control)
        return (after[1] - before[1]) / (after[0] - before[0])
    finally:
        process.terminate()
        process.wait()


def _reach(endpoint: str) -> SimControl:
    """Return the control channel of a process that has begun to answer."""
    for _ in range(100):
        try:
            control = SimControl(endpoint, timeout_s=10.0)
            control.ask("ping")
            return control
        except SimUnreachable:
            time.sleep(0.1)
    raise SimUnreachable(f"no simulation at {endpoint} within 10 s")


def _times(control: SimControl) -> tuple[float, float]:
    """Return the robot's time and that of its physics [s]."""
    stats = control.ask("stats")
    physics = stats["physics"]
    assert isinstance(physics, dict) and isinstance(stats["now_ns"], int)
    return stats["now_ns"] / 1e9, float(physics["time_s"])
