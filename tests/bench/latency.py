"""How long a target takes from `set` in this process to the first changed setpoint at the robot's router.

Paced and unpaced streams take turns in one run. A target is measured when the arm is at rest: the next setpoint that differs
is its own. Unpaced streams keep one phase to the ticks for as long as they live, so their measured targets are set late by
another part of a tick each.
"""

from __future__ import annotations

import bisect
import time

import numpy as np
import zenoh

from gateway.client import Control
from tests.bench.table import Row

__all__ = ["latency_rows"]

TURNS = 4
TARGETS = 40
"""Measured in each turn."""
APART = 8
"""Ticks from one measured target to the next."""
STEP_RAD = 0.0005
"""Small enough to be at rest again by then."""
TICK_NS = 10_000_000
P50_MS, P99_MS = 3.0, 6.0


def _turn(own: Control, *, paced: bool) -> list[int]:
    """Run one stream at 50 Hz; return when its measured targets were set [ns]."""
    set_ns = []
    with own.left_arm.stream(rate_hz=50, paced=paced) as out:
        start = out.q.copy()
        for n in range(APART * (TARGETS + 4)):
            target = start.copy()
            target[6] += STEP_RAD * (n // APART % 2)
            if n % APART == 0 and n >= 4 * APART:  # not before the phase is known
                time.sleep(0.0 if paced else n // APART * 37 % 100 * TICK_NS / 1e11)
                set_ns.append(time.monotonic_ns())
            out.set(target)
            out.tick()
    return set_ns


def _waits_ms(set_ns: list[int], arrivals_ns: list[int]) -> list[float]:
    """Return how long each target took [ms]; one that found the arm moving does not count."""
    waits = []
    for at_ns in set_ns:
        place = bisect.bisect(arrivals_ns, at_ns)
        if place < len(arrivals_ns) and (place == 0 or arrivals_ns[place - 1] < at_ns - TICK_NS):
            waits.append((arrivals_ns[place] - at_ns) / 1e6)
    return waits


def latency_rows(endpoint: str, own: Control) -> list[Row]:
    """Measure both kinds; some minute.

    Args:
        endpoint: Of the robot's router.
        own: Of an enabled robot.
    """
    arrivals_ns: list[int] = []
    last: list[bytes] = [b""]

    def hear(sample: zenoh.Sample) -> None:
        body = sample.payload.to_bytes()[-7 * 8 * 3 - 8 :]  # positions and what follows: no stamp
        if body != last[0]:
            last[0] = body
            arrivals_ns.append(time.monotonic_ns())

    config = f'{{mode: "client", connect: {{endpoints: ["{endpoint}"]}}, scouting: {{multicast: {{enabled: false}}}}}}'
    waits: dict[bool, list[float]] = {True: [], False: []}
    with zenoh.open(zenoh.Config.from_json5(config)) as session:
        session.declare_subscriber("api/left_arm/joint_cmd", hear)
        for turn in range(2 * TURNS):
            paced = turn % 2 == 0
            arrivals_ns.clear()
            set_ns = _turn(own, paced=paced)
            waits[paced] += _waits_ms(set_ns, arrivals_ns)
    (p50, p99), (other_p50, other_p99) = (np.percentile(waits[paced], [50, 99]) for paced in (True, False))
    return [
        Row(
            name=f"paced client set -> first changed setpoint at the robot, {title} of {len(waits[True])}",
            ours=f"{ours:.1f} ms",
            peer=f"{unpaced:.1f} ms (unpaced, of {len(waits[False])})",
            ratio=f"{ours - unpaced:+.1f} ms",
            goal=f"<= {goal:g} ms",
            good=bool(ours <= goal),
        )
        for title, ours, unpaced, goal in (("p50", p50, other_p50, P50_MS), ("p99", p99, other_p99, P99_MS))
    ]
