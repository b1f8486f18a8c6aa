"""Through a real bridge: from a setpoint to the robot's DDS graph, and from the graph to what a client of ours sees.

Setpoints carry the wall clock of this computer, at which they were encoded. States carry the robot's own: a DDS reader
on the robot's graph says when each was there. The peer is a plain zenoh subscriber at the robot's router in the same
seconds: it has what goes into the bridge, or what has just come out.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import zenoh

from cdr_types.encapsulation import peek_stamp
from gateway.robot.topics import arm_state, joint_command
from gateway.sim.robot.manual import STATE_TOPICS, command_topics
from gateway.values import Side
from tests.bench.table import Row
from tests.e2e.system import System, wait_for
from tests.interop.bridge_process import lacking

__all__ = ["dds_rows"]

SECONDS = 8.0
COMMAND = joint_command(Side.LEFT)
STATE = arm_state(Side.LEFT)


class _Plain:
    """A plain subscriber at the robot's router.

    Args:
        session: A zenoh session.
        topic: Of a JointState.

    Attributes:
        seen: Stamp and arrival of each sample [ns], by the monotonic clock.
    """

    def __init__(self, session: zenoh.Session, topic: str) -> None:
        self.seen: list[tuple[int, int]] = []
        self._held = session.declare_subscriber(topic.strip("/"), self._hear)

    def _hear(self, sample: zenoh.Sample) -> None:
        now_ns = time.monotonic_ns()
        self.seen.append((peek_stamp(sample.payload.to_bytes()), now_ns))


def _ages_ns(seen: list[tuple[int, int]], at_ns: Mapping[int, int] | int) -> list[int]:
    """Return how old what was seen was: by when each stamp was somewhere, or by how far the stamps' clock is ahead [ns]."""
    if isinstance(at_ns, int):
        return [now_ns - (stamp_ns - at_ns) for stamp_ns, now_ns in seen]
    return [now_ns - at_ns[stamp_ns] for stamp_ns, now_ns in seen if stamp_ns in at_ns]


def _row(name: str, ours_ns: list[int], plain_ns: list[int]) -> Row:
    ours, plain = ([float(p) / 1e6 for p in np.percentile(ages, [50, 99])] for ages in (ours_ns, plain_ns))
    return Row(
        name=name,
        ours=f"p50 {ours[0]:.2f}, p99 {ours[1]:.2f} ms",
        peer=f"p50 {plain[0]:.2f}, p99 {plain[1]:.2f} ms (zenoh subscriber)",
        ratio=f"{ours[0] - plain[0]:+.2f} ms",
    )


def dds_rows(folder: Path, pause: Callable[[float], None]) -> list[Row]:
    """Measure both ways; some 20 s. Nothing where no bridge has been built.

    Args:
        folder: For sockets, state and logs.
        pause: Lets time pass [s].
    """
    if what := lacking():
        print(f"latency to and from DDS is left out: {what}")
        return []
    from tests.interop.dds_node import DdsNode, loopback  # CycloneDDS is not everywhere

    place = folder / "dds"
    place.mkdir()
    System.kind = "dds"
    system = System(place)
    os.environ["CYCLONEDDS_URI"] = loopback(system.graph)
    config = f'{{mode: "client", connect: {{endpoints: ["{system.endpoint}"]}}, scouting: {{multicast: {{enabled: false}}}}}}'
    node: DdsNode | None = None
    try:
        with (
            system.connect("bench") as robot,
            zenoh.open(zenoh.Config.from_json5(config)) as session,
            robot.control() as own,
        ):
            types = {COMMAND: command_topics(has_lift=False)[COMMAND], STATE: STATE_TOPICS[STATE][0]}
            node = DdsNode("listener", publishes={}, subscribes=types)
            commands, states = _Plain(session, COMMAND), _Plain(session, STATE)
            own.enable(timeout=15.0)
            wait_for(lambda: node.arrivals and commands.seen and states.seen, "setpoints and states")
            ahead_ns = time.time_ns() - time.monotonic_ns()
            for seen in (node.arrivals, commands.seen, states.seen):
                seen.clear()
            shown: list[tuple[int, int]] = []
            seq, until = robot.state.seq, time.monotonic() + SECONDS
            while time.monotonic() < until:
                pause(0.0005)
                state = robot.state
                measured = state.view.arms["left"].measured
                if state.seq != seq and measured is not None:
                    seq = state.seq
                    shown.append((measured.stamp_ns, time.monotonic_ns()))
            read: dict[str, list[tuple[int, int]]] = {COMMAND: [], STATE: []}
            for arrival in [node.arrivals.popleft() for _ in range(len(node.arrivals))]:
                if arrival.payload:
                    read[arrival.topic].append((peek_stamp(arrival.payload), arrival.now_ns))
            there = dict(read[STATE])
            return [
                _row(
                    "setpoint encoded -> DDS reader",
                    _ages_ns(read[COMMAND], ahead_ns),
                    _ages_ns(commands.seen, ahead_ns),
                ),
                _row(
                    "state at a DDS reader -> snapshot at a client",
                    _ages_ns(shown, there),
                    _ages_ns(states.seen, there),
                ),
            ]
    finally:
        System.kind = "sim"
        if node is not None:
            node.close()
        system.close()
